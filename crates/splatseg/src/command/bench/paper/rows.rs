//! The rows of the paper's tables, as variants of a benchmark.

use crate::command::bench::plan::Variant;
use crate::settings::MethodName;
use splatseg_report::paper::{FEATURE_DIMS, PaperTable, SCANNET_MV};

/// A row of the paper's tables, and the variant that measures it.
#[derive(Clone, Debug)]
pub struct PlannedRow {
    /// Its table.
    pub table: PaperTable,
    /// Its name there.
    pub name: String,
    /// What it runs.
    pub variant: Variant,
    /// The paper's scores, see [`splatseg_report::paper::PaperRow::published`].
    pub published: [Option<f64>; 8],
}

impl PlannedRow {
    /// Whether the method needs a segmenter; otherwise ground truth prompts it.
    pub fn needs_segmenter(&self) -> bool {
        !self.variant.changes.iter().any(|change| change == "prompts=ground-truth")
    }

    /// Whether the method needs a tracker.
    pub fn needs_tracker(&self) -> bool {
        matches!(self.variant.method, MethodName::Sam2 | MethodName::Sam2Splat)
    }
}

/// All rows, table by table.
pub fn all() -> Vec<PlannedRow> {
    let mut rows: Vec<PlannedRow> = SCANNET_MV
        .iter()
        .map(|(name, cells)| {
            let (method, changes): (_, &[&str]) = of_name(name);
            row(PaperTable::Methods, name, (method, changes), cells.map(Some))
        })
        .collect();
    rows.extend(FEATURE_DIMS.map(|(dims, vsq, stq)| {
        let published = [None, None, None, None, Some(vsq), Some(stq), None, None];
        let change = format!("memory.feature_dim={dims}");
        row(PaperTable::FeatureDims, &format!("D = {dims}"), (MethodName::FastsamSplat, &[&change]), published)
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

/// What runs under a name of the paper's main table.
fn of_name(name: &str) -> (MethodName, &'static [&'static str]) {
    const GROUND_TRUTH: &[&str] = &["prompts=ground-truth"];
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

fn row(
    table: PaperTable,
    name: &str,
    (method, changes): (MethodName, &[&str]),
    published: [Option<f64>; 8],
) -> PlannedRow {
    let has_memory = matches!(method, MethodName::FastsamSplat | MethodName::Sam2Splat);
    // The paper's rows use the paper's memory.
    let memory = has_memory.then_some("memory.kind=features");
    let changes = memory.iter().chain(changes).map(|change| (*change).to_owned()).collect();
    PlannedRow { table, name: name.to_owned(), variant: Variant { method, changes }, published }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_is_a_method_with_settings_that_exist() {
        let rows = all();
        assert_eq!(rows.len(), 7 + 5 + 5 + 3);
        for row in &rows {
            let mut layers = crate::settings::SettingsLayers::default();
            row.variant.changes.iter().for_each(|change| layers.add_assignment(change).unwrap());
            layers.add("method", row.variant.method.name()).unwrap();
            layers.resolve_shared().unwrap_or_else(|error| panic!("{}: {error}", row.name));
            assert!(layers.unused().is_empty(), "{}: {:?}", row.name, layers.unused());
        }
        let main: Vec<&str> = rows[..7].iter().map(|row| row.variant.method.name()).collect();
        let expected = ["fastsam", "fastspam", "sam2", "sam2", "fastsam-splat", "sam2-splat", "sam2-splat"];
        assert_eq!(main, expected);
    }
}
