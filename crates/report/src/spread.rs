//! Means and standard deviations over seeds.

/// Mean and sample standard deviation over seeds.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Spread {
    /// The mean.
    pub mean: f64,
    /// The sample standard deviation; `None` for a single value.
    pub deviation: Option<f64>,
}

impl Spread {
    /// Mean and deviation of values; `None` if there are none.
    pub fn from_values(values: &[f64]) -> Option<Self> {
        let count = values.len() as f64;
        let mean = (!values.is_empty()).then(|| values.iter().sum::<f64>() / count)?;
        let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
        Some(Self { mean, deviation: (values.len() > 1).then(|| (squares / (count - 1.0)).sqrt()) })
    }

    /// A value published without its deviation.
    pub(crate) fn from_mean(mean: f64) -> Self {
        Self { mean, deviation: None }
    }

    /// Text with two decimals, e.g. `43.74 ± 0.21`.
    pub fn text(&self) -> String {
        match self.deviation {
            Some(deviation) => format!("{:.2} ± {deviation:.2}", self.mean),
            None => format!("{:.2}", self.mean),
        }
    }
}

/// The text of a table's cell.
pub(crate) fn cell_text(spread: Option<Spread>) -> String {
    spread.map_or_else(|| "–".to_owned(), |spread| spread.text())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spreads_are_sample_deviations() {
        assert_eq!(Spread::from_values(&[]), None);
        assert_eq!(Spread::from_values(&[4.0]), Some(Spread { mean: 4.0, deviation: None }));
        assert_eq!(Spread::from_values(&[1.0, 2.0, 3.0]).unwrap().text(), "2.00 ± 1.00");
        assert_eq!(cell_text(None), "–");
    }
}
