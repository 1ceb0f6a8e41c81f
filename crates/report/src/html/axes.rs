//! Axes of charts: they map numbers to positions in the drawing.

use maud::{Markup, html};

/// Width of a chart, in its own units; it is scaled to the page.
pub(super) const WIDTH: f64 = 420.0;
/// Height of a chart, in its own units.
pub(super) const HEIGHT: f64 = 270.0;
const LEFT: f64 = 56.0;
const RIGHT: f64 = 14.0;
const TOP: f64 = 10.0;
const BOTTOM: f64 = 44.0;
/// Approximate number of ticks on an axis.
const TICKS: f64 = 5.0;

/// The horizontal axis.
#[derive(Clone, Debug)]
pub(super) enum XAxis {
    /// Numbers from 0 to an end, with ticks at round numbers.
    Range(f64),
    /// Names at 0, 1, 2, …
    Names(Vec<String>),
    /// Numbers with ticks at these values only, e.g. window lengths.
    Values(Vec<f64>),
}

/// A chart's axes. The vertical axis starts at 0.
#[derive(Clone, Debug)]
pub(super) struct Axes {
    /// The horizontal axis.
    pub x: XAxis,
    /// Label of the horizontal axis.
    pub x_label: String,
    /// End of the vertical axis.
    pub y_end: f64,
    /// Label of the vertical axis.
    pub y_label: String,
}

impl Axes {
    /// Lowest and highest number of the horizontal axis.
    fn x_range(&self) -> (f64, f64) {
        match &self.x {
            XAxis::Range(end) => (0.0, *end),
            XAxis::Names(names) => (-0.25, names.len() as f64 - 0.75),
            XAxis::Values(values) => {
                let high = values.iter().copied().fold(f64::MIN, f64::max);
                (values.iter().copied().fold(f64::MAX, f64::min).min(0.0), high * 1.03)
            }
        }
    }

    /// Horizontal position of a number.
    pub(super) fn x(&self, value: f64) -> f64 {
        let (low, high) = self.x_range();
        LEFT + (WIDTH - LEFT - RIGHT) * fraction(value, low, high)
    }

    /// Vertical position of a number.
    pub(super) fn y(&self, value: f64) -> f64 {
        HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * fraction(value, 0.0, self.y_end)
    }

    /// The axes with their grid, ticks and labels.
    pub(super) fn markup(&self) -> Markup {
        let (left, right, base) = (tenths(LEFT), tenths(WIDTH - RIGHT), tenths(HEIGHT - BOTTOM));
        let x_middle = tenths((LEFT + WIDTH - RIGHT) / 2.0);
        let y_middle = tenths((TOP + HEIGHT - BOTTOM) / 2.0);
        html! {
            @for tick in ticks(self.y_end) {
                @let y = tenths(self.y(tick));
                line class="grid" x1=(left) x2=(right) y1=(y) y2=(y) {}
                text class="end" x=(tenths(LEFT - 6.0)) y=(tenths(self.y(tick) + 5.0)) { (tick_label(tick)) }
            }
            @for (value, label) in self.x_ticks() {
                text class="middle" x=(tenths(self.x(value))) y=(tenths(HEIGHT - BOTTOM + 18.0)) { (label) }
            }
            line class="axis" x1=(left) x2=(right) y1=(base) y2=(base) {}
            text class="middle" x=(x_middle) y=(tenths(HEIGHT - 6.0)) { (self.x_label) }
            text class="middle" transform={ "translate(13 " (y_middle) ") rotate(-90)" } { (self.y_label) }
        }
    }

    fn x_ticks(&self) -> Vec<(f64, String)> {
        let labelled = |value: f64| (value, tick_label(value));
        match &self.x {
            XAxis::Range(end) => ticks(*end).into_iter().map(labelled).collect(),
            XAxis::Names(names) => names.iter().enumerate().map(|(index, name)| (index as f64, name.clone())).collect(),
            XAxis::Values(values) => values.iter().copied().map(labelled).collect(),
        }
    }
}

/// Position of a value between two others, 0 to 1; one half if these are equal.
fn fraction(value: f64, low: f64, high: f64) -> f64 {
    if high > low { (value - low) / (high - low) } else { 0.5 }
}

/// Round numbers from 0 to `end`.
fn ticks(end: f64) -> Vec<f64> {
    if !(end.is_finite() && end > 0.0) {
        return vec![0.0];
    }
    let power = 10f64.powf((end / TICKS).log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|factor| factor * power).into_iter().find(|step| end / step <= TICKS + 0.5);
    let step = step.unwrap_or(10.0 * power);
    let last = (end / step + 1e-9).floor() as i64;
    (0..=last).map(|count| count as f64 * step).collect()
}

/// Rounds up to the next round number, for the end of an axis.
pub(super) fn round_up(value: f64) -> f64 {
    if !(value.is_finite() && value > 0.0) {
        return 1.0;
    }
    let power = 10f64.powf(value.log10().floor());
    let rounds = [1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0];
    rounds.into_iter().map(|factor| factor * power).find(|round| *round >= value).unwrap_or(value)
}

/// The label of a tick: `1.5`, `20`, `150k`, `2.5M`.
fn tick_label(value: f64) -> String {
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

/// Formats a coordinate with one decimal.
pub(super) fn tenths(value: f64) -> String {
    format!("{value:.1}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_have_round_numbers() {
        assert_eq!(ticks(60.0), [0.0, 20.0, 40.0, 60.0]);
        assert_eq!(ticks(0.25), [0.0, 0.05, 0.1, 0.15000000000000002, 0.2, 0.25]);
        assert_eq!(ticks(0.0), [0.0]);
        assert_eq!((round_up(57.3), round_up(0.0), round_up(120_001.0)), (60.0, 1.0, 150_000.0));
        assert_eq!([1.5, 20.0, 150_000.0, 2.5e6].map(tick_label), ["1.5", "20", "150k", "2.5M"]);
    }

    #[test]
    fn axes_without_extent_put_everything_in_the_middle() {
        let axes = Axes { x: XAxis::Range(0.0), x_label: String::new(), y_end: 0.0, y_label: String::new() };
        assert_eq!((axes.x(0.0), axes.y(0.0)), ((LEFT + WIDTH - RIGHT) / 2.0, (TOP + HEIGHT - BOTTOM) / 2.0));
    }
}
