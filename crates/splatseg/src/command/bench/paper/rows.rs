//! The rows of the paper's tables, as variants of a benchmark.

use super::numbers::{FEATURE_DIMS, SCANNET_MV};
use crate::command::bench::plan::Variant;
use splatseg::settings::MethodName;

/// The paper's tables that a benchmark can measure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PaperTable {
    /// Methods on ScanNet-MV.
    Methods,
    /// Dimensions of the segment-id feature.
    FeatureDims,
    /// Categories of re-prompting.
    Categories,
    /// Clicks for each re-prompted object.
    Clicks,
}

/// A row: what it is called, what it runs, and what the paper found.
#[derive(Clone, Debug)]
pub struct PaperRow {
    /// Its table.
    pub table: PaperTable,
    /// Its name there.
    pub name: String,
    /// What it runs.
    pub variant: Variant,
    /// The paper's scores, percent, in the order of the score table; `None` where the paper's are not at hand.
    pub paper: [Option<f64>; 8],
}

impl PaperTable {
    /// Every table, in the paper's order.
    pub const ALL: [Self; 4] = [Self::Methods, Self::FeatureDims, Self::Categories, Self::Clicks];

    /// Its heading.
    pub fn title(self) -> &'static str {
        match self {
            Self::Methods => "Methods on ScanNet-MV",
            Self::FeatureDims => "Dimension of the segment-id feature (FastSAM-Splat)",
            Self::Categories => "Categories of re-prompting (SAM2-Splat, detections)",
            Self::Clicks => "Clicks per re-prompted object (SAM2-Splat, detections)",
        }
    }
}

impl PaperRow {
    /// Whether a segmenter prompts the method; ground truth does otherwise.
    pub fn needs_segmenter(&self) -> bool {
        !self.variant.changes.iter().any(|change| change == "prompts=ground-truth")
    }

    /// Whether the method has a tracker.
    pub fn needs_tracker(&self) -> bool {
        matches!(self.variant.method, MethodName::Sam2 | MethodName::Sam2Splat)
    }
}

/// All rows, table by table.
pub fn all() -> Vec<PaperRow> {
    let mut rows: Vec<PaperRow> = SCANNET_MV
        .iter()
        .map(|(name, cells)| {
            let (method, changes): (_, &[&str]) = of_name(name);
            row(PaperTable::Methods, name, (method, changes), cells.map(Some))
        })
        .collect();
    rows.extend(FEATURE_DIMS.map(|(dims, vsq, stq)| {
        let paper = [None, None, None, None, Some(vsq), Some(stq), None, None];
        let change = format!("memory.feature_dim={dims}");
        row(PaperTable::FeatureDims, &format!("D = {dims}"), (MethodName::FastsamSplat, &[&change]), paper)
    }));
    let categories = ["not_tracked", "incorrect_track", "duplicated_track"];
    let chosen: [(&str, &[&str]); 5] = [
        ("none", &[]),
        ("not tracked", &categories[..1]),
        ("incorrect track", &categories[1..2]),
        ("duplicated track", &categories[2..]),
        ("all three", &categories),
    ];
    rows.extend(chosen.map(|(name, on)| {
        let changes = categories.map(|category| format!("reprompt.{category}={}", on.contains(&category)));
        let changes = changes.each_ref().map(String::as_str);
        row(PaperTable::Categories, name, (MethodName::Sam2Splat, &changes), [None; 8])
    }));
    rows.extend([1, 3, 5].map(|clicks| {
        let change = format!("reprompt.clicks={clicks}");
        row(PaperTable::Clicks, &clicks.to_string(), (MethodName::Sam2Splat, &[&change]), [None; 8])
    }));
    rows
}

/// What runs under a name of the paper's main table. Where ground truth prompts, masks of a network have no use: the
/// oracle stands in for it.
fn of_name(name: &str) -> (MethodName, &'static [&'static str]) {
    const GROUND_TRUTH: &[&str] = &["prompts=ground-truth", "segmenter=oracle"];
    match name {
        "FastSAM" => (MethodName::Fastsam, &[]),
        "FastSPAM" => (MethodName::Fastspam, &[]),
        "SAM2, detections" => (MethodName::Sam2, &[]),
        "SAM2, ground truth" => (MethodName::Sam2, GROUND_TRUTH),
        "SAM2-Splat, detections" => (MethodName::Sam2Splat, &[]),
        "SAM2-Splat, ground truth" => (MethodName::Sam2Splat, GROUND_TRUTH),
        _ => (MethodName::FastsamSplat, &[]),
    }
}

fn row(table: PaperTable, name: &str, (method, changes): (MethodName, &[&str]), paper: [Option<f64>; 8]) -> PaperRow {
    let has_memory = matches!(method, MethodName::FastsamSplat | MethodName::Sam2Splat);
    // The paper's rows have the paper's memory.
    let memory = has_memory.then_some("memory.kind=features");
    let changes = memory.iter().chain(changes).map(|change| (*change).to_owned()).collect();
    PaperRow { table, name: name.to_owned(), variant: Variant { method, changes }, paper }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_is_a_method_with_settings_that_exist() {
        let rows = all();
        assert_eq!(rows.len(), 7 + 5 + 5 + 3);
        for row in &rows {
            let mut layers = splatseg::settings::SettingsLayers::default();
            row.variant.changes.iter().for_each(|change| layers.add_assignment(change).unwrap());
            layers.resolve().unwrap_or_else(|error| panic!("{}: {error}", row.name));
        }
        let main: Vec<&str> = rows[..7].iter().map(|row| row.variant.method.name()).collect();
        let expected = ["fastsam", "fastspam", "sam2", "sam2", "fastsam-splat", "sam2-splat", "sam2-splat"];
        assert_eq!(main, expected);
    }
}
