//! Axes of charts: where numbers lie in the picture.

use super::html::escape;

/// Size of a chart, in its own units; it is scaled to the page's width.
pub const WIDTH: f64 = 420.0;
/// See [`WIDTH`].
pub const HEIGHT: f64 = 270.0;
const LEFT: f64 = 50.0;
const RIGHT: f64 = 14.0;
const TOP: f64 = 10.0;
const BOTTOM: f64 = 42.0;
/// About this many steps along an axis.
const STEPS: f64 = 5.0;

/// What stands along the horizontal axis.
#[derive(Clone, Debug)]
pub enum Along {
    /// Numbers between two ends.
    Numbers(f64, f64),
    /// Names at 0, 1, 2, …
    Names(Vec<String>),
    /// Numbers at which alone there is something, e.g. window lengths.
    Places(Vec<f64>),
}

/// A chart's axes.
#[derive(Clone, Debug)]
pub struct Axes {
    /// What stands along the horizontal axis.
    pub along: Along,
    /// What it is.
    pub along_label: String,
    /// Lowest and highest number of the vertical axis.
    pub up: (f64, f64),
    /// What it is.
    pub up_label: String,
}

impl Axes {
    fn ends(&self) -> (f64, f64) {
        match &self.along {
            Along::Numbers(low, high) => (*low, *high),
            Along::Names(names) => (-0.25, names.len() as f64 - 0.75),
            Along::Places(places) => {
                let high = places.iter().copied().fold(f64::MIN, f64::max);
                (places.iter().copied().fold(f64::MAX, f64::min).min(0.0), high * 1.03)
            }
        }
    }

    /// Horizontal position of a number.
    pub fn x(&self, value: f64) -> f64 {
        let (low, high) = self.ends();
        LEFT + (WIDTH - LEFT - RIGHT) * share(value, low, high)
    }

    /// Vertical position of a number.
    pub fn y(&self, value: f64) -> f64 {
        HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * share(value, self.up.0, self.up.1)
    }

    /// The axes with their grid and numbers, as SVG.
    pub fn svg(&self) -> String {
        let mut svg = String::new();
        for tick in ticks(self.up.0, self.up.1) {
            let y = self.y(tick);
            svg.push_str(&format!(
                "<line class=\"grid\" x1=\"{LEFT}\" x2=\"{:.1}\" y1=\"{y:.1}\" y2=\"{y:.1}\"></line>\
                 <text class=\"end\" x=\"{:.1}\" y=\"{:.1}\">{}</text>",
                WIDTH - RIGHT,
                LEFT - 6.0,
                y + 4.0,
                short(tick)
            ));
        }
        let marks: Vec<(f64, String)> = match &self.along {
            Along::Numbers(low, high) => ticks(*low, *high).into_iter().map(|tick| (tick, short(tick))).collect(),
            Along::Names(names) => names.iter().enumerate().map(|(place, name)| (place as f64, name.clone())).collect(),
            Along::Places(places) => places.iter().map(|place| (*place, short(*place))).collect(),
        };
        for (value, name) in marks {
            svg.push_str(&format!(
                "<text class=\"middle\" x=\"{:.1}\" y=\"{:.1}\">{}</text>",
                self.x(value),
                HEIGHT - BOTTOM + 16.0,
                escape(&name)
            ));
        }
        let middle = (LEFT + WIDTH - RIGHT) / 2.0;
        svg.push_str(&format!(
            "<line class=\"axis\" x1=\"{LEFT}\" x2=\"{:.1}\" y1=\"{base:.1}\" y2=\"{base:.1}\"></line>\
             <text class=\"middle name\" x=\"{middle:.1}\" y=\"{:.1}\">{}</text>\
             <text class=\"middle name\" transform=\"translate(12 {:.1}) rotate(-90)\">{}</text>",
            WIDTH - RIGHT,
            HEIGHT - 6.0,
            escape(&self.along_label),
            (TOP + HEIGHT - BOTTOM) / 2.0,
            escape(&self.up_label),
            base = HEIGHT - BOTTOM,
        ));
        svg
    }
}

fn share(value: f64, low: f64, high: f64) -> f64 {
    if high > low { (value - low) / (high - low) } else { 0.5 }
}

/// Round numbers from `low` to `high`.
fn ticks(low: f64, high: f64) -> Vec<f64> {
    let range = high - low;
    if !(range.is_finite() && range > 0.0) {
        return vec![low];
    }
    let power = 10f64.powf((range / STEPS).log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|factor| factor * power).into_iter().find(|step| range / step <= STEPS + 0.5);
    let step = step.unwrap_or(10.0 * power);
    let first = (low / step).ceil() as i64;
    let last = (high / step + 1e-9).floor() as i64;
    (first..=last).map(|count| count as f64 * step).collect()
}

/// The next round number that is not below `value`, for the end of an axis.
pub fn round_up(value: f64) -> f64 {
    if !(value.is_finite() && value > 0.0) {
        return 1.0;
    }
    let power = 10f64.powf(value.log10().floor());
    let rounds = [1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0];
    rounds.into_iter().map(|factor| factor * power).find(|round| *round >= value).unwrap_or(value)
}

/// A number for an axis: `1.5`, `20`, `150k`, `2.5M`.
pub fn short(value: f64) -> String {
    let text = |value: f64| {
        let text = format!("{value:.2}");
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    };
    match value.abs() {
        size if size >= 1e6 => format!("{}M", text(value / 1e6)),
        size if size >= 1e4 => format!("{}k", text(value / 1e3)),
        _ => text(value),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_have_round_numbers() {
        assert_eq!(ticks(0.0, 60.0), [0.0, 20.0, 40.0, 60.0]);
        assert_eq!(ticks(0.0, 0.25), [0.0, 0.05, 0.1, 0.15000000000000002, 0.2, 0.25]);
        assert_eq!(ticks(3.0, 3.0), [3.0]);
        assert_eq!((round_up(57.3), round_up(0.0), round_up(120_001.0)), (60.0, 1.0, 150_000.0));
        assert_eq!([1.5, 20.0, 150_000.0, 2.5e6].map(short), ["1.5", "20", "150k", "2.5M"]);
    }

    #[test]
    fn axes_without_extent_put_everything_in_the_middle() {
        let axes = Axes {
            along: Along::Numbers(2.0, 2.0),
            along_label: String::new(),
            up: (0.0, 0.0),
            up_label: String::new(),
        };
        assert!(axes.x(2.0).is_finite() && axes.y(0.0).is_finite());
    }
}
