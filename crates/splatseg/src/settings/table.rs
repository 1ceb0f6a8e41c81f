//! Converts tables of values to settings and back.

use super::toml_table::value_mut;
use super::usage::{Usage, only_used, with_preset};
use super::{
    DepthPredictorSettings, Entry, MethodSettings, NamerSettings, RunSettings, SegmenterSettings, Settings,
    SettingsError, entries,
};
use crate::parts::section;
use serde::de::Error as _;
use serde::ser::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use splatseg_dataset::DatasetSettings;
use splatseg_settings::Allowed;
use toml::{Table, Value};

impl Settings {
    /// Returns the settings in a table, with defaults where it has no value: those of its `method_preset`, else ours.
    /// Values that the chosen method, segmenter and tracker do not use are an error if `strict`; otherwise they are
    /// checked and left out.
    ///
    /// # Errors
    /// If a key does not exist, or a value has the wrong type or is out of range.
    pub(super) fn from_table(table: &Table, strict: bool) -> Result<Self, SettingsError> {
        let entries = entries();
        let mut table = with_preset(table, &entries);
        for entry in entries.iter().filter(|entry| matches!(entry.field.allowed, Allowed::Names(_))) {
            // A name may be a number, such as the 90 of `rotate`, and is then written as one.
            if let Some(value) = value_mut(&mut table, &entry.field.key())
                && let Value::Integer(number) = value
            {
                *value = Value::String(number.to_string());
            }
        }
        let table = &table;
        let usage = Usage::new(table, &entries);
        for (key, value) in usage.values() {
            let entry = usage.entry(key).ok_or_else(|| unknown(key, &entries))?;
            check_value(entry, value)?;
        }
        if let (true, Some(unused)) = (strict, usage.unused().into_iter().next()) {
            return Err(unused);
        }
        let table = &only_used(table, &entries);
        Ok(Self {
            method: MethodSettings::from_table(table)?,
            segmenter: SegmenterSettings::from_table(table)?,
            namer: NamerSettings::from_table(table)?,
            depth_predictor: DepthPredictorSettings::from_table(table)?,
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

/// Writes the settings in use.
impl Serialize for Settings {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct AllSettings<'a> {
            #[serde(flatten)]
            method: &'a MethodSettings,
            #[serde(flatten)]
            segmenter: &'a SegmenterSettings,
            #[serde(flatten)]
            namer: Option<&'a NamerSettings>,
            #[serde(flatten)]
            depth_predictor: Option<&'a DepthPredictorSettings>,
            dataset: &'a DatasetSettings,
            #[serde(flatten)]
            run: &'a RunSettings,
        }
        let Self { method, segmenter, namer, depth_predictor, dataset, run } = self;
        let (namer, depth_predictor) = (namer.as_ref(), depth_predictor.as_ref());
        // Converted through text, in which the `f32` 0.3 stays 0.3.
        let all = AllSettings { method, segmenter, namer, depth_predictor, dataset, run };
        let text = toml::to_string(&all).map_err(S::Error::custom)?;
        let table: Table = text.parse().map_err(S::Error::custom)?;
        only_used(&table, &entries()).serialize(serializer)
    }
}

/// Returns the error for an unknown key.
fn unknown(key: &str, entries: &[Entry]) -> SettingsError {
    let section = format!("{key}.");
    if let Some(entry) = entries.iter().find(|entry| entry.field.key().starts_with(&section)) {
        return SettingsError::IsSection { key: key.to_owned(), example: entry.field.key() };
    }
    let keys = entries.iter().map(|entry| entry.field.key());
    SettingsError::UnknownKey { key: key.to_owned(), nearest: nearest_key(key, keys) }
}

/// Returns the most similar key, if one is similar enough: as a whole, or in the name after the section.
pub(super) fn nearest_key(wrong: &str, keys: impl Iterator<Item = String>) -> Option<String> {
    let name = |key: &str| key.rsplit('.').next().unwrap_or_default().to_owned();
    let similarity = |key: &String| {
        let name_similarity = strsim::jaro_winkler(&name(key), &name(wrong));
        // A wrong section is a larger mistake than a wrong letter.
        strsim::jaro_winkler(key, wrong).max(0.95 * name_similarity)
    };
    keys.map(|key| (similarity(&key), key))
        .filter(|(similarity, _)| *similarity > 0.8)
        .max_by(|(a, _), (b, _)| a.total_cmp(b))
        .map(|(_, key)| key)
}

/// Checks the type and the range of a value.
fn check_value(entry: &Entry, value: &Value) -> Result<(), SettingsError> {
    let field = &entry.field;
    let is_allowed = match (&field.allowed, value) {
        (Allowed::Switch, Value::Boolean(_)) => true,
        // A choice that used to be a switch.
        (Allowed::Names(names), Value::Boolean(value)) => names.contains(&value.to_string().as_str()),
        (Allowed::Text(_), Value::String(text)) => (field.is_text_of)(text),
        (Allowed::Names(names), Value::String(name)) => {
            if names.contains(&name.as_str()) {
                return Ok(());
            }
            let names = names.iter().map(|name| (*name).to_owned());
            return Err(match nearest_key(name, names) {
                Some(nearest) => SettingsError::UnknownName { key: field.key(), found: name.clone(), nearest },
                None => field.error(value.to_string()).into(),
            });
        }
        (allowed, Value::Integer(number)) => allowed.accepts_number(*number as f64),
        (allowed, Value::Float(number)) => !field.whole && allowed.accepts_number(*number),
        _ => false,
    };
    let found = match value {
        Value::String(text) if is_number_beyond_toml(text) => text.clone(),
        value => value.to_string(),
    };
    if is_allowed { Ok(()) } else { Err(field.error(found).into()) }
}

/// Returns true if a text is a whole number beyond the range of TOML. [`super::SettingsLayers`] keeps these as text.
fn is_number_beyond_toml(text: &str) -> bool {
    let digits = text.strip_prefix(['-', '+']).unwrap_or(text);
    !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit()) && text.parse::<i64>().is_err()
}
