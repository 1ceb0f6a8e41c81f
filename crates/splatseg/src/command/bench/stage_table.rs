//! Where the time of each method went, as a table.

use super::Results;
use super::rows::Finished;
use splatseg_tracking::StageTimes;

/// Mean milliseconds per frame, over all results of a variant.
#[derive(Clone, Debug, PartialEq)]
pub struct StageTable {
    /// Names of the stages that any method has, in the order of the methods.
    pub stages: Vec<&'static str>,
    /// The variant's name, then a time for each stage, and all but the segmenter together.
    pub rows: Vec<(String, Vec<f64>)>,
}

impl StageTable {
    /// The title of the table.
    pub const TITLE: &str = "Time of each stage, milliseconds per frame";
    /// The last column: what a method costs beside its segmenter.
    pub const TOTAL: &str = "all but the segmenter";

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
        let row = |(label, times): (String, Vec<f64>)| {
            // The first stage is the segmenter's.
            let total = times[1..].iter().sum();
            (label, used.iter().map(|stage| times[*stage]).chain([total]).collect())
        };
        Self { stages: used.iter().map(|stage| names[*stage]).collect(), rows: all.into_iter().map(row).collect() }
    }

    /// The heading of each column after the first.
    pub fn columns(&self) -> impl Iterator<Item = &str> {
        self.stages.iter().copied().chain([Self::TOTAL])
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
