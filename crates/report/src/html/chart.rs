//! Charts as SVG, with a legend in HTML.

use super::axes::{Axes, HEIGHT, WIDTH, tenths};
use maud::{Markup, html};

/// Number of colours in the page's style sheet: enough for the stages of a method.
pub(super) const COLORS: usize = 10;
/// Curves with at most this many points show them as dots.
const MAX_DOTS: usize = 12;
/// Longer curves are downsampled to about this many points.
const MAX_POINTS: usize = 160;

/// A named curve, or a named set of dots.
#[derive(Clone, Debug)]
pub(super) struct Curve {
    /// Its name in the legend.
    pub label: String,
    /// Index of its colour; after the last colour, they repeat with dashed lines.
    pub color: usize,
    /// Its points, in the units of the axes.
    pub points: Vec<(f64, f64)>,
    /// The tooltip of each point; may be shorter than `points`.
    pub notes: Vec<String>,
}

/// How points are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Style {
    /// Joined by lines.
    Lines,
    /// As areas, stacked.
    Stack,
    /// As dots, with the diagonal where both numbers are equal.
    Scatter,
}

/// A chart.
#[derive(Clone, Debug)]
pub(super) struct Chart {
    /// The title.
    pub title: String,
    /// Its axes.
    pub axes: Axes,
    /// The curves.
    pub curves: Vec<Curve>,
    /// The style of all curves.
    pub style: Style,
}

impl Chart {
    /// The chart as HTML.
    pub(super) fn markup(&self) -> Markup {
        html! {
            figure class="chart" {
                figcaption { (self.title) }
                svg viewBox={ "0 0 " (WIDTH) " " (HEIGHT) } role="img" aria-label=(self.title) {
                    (self.axes.markup())
                    (self.drawing())
                }
                ul class="legend" {
                    @for curve in &self.curves {
                        li { span class={ "swatch " (class(curve.color)) } {} (curve.label) }
                    }
                }
            }
        }
    }

    fn drawing(&self) -> Markup {
        match self.style {
            Style::Stack => self.stack(),
            Style::Lines => html! { @for curve in &self.curves { (self.line(curve)) } },
            Style::Scatter => html! {
                path class="diagonal" d=(self.path(&[(0.0, 0.0), (self.axes.y_end, self.axes.y_end)])) {}
                @for curve in &self.curves { (self.dots(curve)) }
            },
        }
    }

    fn line(&self, curve: &Curve) -> Markup {
        html! {
            @if curve.points.len() > 1 {
                path class={ "curve " (class(curve.color)) } d=(self.path(&downsampled(&curve.points))) {}
            }
            @if curve.points.len() <= MAX_DOTS { (self.dots(curve)) }
        }
    }

    fn dots(&self, curve: &Curve) -> Markup {
        html! {
            @for (index, (x, y)) in curve.points.iter().enumerate() {
                circle class={ "dot " (class(curve.color)) } cx=(tenths(self.axes.x(*x))) cy=(tenths(self.axes.y(*y))) r="4" {
                    title {
                        (curve.label) ": "
                        @match curve.notes.get(index) {
                            Some(note) => { (note) }
                            None => { (format_args!("{y:.2}")) }
                        }
                    }
                }
            }
        }
    }

    /// Stacks each curve on top of the previous ones. All curves have points at the same x.
    fn stack(&self) -> Markup {
        let count = self.curves.iter().map(|curve| curve.points.len()).min().unwrap_or(0);
        let mut below = vec![0.0; count];
        let mut areas = Vec::new();
        for curve in &self.curves {
            let above: Vec<f64> = below.iter().zip(&curve.points).map(|(below, (_, value))| below + value).collect();
            let at = |heights: &[f64]| -> Vec<(f64, f64)> {
                downsampled(&curve.points.iter().zip(heights).map(|((x, _), height)| (*x, *height)).collect::<Vec<_>>())
            };
            let outline: Vec<(f64, f64)> = at(&above).into_iter().chain(at(&below).into_iter().rev()).collect();
            areas.push((curve, outline));
            below = above;
        }
        html! {
            @for (curve, outline) in areas.iter().filter(|(_, outline)| !outline.is_empty()) {
                path class={ "area " (class(curve.color)) } d={ (self.path(outline)) " Z" } { title { (curve.label) } }
            }
        }
    }

    /// The points as the data of an SVG path.
    fn path(&self, points: &[(f64, f64)]) -> String {
        let points = points.iter().map(|(x, y)| format!("{:.1} {:.1}", self.axes.x(*x), self.axes.y(*y)));
        format!("M{}", points.collect::<Vec<_>>().join(" L"))
    }
}

fn class(color: usize) -> String {
    let dashed = if color >= COLORS { " dashed" } else { "" };
    format!("c{}{dashed}", color % COLORS)
}

/// Every n-th point and the last one.
fn downsampled(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let step = points.len().div_ceil(MAX_POINTS).max(1);
    let mut kept: Vec<(f64, f64)> = points.iter().step_by(step).copied().collect();
    if step > 1 {
        kept.extend(points.last());
    }
    kept
}
