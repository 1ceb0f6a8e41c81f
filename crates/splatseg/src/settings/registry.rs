//! Every setting, and what uses it.

use super::{MethodName, RunSettings, SegmenterName, TrackerName};
use splatseg_dataset::DatasetSettings;
use splatseg_models::fastsam::FastSamPredictorSettings;
use splatseg_segmenter::GraphSettings;
use splatseg_settings::{Allowed, Choice, Field, Section};
use splatseg_simulators::{OracleSettings, SimTrackerSettings};
use splatseg_tracking::{
    FastSamBaselineSettings, FastSamSplatSettings, FastSpamBaselineSettings, Sam2BaselineSettings, Sam2SplatSettings,
    Sam2TrackerSettings,
};
use std::fmt;

/// A setting, and the choices that it needs.
#[derive(Clone, Debug)]
pub struct Entry {
    /// The setting.
    pub field: Field,
    /// The choices that it needs, all of them; empty for settings that are always used.
    pub needs: Vec<Need>,
}

/// A choice that a setting needs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Need {
    /// The setting that makes the choice, e.g. `method`.
    pub key: &'static str,
    /// The values of which it needs one.
    pub values: Vec<&'static str>,
}

impl fmt::Display for Need {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{} = {}", self.key, self.values.join(" or "))
    }
}

/// The methods that use a tracker.
const METHODS_WITH_TRACKER: [&str; 2] = ["sam2", "sam2-splat"];

/// Every setting, in the order of the documentation.
pub fn entries() -> Vec<Entry> {
    let mut registry = Registry::default();
    registry.add(vec![choice::<MethodName>("method", "The method.")], &[]);
    registry.add(vec![choice::<SegmenterName>("segmenter", "The segmenter whose masks the method uses.")], &[]);
    registry.add(RunSettings::fields(), &[]);
    registry.add(DatasetSettings::fields(), &[]);
    for (method, fields) in [
        ("fastsam-splat", FastSamSplatSettings::fields()),
        ("fastsam", FastSamBaselineSettings::fields()),
        ("fastspam", FastSpamBaselineSettings::fields()),
        ("sam2", Sam2BaselineSettings::fields()),
        ("sam2-splat", Sam2SplatSettings::fields()),
    ] {
        registry.add(fields, &[("method", &[method])]);
    }
    let tracked = ("method", &METHODS_WITH_TRACKER[..]);
    registry
        .add(vec![choice::<TrackerName>("tracker", "The tracker of the methods `sam2` and `sam2-splat`.")], &[tracked]);
    let with_sam2 = [tracked, ("tracker", &["sam2"][..])];
    let weights = "Checkpoint of SAM 2.1: Meta's `sam2.1_hiera_*.pt` as published, or a `.safetensors`.";
    registry.add(vec![file("tracker_weights", weights)], &with_sam2);
    registry.add(Sam2TrackerSettings::fields(), &with_sam2);
    registry.add(SimTrackerSettings::fields(), &[tracked, ("tracker", &["sim"])]);

    let with = |segmenter: &'static [&'static str]| [("segmenter", segmenter)];
    registry.add(GraphSettings::fields(), &with(&["graph"]));
    let weights = "Checkpoint of FastSAM: the published `.pt`, or a `.safetensors`.";
    registry.add(vec![file("weights", weights)], &with(&["fastsam"]));
    registry.add(FastSamPredictorSettings::fields(), &with(&["fastsam"]));
    let masks = "Folder of precomputed masks: `<frame>.png` with an id per pixel, or `<frame>.json` with COCO masks.";
    registry.add(vec![file("masks", masks)], &with(&["masks"]));
    registry.add(OracleSettings::fields(), &with(&["oracle"]));
    let mut entries = registry.entries;
    // Stable: the top level comes first, and sections stay together.
    let order: Vec<&str> = entries.iter().map(|entry| entry.field.section).collect();
    let place = |entry: &Entry| order.iter().position(|section| *section == entry.field.section);
    entries.sort_by_key(|entry| (!entry.field.section.is_empty(), place(entry)));
    entries
}

/// The help of a setting, with its default.
pub fn describe(entry: &Entry) -> String {
    let default = entry.field.default.as_ref().map(|default| format!(" [default: {}]", default.trim_matches('"')));
    format!("{}{}", entry.field.help, default.unwrap_or_default())
}

#[derive(Default)]
struct Registry {
    entries: Vec<Entry>,
}

impl Registry {
    /// Adds settings that need the choices `needs`. A setting that several methods share is one entry.
    fn add(&mut self, fields: Vec<Field>, needs: &[(&'static str, &[&'static str])]) {
        for field in fields {
            let known = self
                .entries
                .iter_mut()
                .find(|entry| entry.field.section == field.section && entry.field.name == field.name);
            if let Some(known) = known {
                for (need, (_, values)) in known.needs.iter_mut().zip(needs) {
                    need.values.extend_from_slice(values);
                }
                continue;
            }
            let mut needs: Vec<Need> =
                needs.iter().map(|(key, values)| Need { key, values: values.to_vec() }).collect();
            needs.extend(
                field
                    .only
                    .and_then(|only| only.split_once(" = "))
                    .map(|(key, value)| Need { key, values: vec![value] }),
            );
            self.entries.push(Entry { field, needs });
        }
    }
}

fn choice<T: Choice + Default>(name: &'static str, help: &str) -> Field {
    let default = Some(format!("\"{}\"", T::default().name()));
    Field {
        section: "",
        name,
        default,
        allowed: Allowed::Names(T::NAMES),
        whole: false,
        is_text_of: |_| true,
        help: help.to_owned(),
        only: None,
    }
}

fn file(name: &'static str, help: &str) -> Field {
    Field {
        section: "",
        name,
        default: None,
        allowed: Allowed::Text("a path"),
        whole: false,
        is_text_of: |_| true,
        help: help.to_owned(),
        only: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn keys_are_unique_and_needs_name_choices() {
        let entries = entries();
        let keys: BTreeSet<String> = entries.iter().map(|entry| entry.field.key()).collect();
        assert_eq!(keys.len(), entries.len());
        for entry in &entries {
            assert!(!entry.field.help.is_empty());
            for need in &entry.needs {
                let chooser = entries.iter().find(|other| other.field.key() == need.key).unwrap();
                let Allowed::Names(names) = chooser.field.allowed else { panic!("{need}") };
                assert!(need.values.iter().all(|value| names.contains(value)), "{need}");
            }
        }
        let area = entries.iter().find(|entry| entry.field.name == "min_segment_area").unwrap();
        assert_eq!(area.needs[0].values.len(), 5);
    }
}
