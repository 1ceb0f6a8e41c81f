//! Files of settings: TOML, or the JSON of a summary.

use super::SettingsError;
use splatseg_input::read_file;
use splatseg_settings::Allowed;
use std::collections::BTreeMap;
use std::path::Path;
use toml::de::{DeTable, DeValue};
use toml::{Spanned, Table, Value};

/// Larger files of settings are refused: all settings together are a few kilobytes.
const MAX_BYTES: u64 = 16_000_000;

/// What a file of settings holds.
pub struct SettingsFile {
    /// Its values.
    pub table: Table,
    /// The line of each value, counted from 1, by full key; empty for JSON.
    pub lines: BTreeMap<String, usize>,
}

impl SettingsFile {
    /// Reads a TOML file; or, if its name ends in `.json`, a `summary.json` or the settings in one.
    ///
    /// # Errors
    /// If the file cannot be read, is too large, or is neither.
    pub fn read(path: &Path) -> Result<Self, SettingsError> {
        let bytes =
            read_file(path, MAX_BYTES).map_err(|source| SettingsError::Read { path: path.to_owned(), source })?;
        let syntax = |line, message: &str| SettingsError::Syntax {
            path: path.to_owned(),
            line,
            message: message.trim().replace('\n', " "),
        };
        if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json")) {
            let document =
                serde_json::from_slice(&bytes).map_err(|error| syntax(None, &format!("is not JSON: {error}")))?;
            return of_summary(document).map_err(|message| syntax(None, &message));
        }
        let text = String::from_utf8(bytes).map_err(|_| syntax(None, "is not UTF-8 text, expected TOML"))?;
        let line_of = |offset: usize| text.bytes().take(offset).filter(|byte| *byte == b'\n').count() + 1;
        let wrong = |error: &toml::de::Error| {
            let span = error.span().unwrap_or_default();
            let found = text.get(span.clone()).unwrap_or_default();
            let is_number =
                !found.is_empty() && found.bytes().all(|byte| byte.is_ascii_digit() || b"+-_".contains(&byte));
            let too_large = format!("{found} is out of range, the largest whole number is {}", Allowed::MAX_WHOLE);
            syntax(Some(line_of(span.start)), if is_number { &too_large } else { error.message() })
        };
        let table = text.parse().map_err(|error| wrong(&error))?;
        let mut lines = BTreeMap::new();
        let spanned = DeTable::parse(&text).map_err(|error| wrong(&error))?;
        collect_lines("", spanned.get_ref(), &line_of, &mut lines);
        Ok(Self { table, lines })
    }
}

fn collect_lines(
    prefix: &str,
    table: &DeTable,
    line_of: &impl Fn(usize) -> usize,
    lines: &mut BTreeMap<String, usize>,
) {
    for (key, value) in table {
        let full_key = splatseg_settings::full_key(prefix, key.get_ref());
        match Spanned::get_ref(value) {
            DeValue::Table(inner) => collect_lines(&full_key, inner, line_of, lines),
            _ => _ = lines.insert(full_key, line_of(key.span().start)),
        }
    }
}

/// The settings of a summary, or of an object that has nothing else.
fn of_summary(mut document: serde_json::Value) -> Result<SettingsFile, String> {
    let settings = document.get_mut("settings").map(serde_json::Value::take).unwrap_or(document);
    match from_json(settings)? {
        Some(Value::Table(table)) => Ok(SettingsFile { table, lines: BTreeMap::new() }),
        _ => Err("expected the settings of a summary.json".to_owned()),
    }
}

/// JSON as TOML; `None` for null.
fn from_json(value: serde_json::Value) -> Result<Option<Value>, String> {
    use serde_json::Value as Json;
    Ok(Some(match value {
        Json::Null => return Ok(None),
        Json::Bool(switch) => Value::Boolean(switch),
        Json::String(text) => Value::String(text),
        Json::Number(number) => match (number.as_i64(), number.as_u64(), number.as_f64()) {
            (Some(whole), _, _) => Value::Integer(whole),
            // Kept as text, as on the command line: the check of ranges refuses it as it was written.
            (None, Some(_), _) => Value::String(number.to_string()),
            (None, None, float) => Value::Float(float.ok_or_else(|| format!("{number} is out of range"))?),
        },
        Json::Array(values) => {
            let values = values.into_iter().filter_map(|value| from_json(value).transpose());
            Value::Array(values.collect::<Result<_, _>>()?)
        }
        Json::Object(values) => {
            let mut table = Table::new();
            for (key, value) in values {
                if let Some(value) = from_json(value)? {
                    table.insert(key, value);
                }
            }
            Value::Table(table)
        }
    }))
}
