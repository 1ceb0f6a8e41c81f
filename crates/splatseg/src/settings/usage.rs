//! Finds the values of a table that its choices do not use.

use super::toml_table::{merge, remove, values_by_key};
use super::{ChosenValues, Entry, MethodPreset, Requirement, SettingsError};
use splatseg_memory::{MemoryKind, MemorySettings};
use splatseg_settings::Choice;
use std::collections::BTreeMap;
use toml::{Table, Value};

/// The values of a table by full key, and the settings that they belong to.
pub struct Usage<'a> {
    values: BTreeMap<String, &'a Value>,
    entries: &'a [Entry],
}

impl<'a> Usage<'a> {
    /// Collects the values of a table.
    pub fn new(table: &'a Table, entries: &'a [Entry]) -> Self {
        Self { values: values_by_key(table), entries }
    }

    /// Returns every value with its full key.
    pub fn values(&self) -> impl Iterator<Item = (&str, &'a Value)> {
        self.values.iter().map(|(key, value)| (key.as_str(), *value))
    }

    /// Returns the setting with this key.
    pub fn entry(&self, key: &str) -> Option<&'a Entry> {
        self.entries.iter().find(|entry| entry.field.key() == key)
    }

    /// Returns one error for each unused value.
    pub fn unused(&self) -> Vec<SettingsError> {
        let unused = self.values.keys().filter_map(|key| {
            let need = self.unmet_requirement(self.entry(key)?)?;
            Some(SettingsError::Unused { key: key.clone(), need: need.clone(), found: self.why(need) })
        });
        unused.collect()
    }

    /// Returns true if a setting with this key would be used.
    pub fn uses(&self, key: &str) -> bool {
        self.entry(key).is_some_and(|entry| self.unmet_requirement(entry).is_none())
    }

    /// Returns the first unmet requirement of a setting, if any.
    fn unmet_requirement(&self, entry: &'a Entry) -> Option<&'a Requirement> {
        entry.needs.iter().find(|need| match need {
            Requirement::OneOf(choices) => !choices.iter().any(|choice| self.is_chosen(choice)),
            Requirement::Not(choice) => self.is_chosen(choice),
        })
    }

    fn is_chosen(&self, choice: &ChosenValues) -> bool {
        self.chosen(choice.key).is_some_and(|value| choice.values.contains(&value.as_str()))
    }

    /// Returns the given value of a setting, or its default; `None` if the setting is not used.
    fn chosen(&self, key: &str) -> Option<String> {
        let entry = self.entry(key)?;
        if self.unmet_requirement(entry).is_some() {
            return None;
        }
        let default = || entry.field.default.as_deref().unwrap_or_default().trim_matches('"').to_owned();
        let value = self.values.get(key).map_or_else(default, |value| match value {
            Value::String(text) => text.clone(),
            value => value.to_string(),
        });
        // `auto` selects the rule of the memory's kind.
        if key == "memory.growth" && value == "auto" {
            let kind = self.chosen("memory.kind").and_then(|kind| MemoryKind::from_name(&kind)).unwrap_or_default();
            return Some(kind.rules(&MemorySettings::default()).growth.name().to_owned());
        }
        Some(value)
    }

    /// Returns the choices that fail a requirement, e.g. `memory.kind is evidence`.
    fn why(&self, need: &Requirement) -> String {
        let mut reasons: Vec<String> = Vec::new();
        for choice in need.choices() {
            let reason = match (self.chosen(choice.key), self.entry(choice.key)) {
                (None, Some(chooser)) => self.unmet_requirement(chooser).map(|need| self.why(need)).unwrap_or_default(),
                (value, _) => {
                    let value = value.filter(|value| !value.is_empty());
                    format!("{} is {}", choice.key, value.as_deref().unwrap_or("not given"))
                }
            };
            if !reasons.contains(&reason) {
                reasons.push(reason);
            }
        }
        reasons.join(" and ")
    }
}

/// Returns the table without unused values.
pub fn only_used(table: &Table, entries: &[Entry]) -> Table {
    let mut used = table.clone();
    for error in Usage::new(table, entries).unused() {
        if let SettingsError::Unused { key, .. } = error {
            remove(&mut used, &key);
        }
    }
    used
}

/// Returns the table with the preset's defaults where it has no value. Leaves out defaults that its choices do not use.
pub(super) fn with_preset(table: &Table, entries: &[Entry]) -> Table {
    let name = table.get("method_preset").and_then(Value::as_str);
    let mut filled = name.and_then(MethodPreset::from_name).unwrap_or_default().values();
    merge(&mut filled, table.clone());
    let given = Usage::new(table, entries);
    let unused = Usage::new(&filled, entries).unused();
    for error in unused {
        if let SettingsError::Unused { key, .. } = error
            && !given.values().any(|(given, _)| given == key)
        {
            remove(&mut filled, &key);
        }
    }
    filled
}
