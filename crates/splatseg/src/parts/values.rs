//! Reads settings from a table of values whose types and ranges have been checked.

use serde::de::DeserializeOwned;
use splatseg_settings::{Choice, Section, SettingError};
use toml::{Table, Value};

/// Returns the settings of a section, with defaults where the table has no value.
pub(crate) fn section<T: Section + DeserializeOwned>(table: &Table) -> Result<T, SettingError> {
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
        SettingError { key: key.to_owned(), found, expected: "valid values".to_owned() }
    })
}

/// Returns the choice in a table, or the default.
pub(super) fn chosen<T: Choice + Default>(table: &Table, key: &str) -> T {
    table.get(key).and_then(Value::as_str).and_then(T::from_name).unwrap_or_default()
}
