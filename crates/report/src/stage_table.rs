//! Time of each method by stage.

use crate::{Benchmark, markdown};

/// The segmenter's stage.
const SEGMENTER_STAGE: &str = "segment";
/// The tracker's stage, without re-prompts.
const TRACKER_STAGE: &str = "track";

/// Mean milliseconds per frame, over all results of a variant.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct StageTable {
    /// The heading of each column after the first: the stages that take time in any method, then sums of stages.
    pub columns: Vec<String>,
    /// The name of a variant, then the time in each column.
    pub rows: Vec<(String, Vec<f64>)>,
}

impl StageTable {
    /// The title of the table.
    pub const TITLE: &str = "Time of each stage, milliseconds per frame";

    /// The table of a benchmark. Stages that take no time in any method are omitted.
    pub fn new(benchmark: &Benchmark) -> Self {
        let stages = &benchmark.stages;
        let all: Vec<(String, Vec<f64>)> = (0..benchmark.variants.len())
            .map(|variant| (benchmark.variants[variant].label(), mean_times(benchmark, variant, stages)))
            .collect();
        let used: Vec<usize> =
            (0..stages.len()).filter(|stage| all.iter().any(|(_, times)| times[*stage] > 0.0)).collect();
        let mut columns: Vec<String> = used.iter().map(|stage| stages[*stage].to_owned()).collect();
        let mut sums: Vec<(&str, &[&str])> = vec![("all but the segmenter", &[SEGMENTER_STAGE])];
        if columns.iter().any(|stage| stage == TRACKER_STAGE) {
            sums.push(("all but segmenter and tracker", &[SEGMENTER_STAGE, TRACKER_STAGE]));
        }
        columns.extend(sums.iter().map(|(heading, _)| (*heading).to_owned()));
        let row = |(label, times): (String, Vec<f64>)| {
            let sum_without = |left_out: &[&str]| -> f64 {
                let kept = stages.iter().zip(&times).filter(|(stage, _)| !left_out.contains(*stage));
                kept.map(|(_, time)| time).sum()
            };
            let sums = sums.iter().map(|(_, left_out)| sum_without(left_out));
            let row = used.iter().map(|stage| times[*stage]).chain(sums).collect();
            (label, row)
        };
        Self { rows: all.into_iter().map(row).collect(), columns }
    }

    /// As Markdown, with a heading.
    pub fn markdown(&self) -> String {
        let columns: Vec<&str> = self.columns.iter().map(String::as_str).collect();
        let mut text = format!("## {}\n\n{}", Self::TITLE, markdown::head("method", &columns));
        for (label, times) in &self.rows {
            let cells: Vec<String> = times.iter().map(|time| format!("{time:.2}")).collect();
            text.push_str(&markdown::row(label, &cells));
        }
        text
    }
}

/// The mean time of each stage per frame, over all results of a variant.
fn mean_times(benchmark: &Benchmark, variant: usize, stages: &[&str]) -> Vec<f64> {
    let measurements = benchmark.of_variant(variant);
    let frames: usize = measurements.iter().map(|measurement| measurement.frames).sum();
    let mean = |stage: &&str| {
        let times = measurements
            .iter()
            .map(|measurement| measurement.stage_ms.get(*stage).copied().unwrap_or(0.0) * measurement.frames as f64);
        times.sum::<f64>() / frames.max(1) as f64
    };
    stages.iter().map(mean).collect()
}
