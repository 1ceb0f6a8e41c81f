//! Where the time of each method went, as a table.

use super::Results;
use super::rows::Finished;
use splatseg_tracking::StageTimes;

/// Mean milliseconds per frame, over all results of a variant.
#[derive(Clone, Debug, PartialEq)]
pub struct StageTable {
    /// Names of the stages that any method has, in the order of the methods.
    pub stages: Vec<&'static str>,
    /// Headings of the sums after the stages.
    pub totals: Vec<&'static str>,
    /// The variant's name, then a time for each stage and each sum.
    pub rows: Vec<(String, Vec<f64>)>,
}

/// What a method costs beside its segmenter.
const BESIDE_SEGMENTER: &str = "all but the segmenter";
/// What a memory and its comparison with a tracker cost beside both networks, but for re-prompts.
const BESIDE_NETWORKS: &str = "all but segmenter and tracker";

impl StageTable {
    /// The title of the table.
    pub const TITLE: &str = "Time of each stage, milliseconds per frame";

    /// The table of a benchmark. Stages that take no time in any method are left out.
    pub fn new(results: &Results) -> Self {
        let names = StageTimes::default().stages().map(|(name, _)| name);
        let all: Vec<(String, Vec<f64>)> = (0..results.plan.variants.len())
            .map(|variant| {
                let finished: Vec<&Finished> =
                    results.finished.iter().filter(|finished| finished.variant == variant).collect();
                let frames: usize = finished.iter().map(|finished| finished.result.frames).sum();
                let mean = |name: &str| {
                    let of = |finished: &&Finished| {
                        finished.result.stage_ms.get(name).copied().unwrap_or(0.0) * finished.result.frames as f64
                    };
                    finished.iter().map(of).sum::<f64>() / frames.max(1) as f64
                };
                (results.plan.variants[variant].label(), names.map(mean).to_vec())
            })
            .collect();
        let used: Vec<usize> =
            (0..names.len()).filter(|stage| all.iter().any(|(_, times)| times[*stage] > 0.0)).collect();
        let stages: Vec<&str> = used.iter().map(|stage| names[*stage]).collect();
        let mut totals = vec![BESIDE_SEGMENTER];
        if stages.contains(&"track") {
            totals.push(BESIDE_NETWORKS);
        }
        let row = |(label, times): (String, Vec<f64>)| {
            // The first stages are the segmenter's and the tracker's.
            let sums = [times[1..].iter().sum(), times[2..].iter().sum()];
            let row = used.iter().map(|stage| times[*stage]).chain(sums.into_iter().take(totals.len()));
            (label, row.collect())
        };
        let rows = all.into_iter().map(row).collect();
        Self { stages, rows, totals }
    }

    /// The heading of each column after the first.
    pub fn columns(&self) -> impl Iterator<Item = &str> {
        self.stages.iter().chain(&self.totals).copied()
    }

    /// As Markdown, with a heading.
    pub fn markdown(&self) -> String {
        let columns: Vec<&str> = self.columns().collect();
        let mut text = format!("## {}\n\n| method | {} |\n|---|", Self::TITLE, columns.join(" | "));
        text.push_str(&"---:|".repeat(columns.len()));
        text.push('\n');
        for (label, times) in &self.rows {
            let cells: Vec<String> = times.iter().map(|time| format!("{time:.2}")).collect();
            text.push_str(&format!("| {} | {} |\n", label.replace('|', "\\|"), cells.join(" | ")));
        }
        text
    }
}
