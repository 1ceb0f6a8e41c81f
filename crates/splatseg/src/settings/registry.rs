//! All settings and the choices that they need.

use super::RunSettings;
use crate::parts::{methods, segmenters, trackers};
use splatseg_dataset::DatasetSettings;
use splatseg_settings::{Allowed, Choice, Field, Section};
use std::fmt;

/// A setting and its requirements.
#[derive(Clone, Debug)]
pub struct Entry {
    /// The setting.
    pub field: Field,
    /// The requirements, all of which must be met; empty for settings that are always used.
    pub needs: Vec<Requirement>,
}

/// A requirement for using a setting.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Requirement {
    /// One of these choices.
    OneOf(Vec<ChosenValues>),
    /// Any choice but this one.
    Not(ChosenValues),
}

/// A choice and some of its values.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChosenValues {
    /// The setting that makes the choice, e.g. `method`.
    pub key: &'static str,
    /// The values.
    pub values: Vec<&'static str>,
}

impl Requirement {
    /// Returns the choices in the requirement.
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

impl fmt::Display for Requirement {
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

/// Returns every setting, in the order of the documentation.
pub fn entries() -> Vec<Entry> {
    let mut registry = Registry::default();
    methods::register_choice(&mut registry);
    segmenters::register_choice(&mut registry);
    registry.add(RunSettings::fields(), &[]);
    let networks = [("segmenter", segmenters::NETWORKS.to_vec()), ("tracker", vec!["sam2"])];
    let networks = networks.map(|(key, values)| ChosenValues { key, values });
    registry.require("device", Requirement::OneOf(networks.to_vec()));
    registry.add(DatasetSettings::fields(), &[]);
    methods::register(&mut registry);
    trackers::register(&mut registry);
    segmenters::register(&mut registry);
    let mut entries = registry.entries;
    // A stable sort: the top level first, then each section in one piece.
    let order: Vec<&str> = entries.iter().map(|entry| entry.field.section).collect();
    let place = |entry: &Entry| order.iter().position(|section| *section == entry.field.section);
    entries.sort_by_key(|entry| (!entry.field.section.is_empty(), place(entry)));
    entries
}

/// Returns the help of a setting, with its default.
pub fn describe(entry: &Entry) -> String {
    let default = entry.field.default.as_ref().map(|default| format!(" [default: {}]", default.trim_matches('"')));
    format!("{}{}", entry.field.help, default.unwrap_or_default())
}

/// Collects the settings of all parts.
#[derive(Default)]
pub(crate) struct Registry {
    entries: Vec<Entry>,
}

impl Registry {
    /// Adds settings that need the choices `needs`. A setting shared by several methods is one entry.
    pub(crate) fn add(&mut self, fields: Vec<Field>, needs: &[(&'static str, &[&'static str])]) {
        for field in fields {
            let known = self
                .entries
                .iter_mut()
                .find(|entry| entry.field.section == field.section && entry.field.name == field.name);
            if let Some(known) = known {
                for (need, (_, values)) in known.needs.iter_mut().zip(needs) {
                    if let Requirement::OneOf(choices) = need {
                        choices.iter_mut().for_each(|choice| choice.values.extend_from_slice(values));
                    }
                }
                continue;
            }
            let mut needs: Vec<Requirement> = needs.iter().map(|(key, values)| Requirement::one(key, values)).collect();
            let choices = |only: &'static str| {
                let choice = |(key, value)| ChosenValues { key, values: vec![value] };
                Requirement::OneOf(only.split(" or ").filter_map(|one| one.split_once(" = ")).map(choice).collect())
            };
            needs.extend(field.only.map(choices));
            self.entries.push(Entry { field, needs });
        }
    }

    /// Adds a requirement to a top-level setting.
    pub(crate) fn require(&mut self, name: &str, need: Requirement) {
        let is_named = |entry: &&mut Entry| entry.field.section.is_empty() && entry.field.name == name;
        if let Some(entry) = self.entries.iter_mut().find(is_named) {
            entry.needs.push(need);
        }
    }
}

/// Describes a setting that chooses a part.
pub(crate) fn choice<T: Choice + Default>(name: &'static str, help: &str) -> Field {
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

/// Describes a setting that names a file or folder.
pub(crate) fn file(name: &'static str, help: &str) -> Field {
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
