//! VSQ and STQ over the values of a setting.

use super::chart::{Chart, Curve, Style};
use super::charts::{curves_by_name, end_of_axis};
use crate::columns::{STQ, VSQ};
use crate::{Benchmark, ScoreTable};

/// The values of a setting that a method was run with; all other settings are equal.
struct Ablation<'a> {
    method: &'a str,
    /// The other changed settings.
    others: Vec<&'a str>,
    setting: &'a str,
    /// The values, each with the index of its variant.
    values: Vec<(&'a str, usize)>,
}

/// A chart for each setting with two values or more.
pub(super) fn ablations(benchmark: &Benchmark, table: &ScoreTable) -> Vec<Chart> {
    let mut ablations: Vec<Ablation> = Vec::new();
    for (index, variant) in benchmark.variants.iter().enumerate() {
        // Changes shared by all variants do not distinguish them.
        let is_shared = |change: &&String| benchmark.variants.iter().all(|other| other.changes.contains(change));
        let changes: Vec<&str> =
            variant.changes.iter().filter(|change| !is_shared(change)).map(String::as_str).collect();
        for change in &changes {
            let Some((setting, value)) = change.split_once('=') else { continue };
            let others: Vec<&str> = changes.iter().filter(|other| *other != change).copied().collect();
            let is_same = |known: &&mut Ablation| {
                (known.method, known.setting, &known.others) == (&variant.method, setting, &others)
            };
            match ablations.iter_mut().find(is_same) {
                Some(known) => known.values.push((value, index)),
                None => {
                    ablations.push(Ablation { method: &variant.method, others, setting, values: vec![(value, index)] });
                }
            }
        }
    }
    ablations.retain(|ablation| ablation.values.len() > 1);
    ablations.iter().map(|ablation| chart(ablation, table)).collect()
}

fn chart(ablation: &Ablation, table: &ScoreTable) -> Chart {
    let curve = |label: &str, color: usize, column: usize| {
        let known = ablation.values.iter().enumerate().filter_map(|(index, (value, variant))| {
            table.rows[*variant].cells[column].map(|cell| (index as f64, cell, value))
        });
        let (points, notes) =
            known.map(|(x, cell, value)| ((x, cell.mean), format!("{value}: {}", cell.text()))).unzip();
        Curve { label: label.to_owned(), color, points, notes }
    };
    let curves = vec![curve("VSQ", 0, VSQ), curve("STQ", 1, STQ)];
    let others: String = ablation.others.iter().map(|other| format!(", {other}")).collect();
    Chart {
        title: format!("{} by {}{others}", ablation.method, ablation.setting),
        axes: curves_by_name(
            ablation.values.iter().map(|(value, _)| (*value).to_owned()).collect(),
            ablation.setting,
            end_of_axis(&curves),
        ),
        curves,
        style: Style::Lines,
    }
}
