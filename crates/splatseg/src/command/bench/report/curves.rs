//! The charts of the report.

use super::axes::{Along, Axes, round_up};
use super::chart::{Chart, Curve, Style};
use crate::command::bench::Results;
use crate::command::bench::rows::Finished;
use crate::command::bench::tables::{Table, over_all_scenes};
use splatseg_metrics::{Scores, WindowLength};

/// Of all scenes: VSQ^k over k, every method against the first, and each ablation.
pub fn comparison(results: &Results) -> Vec<String> {
    let table = over_all_scenes(results, results.protocol);
    let mut charts = vec![vsq_over_k(results, &table)];
    charts.extend(ablations(results, &table));
    if results.plan.variants.len() > 1 {
        charts.push(against_first(results, "VSQ", |scores| scores.vsq));
        charts.push(against_first(results, "STQ", |scores| scores.stq));
    }
    charts.iter().map(Chart::html).collect()
}

/// Of one scene: Gaussians, and where time went, over its frames, with the first seed.
pub fn of_scene(results: &Results, scene: usize) -> Vec<String> {
    let first: Vec<&Finished> =
        (0..results.plan.variants.len()).filter_map(|variant| results.of(scene, variant).next()).collect();
    let mut charts: Vec<Chart> = gaussians(results, &first).into_iter().collect();
    charts.extend(first.iter().map(|finished| stage_times(results, finished)));
    charts.iter().map(Chart::html).collect()
}

fn vsq_over_k(results: &Results, table: &Table) -> Chart {
    let lengths = WindowLength::ALL.map(|length| length.frames() as f64);
    let curves: Vec<Curve> = (0..results.plan.variants.len())
        .map(|variant| {
            let cells = table.rows[variant].cells;
            let known =
                || lengths.iter().zip(&cells[..4]).filter_map(|(length, cell)| cell.map(|cell| (*length, cell)));
            Curve {
                label: results.plan.variants[variant].label(),
                color: variant,
                points: known().map(|(length, cell)| (length, cell.mean)).collect(),
                notes: known().map(|(length, cell)| format!("k = {length}: {}", cell.text())).collect(),
            }
        })
        .collect();
    Chart {
        title: "VSQ over the window length k".to_owned(),
        axes: Axes {
            along: Along::Places(lengths.to_vec()),
            along_label: "k, frames".to_owned(),
            up: (0.0, highest(&curves)),
            up_label: "VSQ of k, percent".to_owned(),
        },
        curves,
        style: Style::Lines,
    }
}

/// Every scene and seed as a dot: the first method's score across, another's up.
fn against_first(results: &Results, name: &str, score: impl Fn(&Scores) -> Option<f64>) -> Chart {
    let plan = results.plan;
    let score = |finished: &Finished| score(&finished.result.score(results.protocol).scores());
    let mut curves = Vec::new();
    for variant in 1..plan.variants.len() {
        let (mut points, mut notes) = (Vec::new(), Vec::new());
        for finished in results.finished.iter().filter(|finished| finished.variant == variant) {
            let first = results.of(finished.scene, 0).find(|first| first.seed == finished.seed);
            if let Some((across, up)) = first.and_then(&score).zip(score(finished)) {
                points.push((across, up));
                let scene = &plan.scenes[finished.scene].name;
                notes.push(format!("{scene}, seed {}: {up:.2} against {across:.2}", finished.seed));
            }
        }
        curves.push(Curve { label: plan.variants[variant].label(), color: variant, points, notes });
    }
    let across = curves.iter().flat_map(|curve| &curve.points).map(|(across, _)| *across).fold(0.0, f64::max);
    let end = highest(&curves).max(round_up(across));
    Chart {
        title: format!("{name} of each video, against {}", plan.variants[0].label()),
        axes: Axes {
            along: Along::Numbers(0.0, end),
            along_label: format!("{name} of {}", plan.variants[0].label()),
            up: (0.0, end),
            up_label: format!("{name}, above the line: better"),
        },
        curves,
        style: Style::DotsAndDiagonal,
    }
}

