//! Reads settings from TOML files and from `summary.json`.

use super::{SettingsError, entries};
use crate::relative_paths::resolved;
use crate::summary::RELATIVE_PATHS;
use splatseg_files::{is_number_with_comma, read_file, text_of};
use splatseg_settings::Allowed;
use std::collections::BTreeMap;
use std::path::Path;
use toml::de::{DeTable, DeValue};
use toml::{Spanned, Table, Value};

/// Largest settings file that is read, bytes. All settings together take a few kilobytes.
const MAX_BYTES: u64 = 16_000_000;

/// The content of a settings file.
pub struct SettingsFile {
    /// The values.
    pub table: Table,
    /// Line of each value, counted from 1, by full key; empty for JSON.
    pub lines: BTreeMap<String, usize>,
}

impl SettingsFile {
    /// Reads a TOML file; or, if its name ends in `.json`, a `summary.json` or its `settings` object.
    ///
    /// # Errors
    /// If the file cannot be read, is too large, or has the wrong format.
    pub fn read(path: &Path) -> Result<Self, SettingsError> {
        let bytes =
            read_file(path, MAX_BYTES).map_err(|source| SettingsError::Read { path: path.to_owned(), source })?;
        let syntax = |line, message: &str| SettingsError::Syntax {
            path: path.to_owned(),
            line,
            message: message.trim().replace('\n', " "),
        };
        let text = text_of(bytes).map_err(|error| syntax(None, &format!("has {error}, expected UTF-8 text")))?;
        if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json")) {
            let document =
                serde_json::from_str(&text).map_err(|error| syntax(None, &format!("is not JSON: {error}")))?;
            return from_summary(document, path).map_err(|message| syntax(None, &message));
        }
        let line_of = |offset: usize| text.bytes().take(offset).filter(|byte| *byte == b'\n').count() + 1;
        let toml_error = |error: &toml::de::Error| {
            let span = error.span().unwrap_or_default();
            let found = text.get(span.clone()).unwrap_or_default();
            let is_number =
                !found.is_empty() && found.bytes().all(|byte| byte.is_ascii_digit() || b"+-_".contains(&byte));
            let too_large = format!("{found} is out of range, the largest whole number is {}", Allowed::MAX_WHOLE);
            let line = line_of(span.start);
            let mut words = text.lines().nth(line - 1).unwrap_or_default().split([' ', '\t', '=']);
            let commas = words
                .find(|word| is_number_with_comma(word))
                .map(|number| format!("{number} has a decimal comma, expected {}", number.replace(',', ".")));
            let message = if is_number { &too_large } else { error.message() };
            syntax(Some(line), commas.as_deref().unwrap_or(message))
        };
        let table = text.parse().map_err(|error| toml_error(&error))?;
        let mut lines = BTreeMap::new();
        let spanned = DeTable::parse(&text).map_err(|error| toml_error(&error))?;
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

/// Returns the settings in a summary, which was read from `path`. Without a key `settings`, the document itself is the
/// settings.
fn from_summary(mut document: serde_json::Value, path: &Path) -> Result<SettingsFile, String> {
    let folder =
        path.parent().filter(|_| document.get("paths").and_then(|paths| paths.as_str()) == Some(RELATIVE_PATHS));
    let settings = document.get_mut("settings").map(serde_json::Value::take).unwrap_or(document);
    match from_json(settings)? {
        Some(Value::Table(mut table)) => {
            if let Some(folder) = folder {
                resolve_paths(&mut table, folder);
            }
            Ok(SettingsFile { table, lines: BTreeMap::new() })
        }
        _ => Err("expected the settings of a summary.json".to_owned()),
    }
}

/// Resolves the paths of files and folders, which are relative to `folder`.
fn resolve_paths(table: &mut Table, folder: &Path) {
    let entries = entries();
    for entry in entries.iter().filter(|entry| entry.names_a_file()) {
        if let Some(Value::String(path)) = table.get_mut(entry.field.name)
            && let Some(found) = resolved(folder, Path::new(path)).to_str()
        {
            *path = found.to_owned();
        }
    }
}

/// Converts JSON to TOML; `None` for null.
fn from_json(value: serde_json::Value) -> Result<Option<Value>, String> {
    use serde_json::Value as Json;
    Ok(Some(match value {
        Json::Null => return Ok(None),
        Json::Bool(switch) => Value::Boolean(switch),
        Json::String(text) => Value::String(text),
        Json::Number(number) => match (number.as_i64(), number.as_u64(), number.as_f64()) {
            (Some(whole), _, _) => Value::Integer(whole),
            // Kept as text, as on the command line, so that the error of the range check quotes the exact number.
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
