//! The rows of the paper's tables, as variants of a benchmark.

use super::inputs::Input;
use super::other_trackers::OtherTracker;
use crate::bench::plan::Variant;
use splatseg::settings::MethodName;
use splatseg_report::paper::{CATEGORIES, CLICKS, CurvePoint, FEATURE_DIMS, MVPD, PaperTable, SCANNET_MV, vsq_columns};

/// Setting of every row, for no departure from the paper.
const PAPER_SETTINGS: &str = "method_preset=paper";
/// Setting that prompts a tracker from ground truth.
const GROUND_TRUTH: &str = "prompts=ground-truth";
/// The categories of re-prompting.
const REPROMPTS: [&str; 3] = ["not_tracked", "incorrect_track", "duplicated_track"];

/// A row of the paper's tables, and the variant that measures it.
#[derive(Clone, Debug)]
pub struct PlannedRow {
    /// The row's table.
    pub table: PaperTable,
    /// The row's name in the table.
    pub name: String,
    /// The variant to run; `None` for a method that is not ours.
    pub variant: Option<Variant>,
    /// The paper's scores, see [`splatseg_report::paper::PaperRow::published`].
    pub published: [Option<f64>; 8],
    /// The row's point in a curve, see [`splatseg_report::paper::PaperRow::point`].
    pub point: Option<CurvePoint>,
    /// The tracker, if it is not the paper's.
    pub tracker: Option<OtherTracker>,
}

impl PlannedRow {
    /// Returns true if the row's tracker is prompted with ground truth.
    pub fn is_prompted(&self) -> bool {
        self.variant.as_ref().is_some_and(|variant| variant.changes.iter().any(|change| change == GROUND_TRUTH))
    }

    /// Returns the inputs of the row: the data set, and the weights of the networks that the method uses.
    pub fn needs(&self) -> Vec<Input> {
        let Some(variant) = &self.variant else { return Vec::new() };
        let data = if self.table.is_of_mvpd() { Input::Mvpd } else { Input::Scenes };
        let tracked = matches!(variant.method, MethodName::Sam2 | MethodName::Sam2Splat);
        let networks = [(!self.is_prompted(), Input::FastSam), (tracked && self.tracker.is_none(), Input::Sam2)];
        [data].into_iter().chain(networks.into_iter().filter(|(used, _)| *used).map(|(_, input)| input)).collect()
    }
}

/// Returns all rows, table by table, and the optional rows of trackers that the paper does not use.
pub fn all(trackers: &[OtherTracker]) -> Vec<PlannedRow> {
    let mut rows = of_the_paper();
    rows.extend(trackers.iter().flat_map(optional));
    rows
}

/// Returns the rows of a tracker that the paper does not use.
fn optional(tracker: &OtherTracker) -> Vec<PlannedRow> {
    let tracked = ["SAM2, detections", "SAM2, ground truth", "SAM2-Splat, detections", "SAM2-Splat, ground truth"];
    let on_mvpd = ["SAM2, detections", "SAM2-Splat, detections"];
    let names = tracked.map(|name| (PaperTable::Methods, name)).into_iter();
    let names = names.chain(on_mvpd.map(|name| (PaperTable::Mvpd, name)));
    let row = |(table, name): (PaperTable, &str)| {
        let run = by_name(name).map(|(method, changes)| (method, [changes, tracker.changes()].concat()));
        let row = row(table, &format!("{name}, {}", tracker.name()), run, [None; 8]);
        PlannedRow { tracker: Some(tracker.clone()), ..row }
    };
    names.map(row).collect()
}

fn of_the_paper() -> Vec<PlannedRow> {
    let mut rows: Vec<PlannedRow> =
        SCANNET_MV.iter().map(|(name, cells)| row(PaperTable::Methods, name, by_name(name), cells.map(Some))).collect();
    rows.extend(FEATURE_DIMS.map(|(dims, vsq, stq)| {
        let run = (MethodName::FastsamSplat, vec![format!("memory.feature_dim={dims}")]);
        let point = Some(CurvePoint { curve: "feature dimension D", value: dims });
        let row = row(PaperTable::FeatureDims, &format!("D = {dims}"), Some(run), vsq_and_stq([vsq, stq]));
        PlannedRow { point, ..row }
    }));
    let chosen: [&[&str]; 5] = [&[], &REPROMPTS[..1], &REPROMPTS[1..2], &REPROMPTS[2..], &REPROMPTS];
    rows.extend(CATEGORIES.iter().zip(chosen).map(|((name, vsq, stq), on)| {
        let changes = REPROMPTS.map(|category| format!("reprompt.{category}={}", on.contains(&category)));
        // Without re-prompting, the memory has no effect: the row equals SAM2, which runs anyway.
        let run =
            if on.is_empty() { by_name("SAM2, detections") } else { Some((MethodName::Sam2Splat, changes.to_vec())) };
        row(PaperTable::Categories, name, run, vsq_and_stq([*vsq, *stq]))
    }));
    for (prompts, curve, changes) in [
        ("detections", "clicks, prompted with detections", None),
        ("ground truth", "clicks, prompted with ground truth", Some(GROUND_TRUTH.to_owned())),
    ] {
        rows.extend(CLICKS.map(|(clicks, detections, ground_truth)| {
            let published = if changes.is_none() { detections } else { ground_truth };
            let changes = changes.iter().cloned().chain([format!("reprompt.clicks={clicks}")]);
            let run = (MethodName::Sam2Splat, changes.collect());
            let row = row(PaperTable::Clicks, &format!("{clicks}, {prompts}"), Some(run), vsq_and_stq(published));
            PlannedRow { point: Some(CurvePoint { curve, value: clicks }), ..row }
        }));
    }
    rows.extend(MVPD.iter().map(|(name, cells)| row(PaperTable::Mvpd, name, by_name(name), vsq_columns(cells))));
    // Not in the paper: its SAM 2 could not track that many objects.
    let ours = ["SAM2, detections", "SAM2-Splat, detections"];
    rows.extend(ours.map(|name| row(PaperTable::Mvpd, name, by_name(name), [None; 8])));
    rows
}

