//! Every setting, and what uses it.

use super::{MethodName, RunSettings, SegmenterName, TrackerName};
use splatseg_dataset::DatasetSettings;
use splatseg_models::fastsam::FastSamPredictorSettings;
use splatseg_segmenter::{AffinitySettings, GraphSettings};
use splatseg_settings::{Allowed, Choice, Field, Section};
use splatseg_simulators::{OracleSettings, SimTrackerSettings};
use splatseg_tracking::{
    FastSamBaselineSettings, FastSamSplatSettings, FastSpamBaselineSettings, Sam2BaselineSettings, Sam2SplatSettings,
    Sam2TrackerSettings,
};
use std::fmt;

/// A setting, and what it needs to be used.
#[derive(Clone, Debug)]
pub struct Entry {
    /// The setting.
    pub field: Field,
    /// All that it needs; empty for settings that are always used.
    pub needs: Vec<Need>,
}

/// What a setting needs to be used.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Need {
    /// One of these choices.
    OneOf(Vec<ChosenValues>),
    /// Any choice but this one.
    Not(ChosenValues),
}

/// A choice, and the values of it that are meant.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChosenValues {
    /// The setting that makes the choice, e.g. `method`.
    pub key: &'static str,
    /// Its values.
    pub values: Vec<&'static str>,
}

impl Need {
    /// The choices that it is about.
    pub fn choices(&self) -> &[ChosenValues] {
        match self {
            Self::OneOf(choices) => choices,
            Self::Not(choice) => std::slice::from_ref(choice),
        }
    }

    fn one(key: &'static str, values: &[&'static str]) -> Self {
        Self::OneOf(vec![ChosenValues { key, values: values.to_vec() }])
    }
}

impl fmt::Display for Need {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OneOf(choices) => {
                let choices: Vec<String> = choices.iter().map(ToString::to_string).collect();
                formatter.write_str(&choices.join(" or "))
            }
            Self::Not(ChosenValues { key, values }) => {
                write!(formatter, "{key} other than {}", values.join(" or "))
            }
        }
    }
}

impl fmt::Display for ChosenValues {
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
    let segmenter = choice::<SegmenterName>("segmenter", "The segmenter whose masks the method uses.");
    registry.add(vec![segmenter], &[]);
    registry.require("segmenter", Need::Not(ChosenValues { key: "prompts", values: vec!["ground-truth"] }));
    registry.add(RunSettings::fields(), &[]);
    let networks = [("segmenter", vec!["affinity", "fastsam"]), ("tracker", vec!["sam2"])];
    let networks = networks.map(|(key, values)| ChosenValues { key, values });
    registry.require("device", Need::OneOf(networks.to_vec()));
    let with_memory = ChosenValues { key: "method", values: vec!["fastsam-splat", "sam2-splat"] };
    registry.require("memory_device", Need::OneOf(vec![with_memory]));
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
    registry.add(AffinitySettings::fields(), &with(&["affinity"]));
    let weights = "Checkpoint of FastSAM: the published `.pt`, or a `.safetensors`. For `affinity`: a `.safetensors` to use \
                   instead of the weights that are built in.";
    registry.add(vec![file("weights", weights)], &with(&["affinity", "fastsam"]));
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
                    if let Need::OneOf(choices) = need {
                        choices.iter_mut().for_each(|choice| choice.values.extend_from_slice(values));
                    }
                }
                continue;
            }
            let mut needs: Vec<Need> = needs.iter().map(|(key, values)| Need::one(key, values)).collect();
            let only = field.only.and_then(|only| only.split_once(" = "));
            needs.extend(only.map(|(key, value)| Need::one(key, &[value])));
            self.entries.push(Entry { field, needs });
        }
    }

    /// Adds a need to a setting of the top level.
    fn require(&mut self, name: &str, need: Need) {
        let is_meant = |entry: &&mut Entry| entry.field.section.is_empty() && entry.field.name == name;
        if let Some(entry) = self.entries.iter_mut().find(is_meant) {
            entry.needs.push(need);
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
            for choice in entry.needs.iter().flat_map(Need::choices) {
                let chooser = entries.iter().find(|other| other.field.key() == choice.key).unwrap();
                let names = match chooser.field.allowed {
                    Allowed::Names(names) => names,
                    Allowed::Switch => &["true", "false"],
                    _ => panic!("{choice}"),
                };
                assert!(choice.values.iter().all(|value| names.contains(value)), "{choice}");
            }
        }
        let area = entries.iter().find(|entry| entry.field.name == "min_prediction_area").unwrap();
        assert_eq!(area.needs[0].choices()[0].values.len(), 5);
    }

    #[test]
    fn every_number_has_a_range() {
        for Entry { field, .. } in entries() {
            if let Allowed::Range { min, max, .. } = field.allowed {
                assert!(min.is_finite() && max.is_finite() && min < max, "{}", field.key());
                // Only a seed may be any number: all others stand for something that has a size.
                assert!(max <= 1e9 || field.name == "seed", "{}", field.key());
            }
        }
    }
}
