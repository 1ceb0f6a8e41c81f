//! Tables of values in sections, whose full keys are `section.name`.

use std::collections::BTreeMap;
use toml::{Table, Value};

/// Returns every value by its full key.
pub(super) fn values_by_key(table: &Table) -> BTreeMap<String, &Value> {
    let mut values = BTreeMap::new();
    collect_values("", table, &mut values);
    values
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

/// Returns the value with a full key.
pub(super) fn value_mut<'a>(table: &'a mut Table, key: &str) -> Option<&'a mut Value> {
    match key.split_once('.') {
        Some((section, rest)) => match table.get_mut(section)? {
            Value::Table(inner) => value_mut(inner, rest),
            _ => None,
        },
        None => table.get_mut(key),
    }
}

/// Puts the values `above` over `below`.
pub(super) fn merge(below: &mut Table, above: Table) {
    for (key, value) in above {
        match (below.get_mut(&key), value) {
            (Some(Value::Table(below)), Value::Table(above)) => merge(below, above),
            (_, value) => {
                below.insert(key, value);
            }
        }
    }
}

/// Removes the value with a full key, and any section that this leaves empty.
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
