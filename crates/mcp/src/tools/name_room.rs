//! `name_room`: gives a room a name, in the map's file.

use crate::Assistant;
use crate::object_reference::MAX_WORDS;
use crate::tool::{Answer, Tool, ToolError};
use rmcp::schemars::{self, JsonSchema};
use serde::{Deserialize, Serialize};

/// The arguments of `name_room`.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Input {
    /// Its number, from list_rooms.
    room: u32,
    /// Its new name, at most 300 bytes. An empty text takes the name away that a person gave.
    name: String,
}

/// The answer of `name_room`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Output {
    /// The room.
    id: u32,
    /// Its name now; null if it has none.
    name: Option<String>,
    /// Its name before.
    name_before: Option<String>,
}

/// The tool.
pub enum NameRoom {}

impl Tool for NameRoom {
    type Input = Input;
    type Output = Output;
    const NAME: &'static str = "name_room";
    const TITLE: &'static str = "Name a room";
    const DESCRIPTION: &'static str = "Gives a room a name, as if a person had typed it, and saves it in the map's file. It \
                                       belongs to the place, whatever number the room has later. Ask the user before.";
    const WRITES: bool = true;

    fn call(input: Input, assistant: &mut Assistant) -> Result<Answer<Output>, ToolError> {
        let Input { room: id, name } = input;
        let name = Some(name.trim()).filter(|name| !name.is_empty());
        if let Some(name) = name.filter(|name| name.len() > MAX_WORDS) {
            return Err(ToolError(format!("name: found {} bytes, expected at most {MAX_WORDS}.", name.len())));
        }
        let before = assistant.room(id)?.name;
        assistant.map.rename_room(id, name).map_err(|error| ToolError(format!("Room {id} was not named: {error}.")))?;
        let name = assistant.room(id)?.name;
        let text = match &name {
            Some(name) => format!("Room {id} is now called {name:?}."),
            None => format!("Room {id} has no name now."),
        };
        Ok(Answer { text, data: Output { id, name, name_before: before }, picture: None })
    }
}
