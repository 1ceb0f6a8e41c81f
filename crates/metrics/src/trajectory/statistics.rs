//! Statistics of errors.

use serde::Serialize;

/// Statistics of errors, in the errors' unit. As `evo`'s.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ErrorStatistics {
    /// Root of the mean square.
    pub rmse: f64,
    /// Mean.
    pub mean: f64,
    /// Median; the mean of the middle two of an even number.
    pub median: f64,
    /// Standard deviation, of the errors as a population: the divisor is their number.
    pub std: f64,
    /// The smallest error.
    pub min: f64,
    /// The largest error.
    pub max: f64,
}

impl ErrorStatistics {
    /// Computes the statistics of at least one error. All are 0 for none.
    pub(super) fn of(mut errors: Vec<f64>) -> Self {
        let mean_of = |value: &dyn Fn(f64) -> f64| {
            errors.iter().map(|error| value(*error)).sum::<f64>() / errors.len().max(1) as f64
        };
        let mean = mean_of(&|error| error);
        let rmse = mean_of(&|error| error * error).sqrt();
        let std = mean_of(&|error| (error - mean) * (error - mean)).sqrt();
        errors.sort_by(f64::total_cmp);
        let at = |index: usize| errors.get(index).copied().unwrap_or_default();
        let count = errors.len();
        let median = (at(count.saturating_sub(1) / 2) + at(count / 2)) / 2.0;
        Self { rmse, mean, median, std, min: at(0), max: at(count.saturating_sub(1)) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statistics_of_few_errors() {
        let found = ErrorStatistics::of(vec![3.0, 1.0]);
        let expected = ErrorStatistics { rmse: 5f64.sqrt(), mean: 2.0, median: 2.0, std: 1.0, min: 1.0, max: 3.0 };
        assert_eq!(found, expected);
        assert_eq!(ErrorStatistics::of(vec![9.0, 1.0, 2.0]).median, 2.0);
        assert_eq!(ErrorStatistics::of(Vec::new()), ErrorStatistics::default());
    }
}
