//! A tool: a name, schemas of its input and output, and a function.

use crate::Assistant;
use rmcp::model::{JsonObject, Tool as Definition, ToolAnnotations};
use rmcp::schemars::JsonSchema;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;
use thiserror::Error;

/// Maximum length of the text of an answer, bytes: more would only fill the model's context.
const MAX_TEXT_BYTES: usize = 12_000;

/// A tool of the server.
pub trait Tool {
    /// The client's input. The model reads the doc comments of its fields.
    type Input: DeserializeOwned + JsonSchema + 'static;
    /// Structured data of the answer.
    type Output: Serialize + JsonSchema + 'static;
    /// The name by which it is called.
    const NAME: &'static str;
    /// Its name for people.
    const TITLE: &'static str;
    /// Description for the model.
    const DESCRIPTION: &'static str;
    /// True if it changes the map's file.
    const WRITES: bool = false;

    /// Answers a call. An error is a sentence for the model.
    fn call(input: Self::Input, assistant: &mut Assistant) -> Result<Answer<Self::Output>, ToolError>;
}

/// An answer of a tool.
#[derive(Debug)]
pub struct Answer<T> {
    /// For the model to read.
    pub text: String,
    /// The same, and more, as data.
    pub data: T,
    /// A picture.
    pub picture: Option<Picture>,
}

/// An encoded picture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// The bytes of a PNG or JPEG file.
    pub bytes: Vec<u8>,
    /// `image/png` or `image/jpeg`.
    pub mime_type: &'static str,
}

/// Why a tool has no answer: a sentence that helps the model to ask better.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{0}")]
pub struct ToolError(pub String);

impl From<String> for ToolError {
    fn from(text: String) -> Self {
        Self(text)
    }
}

/// Result of a call of a tool.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// The answer in words, or what is wrong with the call.
    pub text: String,
    /// The answer as data; `None` if there is no answer.
    pub data: Option<Value>,
    /// A picture.
    pub picture: Option<Picture>,
}

impl Outcome {
    /// A call without an answer.
    pub(crate) fn refused(text: impl Into<String>) -> Self {
        Self { text: shortened(text.into()), data: None, picture: None }
    }

    /// True if there is no answer.
    pub fn is_error(&self) -> bool {
        self.data.is_none()
    }
}

/// A tool in the table.
#[derive(Clone)]
pub struct ToolEntry {
    /// Its description for clients.
    pub definition: Definition,
    /// True if it changes the map's file.
    pub writes: bool,
    /// Calls it with arguments of a client.
    pub call: fn(&mut Assistant, JsonObject) -> Outcome,
}

impl ToolEntry {
    /// The entry of a tool.
    pub fn of<T: Tool>() -> Self {
        let hints = ToolAnnotations::with_title(T::TITLE).read_only(!T::WRITES).destructive(false);
        let definition = Definition::new(T::NAME, T::DESCRIPTION, JsonObject::new())
            .with_title(T::TITLE)
            .with_input_schema::<T::Input>()
            .with_output_schema::<T::Output>()
            .with_annotations(hints.idempotent(true).open_world(false));
        Self { definition, writes: T::WRITES, call: call::<T> }
    }
}

fn call<T: Tool>(assistant: &mut Assistant, arguments: JsonObject) -> Outcome {
    let input = match serde_json::from_value(Value::Object(arguments)) {
        Ok(input) => input,
        Err(error) => return Outcome::refused(format!("The arguments of {} are wrong: {error}", T::NAME)),
    };
    match T::call(input, assistant) {
        Ok(Answer { text, data, picture }) => match serde_json::to_value(data) {
            Ok(data) => Outcome { text: shortened(text), data: Some(data), picture },
            Err(error) => Outcome::refused(format!("The answer cannot be written as JSON: {error}")),
        },
        Err(ToolError(text)) => Outcome::refused(text),
    }
}

/// A text of bounded length.
fn shortened(mut text: String) -> String {
    if text.len() > MAX_TEXT_BYTES {
        text.truncate(text.floor_char_boundary(MAX_TEXT_BYTES));
        text.push('…');
    }
    text
}
