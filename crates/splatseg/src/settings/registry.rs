//! All settings and the choices that they need.

use super::RunSettings;
use crate::parts::{ChosenValues, Entry, Namer, Part, PartKind, Registry, Requirement};
use crate::parts::{depth_predictors, methods, namers, segmenters, trackers};
use splatseg_dataset::DatasetSettings;
use splatseg_depth::DepthPredictor;
use splatseg_segmenter::Segmenter;
use splatseg_settings::Section;
use splatseg_tracking::Tracker;

/// Returns every setting, in the order of the documentation.
pub fn entries() -> Vec<Entry> {
    let mut registry = Registry::default();
    methods::add_choice(&mut registry);
    segmenters::add_choice(&mut registry);
    registry.add(RunSettings::fields(), &[]);
    let predictors = Part::<dyn DepthPredictor>::all().into_iter().map(|part| part.name).collect();
    let with_predictor = ChosenValues { key: <dyn DepthPredictor>::KEY, values: predictors };
    registry.require("predicted_depth", Requirement::OneOf(vec![with_predictor]));
    let mut networks = vec![
        networks_of::<dyn Segmenter>(),
        networks_of::<dyn Tracker>(),
        networks_of::<dyn Namer>(),
        networks_of::<dyn DepthPredictor>(),
    ];
    networks.retain(|choice| !choice.values.is_empty());
    registry.require("device", Requirement::OneOf(networks));
    let with_detail = ChosenValues { key: <dyn Segmenter>::KEY, values: segmenters::WITH_DETAIL.to_vec() };
    registry.require("detail", Requirement::OneOf(vec![with_detail]));
    registry.add(DatasetSettings::fields(), &[]);
    methods::add_settings(&mut registry);
    trackers::add_settings(&mut registry, &methods::WITH_TRACKER);
    segmenters::add_settings(&mut registry);
    namers::add_settings(&mut registry);
    depth_predictors::add_settings(&mut registry);
    let mut entries = registry.entries;
    // A stable sort: the top level first, then each section in one piece.
    let order: Vec<&str> = entries.iter().map(|entry| entry.field.section).collect();
    let place = |entry: &Entry| order.iter().position(|section| *section == entry.field.section);
    entries.sort_by_cached_key(|entry| (!entry.field.section.is_empty(), place(entry)));
    entries
}

/// Returns the help of a setting, with its default.
pub fn describe(entry: &Entry) -> String {
    let default = entry.field.default.as_ref().map(|default| format!(" [default: {}]", default.trim_matches('"')));
    format!("{}{}", entry.field.help(), default.unwrap_or_default())
}

/// The parts of a kind that are networks.
fn networks_of<T: PartKind + ?Sized>() -> ChosenValues {
    let networks = Part::<T>::all().into_iter().filter(|part| part.is_network);
    ChosenValues { key: T::KEY, values: networks.map(|part| part.name).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use splatseg_settings::Allowed;
    use std::collections::BTreeSet;

    #[test]
    fn keys_are_unique_and_needs_name_choices() {
        let entries = entries();
        let keys: BTreeSet<String> = entries.iter().map(|entry| entry.field.key()).collect();
        assert_eq!(keys.len(), entries.len());
        for entry in &entries {
            assert!(!entry.field.help().is_empty());
            for choice in entry.needs.iter().flat_map(Requirement::choices) {
                let chooser = entries.iter().find(|other| other.field.key() == choice.key).unwrap();
                let names = match chooser.field.allowed {
                    Allowed::Names(names) => names,
                    Allowed::Switch => &["true", "false"],
                    _ => panic!("{choice}"),
                };
                assert!(choice.values.iter().all(|value| names.contains(value)), "{choice}");
            }
        }
        let area = entries.iter().find(|entry| entry.field.name == "min_area").unwrap();
        assert_eq!(area.needs[0].choices()[0].values.len(), 5);
    }

    #[test]
    fn every_number_has_a_range() {
        for Entry { field, .. } in entries() {
            if let Allowed::Range { min, max, .. } = field.allowed {
                assert!(min.is_finite() && max.is_finite() && min < max, "{}", field.key());
                // Only a seed may be any number. All others are quantities with a sensible limit.
                assert!(max <= 1e9 || field.name == "seed", "{}", field.key());
            }
        }
    }
}
