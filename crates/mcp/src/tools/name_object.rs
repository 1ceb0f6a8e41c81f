//! `name_object`: gives an object a name, in the map's file.

use crate::Assistant;
use crate::object_reference::{MAX_WORDS, ObjectReference};
use crate::tool::{Answer, Tool, ToolError};
use rmcp::schemars::{self, JsonSchema};
use serde::{Deserialize, Serialize};
use splatseg_geometry::SegmentId;

/// The arguments of `name_object`.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Input {
    /// The object.
    object: ObjectReference,
    /// Its new name, at most 300 bytes. An empty text takes its name away.
    name: String,
}

/// The answer of `name_object`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Output {
    /// The object.
    id: SegmentId,
    /// Its name now; null if it has none.
    name: Option<String>,
    /// Its name before.
    name_before: Option<String>,
}

/// The tool.
pub enum NameObject {}

impl Tool for NameObject {
    type Input = Input;
    type Output = Output;
    const NAME: &'static str = "name_object";
    const TITLE: &'static str = "Name an object";
    const DESCRIPTION: &'static str = "Gives an object a name, as if a person had typed it, and saves it in the map's file. \
                                       Names given so are never replaced by a network. Ask the user before.";
    const WRITES: bool = true;

    fn call(input: Input, assistant: &mut Assistant) -> Result<Answer<Output>, ToolError> {
        let id = assistant.meant(&input.object)?;
        let name = Some(input.name.trim()).filter(|name| !name.is_empty());
        if let Some(name) = name.filter(|name| name.len() > MAX_WORDS) {
            return Err(ToolError(format!("name: found {} bytes, expected at most {MAX_WORDS}.", name.len())));
        }
        let before = assistant.map.current().object(id).and_then(|object| object.label.clone());
        assistant.map.rename(id, name).map_err(|error| ToolError(format!("Object {id} was not named: {error}.")))?;
        let text = match name {
            Some(name) => format!("Object {id} is now called {name:?}."),
            None => format!("Object {id} has no name now."),
        };
        let data = Output { id, name: name.map(str::to_owned), name_before: before };
        Ok(Answer { text, data, picture: None })
    }
}
