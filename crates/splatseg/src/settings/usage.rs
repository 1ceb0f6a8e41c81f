//! Which values of a table the choices in it use.

use super::{ChosenValues, Entry, Need, SettingsError};
use std::collections::BTreeMap;
use toml::{Table, Value};

/// The values in a table by their full keys, and which of them are used.
pub struct Usage<'a> {
    values: BTreeMap<String, &'a Value>,
    entries: &'a [Entry],
}

impl<'a> Usage<'a> {
    /// Of a table.
    pub fn of(table: &'a Table, entries: &'a [Entry]) -> Self {
        let mut values = BTreeMap::new();
        collect_values("", table, &mut values);
        Self { values, entries }
    }

    /// Every value with its full key.
    pub fn values(&self) -> impl Iterator<Item = (&str, &'a Value)> {
        self.values.iter().map(|(key, value)| (key.as_str(), *value))
    }

    /// The setting of this key.
    pub fn entry(&self, key: &str) -> Option<&'a Entry> {
        self.entries.iter().find(|entry| entry.field.key() == key)
    }

    /// One error for each value that is not used.
    pub fn unused(&self) -> Vec<SettingsError> {
        let unused = self.values.keys().filter_map(|key| {
            let need = self.unmet_need(self.entry(key)?)?;
            Some(SettingsError::Unused { key: key.clone(), need: need.clone(), found: self.why(need) })
        });
        unused.collect()
    }

    /// Whether a setting of this key would be used.
    pub fn uses(&self, key: &str) -> bool {
        self.entry(key).is_some_and(|entry| self.unmet_need(entry).is_none())
    }

    /// What keeps a setting from being used, if anything does.
    fn unmet_need(&self, entry: &'a Entry) -> Option<&'a Need> {
        entry.needs.iter().find(|need| match need {
            Need::OneOf(choices) => !choices.iter().any(|choice| self.is_chosen(choice)),
            Need::Not(choice) => self.is_chosen(choice),
        })
    }

    fn is_chosen(&self, choice: &ChosenValues) -> bool {
        self.chosen(choice.key).is_some_and(|value| choice.values.contains(&value.as_str()))
    }

    /// The value of a setting, given or not; `None` if the setting is not used.
    fn chosen(&self, key: &str) -> Option<String> {
        let entry = self.entry(key)?;
        if self.unmet_need(entry).is_some() {
            return None;
        }
        let default = || entry.field.default.as_deref().unwrap_or_default().trim_matches('"').to_owned();
        let value = self.values.get(key).map_or_else(default, |value| match value {
            Value::String(text) => text.clone(),
            value => value.to_string(),
        });
        // As `MemorySettings::growth_rule`: `auto` stands for the rule of the memory's kind.
        if key == "memory.growth" && value == "auto" {
            let is_features = self.chosen("memory.kind").is_some_and(|kind| kind == "features");
            return Some(if is_features { "paper" } else { "missing" }.to_owned());
        }
        Some(value)
    }

    /// The choices by which a need is not met, e.g. `memory.kind is evidence`.
    fn why(&self, need: &Need) -> String {
        let mut reasons: Vec<String> = Vec::new();
        for choice in need.choices() {
            let reason = match (self.chosen(choice.key), self.entry(choice.key)) {
                (None, Some(chooser)) => self.unmet_need(chooser).map(|need| self.why(need)).unwrap_or_default(),
                (value, _) => format!("{} is {}", choice.key, value.unwrap_or_default()),
            };
            if !reasons.contains(&reason) {
                reasons.push(reason);
            }
        }
        reasons.join(" and ")
    }
}

fn collect_values<'a>(prefix: &str, table: &'a Table, values: &mut BTreeMap<String, &'a Value>) {
    for (key, value) in table {
        let key = splatseg_settings::full_key(prefix, key);
        match value {
            Value::Table(inner) => collect_values(&key, inner, values),
            value => _ = values.insert(key, value),
        }
    }
}

/// The table without values that are not used.
pub fn only_used(table: &Table, entries: &[Entry]) -> Table {
    let mut used = table.clone();
    for error in Usage::of(table, entries).unused() {
        if let SettingsError::Unused { key, .. } = error {
            remove(&mut used, &key);
        }
    }
    used
}

/// Removes the value of a full key, and the section that is then empty.
pub(super) fn remove(table: &mut Table, key: &str) {
    match key.split_once('.') {
        Some((section, rest)) => {
            if let Some(Value::Table(inner)) = table.get_mut(section) {
                remove(inner, rest);
                if inner.is_empty() {
                    table.remove(section);
                }
            }
        }
        None => _ = table.remove(key),
    }
}
