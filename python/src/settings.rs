//! Settings from Python's keyword arguments.

use crate::errors::value_error;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyString};
use splatseg::Settings;
use splatseg::settings::{SettingsError, SettingsLayers, entries};
use std::path::Path;
use toml::Value;

/// Layers with keyword arguments: keys are `seed`, `memory.max_votes`, or a section with a dict. Settings of
/// `short_section` may be given without the section's name.
pub fn layers(arguments: &Bound<'_, PyDict>, short_section: Option<&str>) -> PyResult<SettingsLayers> {
    let mut layers = SettingsLayers::default();
    add(&mut layers, "", arguments, short_section)?;
    Ok(layers)
}

/// Checks names and values of settings. Opens no file.
#[pyfunction]
pub fn check_settings(settings: &Bound<'_, PyDict>) -> PyResult<()> {
    layers(settings, None)?.resolve_shared().map(drop).map_err(settings_error)
}

/// Resolves layers to settings.
///
/// # Errors
/// `TypeError` for keywords that are not settings, `ValueError` for all others.
pub fn resolve(layers: &SettingsLayers) -> PyResult<Settings> {
    layers.resolve().map_err(settings_error)
}

/// Adds the settings of a file: TOML, or the `summary.json` of a run.
pub fn add_file(layers: &mut SettingsLayers, path: &Path) -> PyResult<()> {
    layers.add_file(path).map_err(settings_error)
}

/// `TypeError` for unknown keywords, as usual in Python; otherwise `ValueError`.
pub fn settings_error(error: SettingsError) -> PyErr {
    match error {
        SettingsError::UnknownKey { .. } | SettingsError::IsSection { .. } => PyTypeError::new_err(error.to_string()),
        other => value_error(other),
    }
}

fn add(
    layers: &mut SettingsLayers,
    section: &str,
    arguments: &Bound<'_, PyDict>,
    short_section: Option<&str>,
) -> PyResult<()> {
    for (name, value) in arguments.iter() {
        let name: String = name.extract()?;
        if value.is_none() {
            continue;
        }
        let key = if section.is_empty() { full_key(&name, short_section) } else { format!("{section}.{name}") };
        if let Ok(inner) = value.cast::<PyDict>() {
            add(layers, &key, inner, None)?;
        } else {
            let value = setting_value(&value, &key)?;
            layers.add(&key, value).ok_or_else(|| PyTypeError::new_err(format!("there is no setting {key}")))?;
        }
    }
    Ok(())
}

/// The full key of a setting that may be given without its section.
fn full_key(name: &str, short_section: Option<&str>) -> String {
    let in_section = short_section.map(|section| format!("{section}.{name}"));
    let exists = |key: &String| entries().iter().any(|entry| entry.field.key() == *key);
    match in_section {
        Some(key) if !exists(&name.to_owned()) && !name.contains('.') => key,
        _ => name.to_owned(),
    }
}

fn setting_value(value: &Bound<'_, PyAny>, key: &str) -> PyResult<Value> {
    let numpy_bool = value.py().import("numpy")?.getattr("bool_")?;
    if value.is_instance_of::<PyBool>() || value.is_instance(&numpy_bool)? {
        return Ok(Value::Boolean(value.is_truthy()?));
    }
    if value.is_instance_of::<PyString>() {
        return Ok(Value::String(value.extract()?));
    }
    if value.is_instance_of::<PyFloat>() {
        return Ok(Value::Float(value.extract()?));
    }
    if value.hasattr("__fspath__")? {
        return Ok(Value::String(value.call_method0("__fspath__")?.extract()?));
    }
    // Includes NumPy's numbers.
    if value.hasattr("__index__")? {
        return Ok(Value::Integer(value.call_method0("__index__")?.extract()?));
    }
    if value.hasattr("__float__")? {
        return Ok(Value::Float(value.call_method0("__float__")?.extract()?));
    }
    let found = value.get_type().name()?;
    Err(PyTypeError::new_err(format!(
        "{key} is of type {found}, expected a number, a bool, a string, a path or a dict"
    )))
}
