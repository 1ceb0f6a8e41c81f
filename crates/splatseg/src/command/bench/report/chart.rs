//! Charts as SVG, with a legend in HTML.

use super::axes::{Axes, HEIGHT, WIDTH};
use super::html::escape;

/// Colours of the page's style sheet.
const COLORS: usize = 8;
/// Curves of at most this many points show them.
const MOST_DOTS: usize = 12;
/// Longer curves are thinned out to about this many points.
const MOST_POINTS: usize = 240;

/// A named curve, or a named set of dots.
#[derive(Clone, Debug)]
pub struct Curve {
    /// What it is.
    pub label: String,
    /// Which colour; those past the last begin again, dashed.
    pub color: usize,
    /// Its points, in the axes' numbers.
    pub points: Vec<(f64, f64)>,
    /// What each point is, for those who point at it; may be shorter.
    pub notes: Vec<String>,
}

/// How points are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Style {
    /// Joined by lines.
    Lines,
    /// As areas on top of each other.
    Stack,
    /// Each for itself, with the diagonal, above which the vertical number is the larger one.
    DotsAndDiagonal,
}

/// A chart.
#[derive(Clone, Debug)]
pub struct Chart {
    /// What it shows.
    pub title: String,
    /// Its axes.
    pub axes: Axes,
    /// What is drawn.
    pub curves: Vec<Curve>,
    /// How.
    pub style: Style,
}

impl Chart {
    /// The chart for the page.
    pub fn html(&self) -> String {
        let title = escape(&self.title);
        let mut drawing = self.axes.svg();
        if self.style == Style::DotsAndDiagonal {
            let (low, high) = self.axes.up;
            drawing.push_str(&format!(
                "<line class=\"diagonal\" x1=\"{:.1}\" y1=\"{:.1}\" x2=\"{:.1}\" y2=\"{:.1}\"></line>",
                self.axes.x(low),
                self.axes.y(low),
                self.axes.x(high),
                self.axes.y(high)
            ));
        }
        if self.style == Style::Stack {
            drawing.push_str(&self.stack());
        } else {
            drawing.extend(self.curves.iter().map(|curve| self.curve(curve)));
        }
        let legend = self.curves.iter().map(|curve| {
            format!("<li><span class=\"swatch {}\"></span>{}</li>", class(curve.color), escape(&curve.label))
        });
        format!(
            "<figure class=\"chart\"><figcaption>{title}</figcaption>\
             <svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{title}\">{drawing}</svg>\
             <ul class=\"legend\">{}</ul></figure>",
            legend.collect::<String>()
        )
    }

    fn curve(&self, curve: &Curve) -> String {
        let mut svg = String::new();
        let class = class(curve.color);
        let points = thinned(&curve.points);
        if self.style == Style::Lines && points.len() > 1 {
            let path: Vec<String> =
                points.iter().map(|(x, y)| format!("{:.1} {:.1}", self.axes.x(*x), self.axes.y(*y))).collect();
            svg.push_str(&format!("<path class=\"curve {class}\" d=\"M{}\"></path>", path.join(" L")));
        }
        if self.style != Style::Lines || curve.points.len() <= MOST_DOTS {
            for (place, (x, y)) in curve.points.iter().enumerate() {
                let note = curve.notes.get(place).map_or_else(|| format!("{y:.2}"), Clone::clone);
                svg.push_str(&format!(
                    "<circle class=\"dot {class}\" cx=\"{:.1}\" cy=\"{:.1}\" r=\"4\"><title>{}</title></circle>",
                    self.axes.x(*x),
                    self.axes.y(*y),
                    escape(&format!("{}: {note}", curve.label))
                ));
            }
        }
        svg
    }

    /// Each curve on those before it. All have their points at the same places.
    fn stack(&self) -> String {
        let count = self.curves.iter().map(|curve| curve.points.len()).min().unwrap_or(0);
        let mut below = vec![0.0; count];
        let mut svg = String::new();
        for curve in &self.curves {
            let above: Vec<f64> = below.iter().zip(&curve.points).map(|(below, (_, value))| below + value).collect();
            let at = |heights: &[f64]| -> Vec<(f64, f64)> {
                thinned(&curve.points.iter().zip(heights).map(|((x, _), height)| (*x, *height)).collect::<Vec<_>>())
            };
            let outline = at(&above).into_iter().chain(at(&below).into_iter().rev());
            let path: Vec<String> =
                outline.map(|(x, y)| format!("{:.1} {:.1}", self.axes.x(x), self.axes.y(y))).collect();
            if !path.is_empty() {
                svg.push_str(&format!(
                    "<path class=\"area {}\" d=\"M{} Z\"><title>{}</title></path>",
                    class(curve.color),
                    path.join(" L"),
                    escape(&curve.label)
                ));
            }
            below = above;
        }
        svg
    }
}

fn class(color: usize) -> String {
    let dashed = if color >= COLORS { " dashed" } else { "" };
    format!("c{}{dashed}", color % COLORS)
}

/// Every n-th point, and the last.
fn thinned(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let step = points.len().div_ceil(MOST_POINTS).max(1);
    let mut kept: Vec<(f64, f64)> = points.iter().step_by(step).copied().collect();
    if step > 1 {
        kept.extend(points.last());
    }
    kept
}
