//! Converts inert pickle data to JSON.

use super::error::Fault;
use super::pickle::{Graph, Id, Value};
use serde_json::{Map, Value as Json};

/// Maximum number of values and bytes of text in a configuration; Ultralytics' have about a thousand.
const MAX_SIZE: usize = 1 << 16;
/// Maximum nesting depth.
const MAX_DEPTH: usize = 32;

/// Converts a dict of scalars, lists and dicts; `None` for any other value. Other values inside the dict are replaced
/// by their descriptions.
///
/// # Errors
/// A [`Fault`] if the dict is larger or deeper than any configuration, or contains itself.
pub(super) fn json(graph: &Graph<'_>, id: Id) -> Result<Option<Json>, Fault> {
    if graph.entries(id).is_none() {
        return Ok(None);
    }
    Writer { graph, size: 0 }.value(id, 0).map(Some)
}

struct Writer<'g, 'a> {
    graph: &'g Graph<'a>,
    size: usize,
}

impl Writer<'_, '_> {
    fn grow(&mut self, size: usize, depth: usize) -> Result<(), Fault> {
        self.size += size;
        if self.size > MAX_SIZE || depth > MAX_DEPTH {
            let expected = format!("at most {MAX_SIZE} values, {MAX_DEPTH} deep");
            return Err(Fault::part("the module's yaml", "more than any configuration has", expected));
        }
        Ok(())
    }

    fn text(&mut self, text: &str, depth: usize) -> Result<String, Fault> {
        self.grow(text.len(), depth)?;
        Ok(text.to_owned())
    }

    fn value(&mut self, id: Id, depth: usize) -> Result<Json, Fault> {
        self.grow(1, depth)?;
        if let Some(entries) = self.graph.entries(id) {
            return self.object(entries, depth);
        }
        Ok(match self.graph.value(id) {
            Value::None => Json::Null,
            Value::Bool(value) => Json::from(*value),
            Value::Int(value) => Json::from(*value),
            // JSON has no infinities.
            Value::Float(value) => Json::from(*value),
            Value::Text(text) => Json::from(self.text(text, depth)?),
            Value::List(items) | Value::Tuple(items) | Value::Set(items) => {
                let items: Result<Vec<_>, _> = items.iter().map(|&item| self.value(item, depth + 1)).collect();
                Json::from(items?)
            }
            _ => Json::from(self.text(&self.graph.describe(id), depth)?),
        })
    }

    fn object(&mut self, entries: &[(Id, Id)], depth: usize) -> Result<Json, Fault> {
        let mut object = Map::new();
        for &(key, value) in entries {
            let key = match self.graph.value(key) {
                Value::Text(text) => self.text(text, depth)?,
                Value::Int(number) => number.to_string(),
                _ => self.graph.describe(key),
            };
            object.insert(key, self.value(value, depth + 1)?);
        }
        Ok(Json::from(object))
    }
}
