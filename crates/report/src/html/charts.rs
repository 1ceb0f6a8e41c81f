//! The charts of the page.

use super::ablations::ablations;
use super::axes::{Axes, XAxis, round_up};
use super::chart::{Chart, Curve, Style};
use crate::{Benchmark, Measurement, RunDrawings, ScoreTable};
use maud::Markup;
use splatseg_metrics::{Scores, WindowLength};

/// Maximum number of dots of one method in a scatter plot.
const MAX_DOTS_OF_CURVE: usize = 1000;
/// Maximum number of dots in a scatter plot.
const MAX_DOTS: usize = 4000;

/// Charts over all scenes: VSQ^k against k, each ablation, and every method against the first.
pub(super) fn comparison(benchmark: &Benchmark) -> Vec<Markup> {
    let table = ScoreTable::over_all_scenes(benchmark, benchmark.protocol);
    let mut charts = vec![vsq_by_window_length(benchmark, &table)];
    charts.extend(ablations(benchmark, &table));
    if benchmark.variants.len() > 1 {
        charts.push(against_first(benchmark, "VSQ", |scores| scores.vsq));
        charts.push(against_first(benchmark, "STQ", |scores| scores.stq));
    }
    charts.iter().map(Chart::markup).collect()
}

/// Charts of runs on one scene: the number of Gaussians and the time of each stage, over the frames.
pub(super) fn of_runs(benchmark: &Benchmark, runs: &[&RunDrawings]) -> Vec<Markup> {
    let mut charts: Vec<Chart> = gaussians(benchmark, runs).into_iter().collect();
    charts.extend(runs.iter().map(|run| stage_times(benchmark, run)));
    charts.iter().map(Chart::markup).collect()
}

fn vsq_by_window_length(benchmark: &Benchmark, table: &ScoreTable) -> Chart {
    let lengths = WindowLength::ALL.map(|length| length.frames() as f64);
    let curves: Vec<Curve> = (0..benchmark.variants.len())
        .map(|variant| {
            let cells = lengths.iter().zip(&table.rows[variant].cells);
            let known = || cells.clone().filter_map(|(length, cell)| cell.map(|cell| (*length, cell)));
            Curve {
                label: benchmark.variants[variant].label(),
                color: variant,
                points: known().map(|(length, cell)| (length, cell.mean)).collect(),
                notes: known().map(|(length, cell)| format!("k = {length}: {}", cell.text())).collect(),
            }
        })
        .collect();
    Chart {
        title: "VSQ by window length".to_owned(),
        axes: Axes {
            x: XAxis::Values(lengths.to_vec()),
            x_label: "window length k, frames".to_owned(),
            y_end: end_of_axis(&curves),
            y_label: "VSQ for k, percent".to_owned(),
        },
        curves,
        style: Style::Lines,
    }
}

/// Scenes and seeds as dots: the first method's score on the horizontal axis, another's on the vertical one. If there
/// are too many results, every n-th is drawn.
fn against_first(benchmark: &Benchmark, name: &str, score: impl Fn(&Scores) -> Option<f64>) -> Chart {
    let score = |measurement: &Measurement| score(&measurement.score(benchmark.protocol).scores());
    let results = benchmark.scenes.len() * benchmark.seeds.len();
    let others = benchmark.variants.len() - 1;
    let step = results.div_ceil((MAX_DOTS / others.max(1)).clamp(1, MAX_DOTS_OF_CURVE)).max(1);
    let mut curves = Vec::new();
    for variant in 1..benchmark.variants.len() {
        let (mut points, mut notes) = (Vec::new(), Vec::new());
        for measurement in benchmark.of_variant(variant).into_iter().step_by(step) {
            let first = benchmark.of(measurement.scene, 0).iter().find(|first| first.seed == measurement.seed);
            if let Some((x, y)) = first.and_then(&score).zip(score(measurement)) {
                points.push((x, y));
                let scene = &benchmark.scenes[measurement.scene];
                notes.push(format!("{scene}, seed {}: {y:.2} against {x:.2}", measurement.seed));
            }
        }
        curves.push(Curve { label: benchmark.variants[variant].label(), color: variant, points, notes });
    }
    let largest_x = curves.iter().flat_map(|curve| &curve.points).map(|(x, _)| *x).fold(0.0, f64::max);
    let end = end_of_axis(&curves).max(round_up(largest_x));
    let first = benchmark.variants[0].label();
    Chart {
        title: match step {
            1 => format!("{name} of each video, against {first}"),
            step => format!("{name} of one result in {step}, against {first}"),
        },
        axes: Axes {
            x: XAxis::Range(end),
            x_label: format!("{name} of {first}"),
            y_end: end,
            y_label: format!("{name}; above the line is better"),
        },
        curves,
        style: Style::Scatter,
    }
}

fn gaussians(benchmark: &Benchmark, runs: &[&RunDrawings]) -> Option<Chart> {
    let with_memory = runs.iter().filter(|run| !run.series.gaussians.is_empty());
    let curves: Vec<Curve> = with_memory
        .map(|run| Curve {
            label: benchmark.variants[run.variant].label(),
            color: run.variant,
            points: numbered(run.series.gaussians.iter().map(|count| *count as f64)),
            notes: Vec::new(),
        })
        .collect();
    (!curves.is_empty()).then(|| Chart {
        title: "Gaussians in the memory".to_owned(),
        axes: over_frames(&curves, end_of_axis(&curves), "Gaussians"),
        curves,
        style: Style::Lines,
    })
}

fn stage_times(benchmark: &Benchmark, run: &RunDrawings) -> Chart {
    let stages = run.series.stage_ms.iter().enumerate();
    let used = stages.filter(|(_, (_, times))| times.iter().any(|time| *time > 0.0));
    let curves: Vec<Curve> = used
        .map(|(index, (name, times))| Curve {
            label: name.replace('_', " "),
            color: index,
            points: numbered(times.iter().map(|time| f64::from(*time))),
            notes: Vec::new(),
        })
        .collect();
    let frames = curves.iter().map(|curve| curve.points.len()).min().unwrap_or(0);
    let totals = (0..frames).map(|frame| curves.iter().map(|curve| curve.points[frame].1).sum::<f64>());
    let end = round_up(totals.fold(0.0, f64::max));
    Chart {
        title: format!("Time of each stage, {}", benchmark.variants[run.variant].label()),
        axes: over_frames(&curves, end, "milliseconds"),
        curves,
        style: Style::Stack,
    }
}

fn over_frames(curves: &[Curve], end: f64, y_label: &str) -> Axes {
    let frames = curves.iter().map(|curve| curve.points.len()).max().unwrap_or(0);
    Axes {
        x: XAxis::Range(frames.saturating_sub(1).max(1) as f64),
        x_label: "frame".to_owned(),
        y_end: end,
        y_label: y_label.to_owned(),
    }
}

fn numbered(values: impl Iterator<Item = f64>) -> Vec<(f64, f64)> {
    values.enumerate().map(|(index, value)| (index as f64, value)).collect()
}

/// Axes for percentages over names, e.g. the values of a setting.
pub(super) fn curves_by_name(names: Vec<String>, x_label: &str, y_end: f64) -> Axes {
    Axes { x: XAxis::Names(names), x_label: x_label.to_owned(), y_end, y_label: "percent".to_owned() }
}

/// End of a vertical axis for these curves.
pub(super) fn end_of_axis(curves: &[Curve]) -> f64 {
    round_up(curves.iter().flat_map(|curve| &curve.points).map(|(_, y)| *y).fold(0.0, f64::max))
}