/// VSQ and STQ over the values of each ablated setting.
fn ablations(results: &Results, table: &Table) -> Vec<Chart> {
    let mut groups: Vec<(String, Vec<(String, usize)>)> = Vec::new();
    for (place, variant) in results.plan.variants.iter().enumerate() {
        // Several settings at once have no axis.
        let [change] = variant.changes.as_slice() else { continue };
        if let Some((key, value)) = change.split_once('=') {
            let title = format!("{} over {key}", variant.method.name());
            match groups.iter_mut().find(|(other, _)| *other == title) {
                Some((_, values)) => values.push((value.to_owned(), place)),
                None => groups.push((title, vec![(value.to_owned(), place)])),
            }
        }
    }
    groups
        .into_iter()
        .map(|(title, values)| {
            let curve = |label: &str, color: usize, column: usize| {
                let known = values.iter().enumerate().filter_map(|(place, (value, variant))| {
                    table.rows[*variant].cells[column].map(|cell| (place as f64, cell, value))
                });
                let (points, notes) =
                    known.map(|(x, cell, value)| ((x, cell.mean), format!("{value}: {}", cell.text()))).unzip();
                Curve { label: label.to_owned(), color, points, notes }
            };
            let curves = vec![curve("VSQ", 0, 4), curve("STQ", 1, 5)];
            Chart {
                axes: Axes {
                    along: Along::Names(values.iter().map(|(value, _)| value.clone()).collect()),
                    along_label: title.split(" over ").last().unwrap_or_default().to_owned(),
                    up: (0.0, highest(&curves)),
                    up_label: "percent".to_owned(),
                },
                title,
                curves,
                style: Style::Lines,
            }
        })
        .collect()
}

fn gaussians(results: &Results, first: &[&Finished]) -> Option<Chart> {
    let with_memory = first.iter().filter(|finished| !finished.result.series.gaussians.is_empty());
    let curves: Vec<Curve> = with_memory
        .map(|finished| Curve {
            label: results.plan.variants[finished.variant].label(),
            color: finished.variant,
            points: numbered(finished.result.series.gaussians.iter().map(|count| *count as f64)),
            notes: Vec::new(),
        })
        .collect();
    (!curves.is_empty()).then(|| Chart {
        title: "Gaussians in the memory".to_owned(),
        axes: over_frames(&curves, highest(&curves), "Gaussians"),
        curves,
        style: Style::Lines,
    })
}

fn stage_times(results: &Results, finished: &Finished) -> Chart {
    let stages = finished.result.series.stage_ms.iter().enumerate();
    let used = stages.filter(|(_, (_, values))| values.iter().any(|value| *value > 0.0));
    let curves: Vec<Curve> = used
        .map(|(place, (name, values))| Curve {
            label: name.replace('_', " "),
            color: place,
            points: numbered(values.iter().map(|value| f64::from(*value))),
            notes: Vec::new(),
        })
        .collect();
    let frames = curves.first().map_or(0, |curve| curve.points.len());
    let totals = (0..frames).map(|frame| curves.iter().map(|curve| curve.points[frame].1).sum::<f64>());
    let end = round_up(totals.fold(0.0, f64::max));
    Chart {
        title: format!("Time of each stage, {}", results.plan.variants[finished.variant].label()),
        axes: over_frames(&curves, end, "milliseconds"),
        curves,
        style: Style::Stack,
    }
}

fn over_frames(curves: &[Curve], end: f64, up_label: &str) -> Axes {
    let frames = curves.iter().map(|curve| curve.points.len()).max().unwrap_or(0);
    Axes {
        along: Along::Numbers(0.0, frames.saturating_sub(1).max(1) as f64),
        along_label: "frame".to_owned(),
        up: (0.0, end),
        up_label: up_label.to_owned(),
    }
}

fn numbered(values: impl Iterator<Item = f64>) -> Vec<(f64, f64)> {
    values.enumerate().map(|(place, value)| (place as f64, value)).collect()
}

/// Where a vertical axis for these curves ends.
fn highest(curves: &[Curve]) -> f64 {
    round_up(curves.iter().flat_map(|curve| &curve.points).map(|(_, up)| *up).fold(0.0, f64::max))
}
