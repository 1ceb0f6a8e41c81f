//! From a table of values to settings.

use super::{
    Entry, MethodName, MethodSettings, SegmenterName, SegmenterSettings, Settings, SettingsError, TrackerName,
    TrackerSettings, entries,
};
use serde::de::{DeserializeOwned, Error as _};
use serde::{Deserialize, Deserializer};
use splatseg_settings::{Allowed, Choice, Section};
use std::path::PathBuf;
use toml::{Table, Value};

impl Settings {
    /// The settings in a table, with defaults where it has no value. Values that the chosen method, segmenter and
    /// tracker do not use are an error if `strict`, and ignored otherwise.
    ///
    /// # Errors
    /// If a key does not exist, or a value has the wrong type or is out of range.
    pub(super) fn from_table(table: &Table, strict: bool) -> Result<Self, SettingsError> {
        let entries = entries();
        check(table, &entries, strict)?;
        Ok(Self {
            method: method(table)?,
            segmenter: segmenter(table)?,
            dataset: section(table)?,
            run: section(table)?,
        })
    }
}

impl<'de> Deserialize<'de> for Settings {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Self::from_table(&Table::deserialize(deserializer)?, false).map_err(D::Error::custom)
    }
}

/// Checks every value in a table.
fn check(table: &Table, entries: &[Entry], strict: bool) -> Result<(), SettingsError> {
    let mut leaves = Vec::new();
    collect_leaves("", table, &mut leaves);
    let find = |key: &str| entries.iter().find(|entry| entry.field.key() == key);
    for (key, value) in &leaves {
        let entry = find(key).ok_or_else(|| unknown(key, entries))?;
        check_value(entry, value)?;
    }
    if let (true, Some(unused)) = (strict, unused(table, entries).into_iter().next()) {
        return Err(unused);
    }
    Ok(())
}

/// The values in a table that its choices do not use.
pub(super) fn unused(table: &Table, entries: &[Entry]) -> Vec<SettingsError> {
    let mut leaves = Vec::new();
    collect_leaves("", table, &mut leaves);
    let find = |key: &str| entries.iter().find(|entry| entry.field.key() == key);
    let chosen = |key: &str| {
        let given = leaves.iter().find(|(given, _)| given == key).and_then(|(_, value)| value.as_str());
        let default = || find(key).and_then(|entry| entry.field.default.as_deref()).unwrap_or_default();
        given.unwrap_or_else(|| default().trim_matches('"')).to_owned()
    };
    let unused = leaves.iter().filter_map(|(key, _)| {
        let need = find(key)?.needs.iter().find(|need| !need.values.contains(&chosen(need.key).as_str()))?;
        Some(SettingsError::Unused { key: key.clone(), need: need.clone(), found: chosen(need.key) })
    });
    unused.collect()
}

/// Collects the values in a table by their full keys.
fn collect_leaves<'a>(prefix: &str, table: &'a Table, leaves: &mut Vec<(String, &'a Value)>) {
    for (key, value) in table {
        let key = splatseg_settings::full_key(prefix, key);
        match value {
            Value::Table(inner) => collect_leaves(&key, inner, leaves),
            value => leaves.push((key, value)),
        }
    }
}

fn unknown(key: &str, entries: &[Entry]) -> SettingsError {
    let similarity = |candidate: &String| strsim::jaro_winkler(candidate, key);
    let nearest = entries
        .iter()
        .map(|entry| entry.field.key())
        .max_by(|a, b| similarity(a).total_cmp(&similarity(b)))
        .filter(|nearest| similarity(nearest) > 0.8);
    SettingsError::UnknownKey { key: key.to_owned(), nearest }
}

/// Checks the type and the range of a value.
fn check_value(entry: &Entry, value: &Value) -> Result<(), SettingsError> {
    let field = &entry.field;
    let is_allowed = match (&field.allowed, value) {
        (Allowed::Switch, Value::Boolean(_)) => true,
        (Allowed::Text(_), Value::String(text)) => (field.is_text_of)(text),
        (Allowed::Names(names), Value::String(name)) => names.contains(&name.as_str()),
        (allowed, Value::Integer(number)) => allowed.accepts_number(*number as f64),
        (allowed, Value::Float(number)) => !field.whole && allowed.accepts_number(*number),
        _ => false,
    };
    if is_allowed { Ok(()) } else { Err(field.error(value.to_string()).into()) }
}

/// The settings of a section, with defaults where the table has no value.
fn section<T: Section + DeserializeOwned>(table: &Table) -> Result<T, SettingsError> {
    let mut own = Table::new();
    if T::SECTION.is_empty() {
        for field in T::fields() {
            let key = if field.section.is_empty() { field.name } else { field.section };
            if let Some(value) = table.get(key) {
                own.insert(key.to_owned(), value.clone());
            }
        }
    } else if let Some(Value::Table(inner)) = table.get(T::SECTION) {
        own.clone_from(inner);
    }
    // Types and ranges have been checked: only a type's own rules can fail here, e.g. those of an image size.
    let key = if T::SECTION.is_empty() { "settings" } else { T::SECTION };
    Value::Table(own).try_into().map_err(|error: toml::de::Error| {
        let found = error.message().to_owned();
        splatseg_settings::SettingError { key: key.to_owned(), found, expected: "valid values".to_owned() }.into()
    })
}

fn chosen<T: Choice + Default>(table: &Table, key: &str) -> T {
    table.get(key).and_then(Value::as_str).and_then(T::from_name).unwrap_or_default()
}

fn method(table: &Table) -> Result<MethodSettings, SettingsError> {
    Ok(match chosen(table, "method") {
        MethodName::FastsamSplat => MethodSettings::FastsamSplat(section(table)?),
        MethodName::Fastsam => MethodSettings::Fastsam(section(table)?),
        MethodName::Fastspam => MethodSettings::Fastspam(section(table)?),
        MethodName::Sam2 => MethodSettings::Sam2 { settings: section(table)?, tracker: tracker(table)? },
        MethodName::Sam2Splat => {
            MethodSettings::Sam2Splat { settings: Box::new(section(table)?), tracker: tracker(table)? }
        }
    })
}

fn tracker(table: &Table) -> Result<TrackerSettings, SettingsError> {
    Ok(match chosen(table, "tracker") {
        TrackerName::Sam2 => {
            TrackerSettings::Sam2 { tracker_weights: path(table, "tracker_weights"), sam2: section(table)? }
        }
        TrackerName::Sim => TrackerSettings::Sim { sim_tracker: section(table)? },
    })
}

fn segmenter(table: &Table) -> Result<SegmenterSettings, SettingsError> {
    Ok(match chosen(table, "segmenter") {
        SegmenterName::Graph => SegmenterSettings::Graph { graph: section(table)? },
        SegmenterName::Fastsam => {
            SegmenterSettings::Fastsam { weights: path(table, "weights"), fastsam: section(table)? }
        }
        SegmenterName::Masks => SegmenterSettings::Masks { masks: path(table, "masks") },
        SegmenterName::Oracle => SegmenterSettings::Oracle { oracle: section(table)? },
    })
}

fn path(table: &Table, key: &str) -> Option<PathBuf> {
    table.get(key).and_then(Value::as_str).map(PathBuf::from)
}