/// Returns the method and the settings for a name in the paper's tables of methods, or `None` if it is not ours.
pub fn by_name(name: &str) -> Option<(MethodName, Vec<String>)> {
    let prompted = || vec![GROUND_TRUTH.to_owned()];
    Some(match name {
        "FastSAM" => (MethodName::Fastsam, Vec::new()),
        "FastSPAM" => (MethodName::Fastspam, Vec::new()),
        "SAM2, detections" => (MethodName::Sam2, Vec::new()),
        "SAM2, ground truth" => (MethodName::Sam2, prompted()),
        "FastSAM-Splat" => (MethodName::FastsamSplat, Vec::new()),
        "SAM2-Splat, detections" => (MethodName::Sam2Splat, Vec::new()),
        "SAM2-Splat, ground truth" => (MethodName::Sam2Splat, prompted()),
        _ => return None,
    })
}

fn vsq_and_stq([vsq, stq]: [f64; 2]) -> [Option<f64>; 8] {
    [None, None, None, None, Some(vsq), Some(stq), None, None]
}

fn row(
    table: PaperTable,
    name: &str,
    run: Option<(MethodName, Vec<String>)>,
    published: [Option<f64>; 8],
) -> PlannedRow {
    let variant = run.map(|(method, changes)| {
        let changes = std::iter::once(PAPER_SETTINGS.to_owned()).chain(changes).collect();
        Variant { method, changes }
    });
    PlannedRow { table, name: name.to_owned(), variant, published, point: None, tracker: None }
}

#[cfg(test)]
mod tests {
    use super::*;
    use splatseg_models::checkpoint::Architecture;
    use std::path::PathBuf;

    #[test]
    fn every_row_is_a_method_with_settings_that_exist() {
        let edgetam = OtherTracker {
            weights: PathBuf::from("my weights/edgetam.pt"),
            network: Architecture::EdgeTam { width: 48 },
        };
        let rows = all(&[edgetam]);
        // ScanNet-MV, D, categories, clicks with detections and ground truth, MVPd with SAM2 and SAM2-Splat; the four
        // and two rows of EdgeTAM.
        assert_eq!(rows.len(), 7 + 5 + 5 + 6 + 9 + 2 + 4 + 2);
        for row in &rows {
            let Some(variant) = &row.variant else { continue };
            let mut layers = splatseg::settings::SettingsLayers::default();
            variant.changes.iter().for_each(|change| layers.add_assignment(change).unwrap());
            layers.add("method", variant.method.name()).unwrap();
            layers.resolve_shared().unwrap_or_else(|error| panic!("{}: {error}", row.name));
            assert!(layers.unused().is_empty(), "{}: {:?}", row.name, layers.unused());
        }
        let main: Vec<&str> = rows[..7].iter().filter_map(|row| Some(row.variant.as_ref()?.method.name())).collect();
        let expected = ["fastsam", "fastspam", "sam2", "sam2", "fastsam-splat", "sam2-splat", "sam2-splat"];
        assert_eq!(main, expected);
        let of_others = rows.iter().filter(|row| row.variant.is_none()).count();
        assert_eq!(of_others, 6, "Video K-Net, Tube-Link and OV2Seg with two backbones each");
    }

    #[test]
    fn no_re_prompting_is_the_row_of_sam2() {
        let rows = all(&[]);
        let of = |name: &str| rows.iter().find(|row| row.name == name).unwrap();
        assert_eq!(of("none (SAM2)").variant, of("SAM2, detections").variant);
        assert_eq!(of("none (SAM2)").published[4..6], of("SAM2, detections").published[4..6]);
    }

    #[test]
    fn rows_need_the_networks_that_they_use() {
        let trackers =
            [OtherTracker { weights: PathBuf::from("e.pt"), network: Architecture::EfficientTam { width: 192 } }];
        let needs = |name: &str, table| {
            all(&trackers).into_iter().find(|row| row.name == name && row.table == table).unwrap().needs()
        };
        assert_eq!(needs("FastSAM-Splat", PaperTable::Methods), [Input::Scenes, Input::FastSam]);
        assert_eq!(needs("SAM2-Splat, ground truth", PaperTable::Methods), [Input::Scenes, Input::Sam2]);
        assert_eq!(needs("3, ground truth", PaperTable::Clicks), [Input::Scenes, Input::Sam2]);
        assert_eq!(needs("SAM2-Splat, detections", PaperTable::Mvpd), [Input::Mvpd, Input::FastSam, Input::Sam2]);
        assert_eq!(needs("OV2Seg, Swin-base", PaperTable::Mvpd), []);
        assert_eq!(needs("SAM2-Splat, detections, e", PaperTable::Mvpd), [Input::Mvpd, Input::FastSam]);
        assert_eq!(needs("SAM2, ground truth, e", PaperTable::Methods), [Input::Scenes]);
    }
}
