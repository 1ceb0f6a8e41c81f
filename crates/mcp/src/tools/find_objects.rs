//! `find_objects`: objects by words.

use crate::Assistant;
use crate::facts::ObjectFacts;
use crate::tool::{Answer, Tool, ToolError};
use rmcp::schemars::{self, JsonSchema};
use serde::{Deserialize, Serialize};

const DEFAULT_LIMIT: usize = 5;
const MAX_LIMIT: usize = 25;

/// The arguments of `find_objects`.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Input {
    /// What to find: a thing, a colour, a size, e.g. "mug", "the small red one", "chairs". At most 300 bytes.
    words: String,
    /// Maximum number of objects, 1 to 25; 5 if not given.
    #[schemars(range(min = 1, max = 25))]
    limit: Option<usize>,
}

/// The answer of `find_objects`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Output {
    /// The objects that fit, best first; none if nothing fits.
    objects: Vec<Found>,
    /// Number of objects that fit, with those beyond the limit.
    total: usize,
}

/// An object that fits the words.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Found {
    /// How well it fits, 0 to 1.
    score: f32,
    /// Which of its properties fit: label (its name), picture, color, size.
    by: Vec<String>,
    /// The object.
    object: ObjectFacts,
}

/// The tool.
pub enum FindObjects {}

impl Tool for FindObjects {
    type Input = Input;
    type Output = Output;
    const NAME: &'static str = "find_objects";
    const TITLE: &'static str = "Find objects";
    const DESCRIPTION: &'static str = "Finds objects by words for a thing, its colour or its size. Words for things fit \
                                       names and their synonyms; an empty list means that nothing fits, not that the \
                                       thing is not there: it may have another name or none.";

    fn call(input: Input, assistant: &mut Assistant) -> Result<Answer<Output>, ToolError> {
        let limit = input.limit.unwrap_or(DEFAULT_LIMIT);
        if !(1..=MAX_LIMIT).contains(&limit) {
            return Err(ToolError(format!("limit: found {limit}, expected 1 to {MAX_LIMIT}.")));
        }
        let found = assistant.found(&input.words)?;
        if found.is_empty() {
            let text = assistant.nothing_fits(&input.words);
            return Ok(Answer { text, data: Output { objects: Vec::new(), total: 0 }, picture: None });
        }
        let map = assistant.map.current();
        let facts = |id| map.object(id).map(|object| ObjectFacts::new(object, map));
        let shown = found.iter().take(limit).filter_map(|found| {
            let by = found.by.iter().map(|by| (*by).to_owned()).collect();
            Some(Found { score: found.score, by, object: facts(found.id)? })
        });
        let objects: Vec<Found> = shown.collect();
        let mut text = format!("{} of {} objects that fit {:?}, best first", objects.len(), found.len(), input.words);
        for found in &objects {
            text += &format!("\n{} (score {:.2}, by {})", found.object.line(), found.score, found.by.join(" and "));
        }
        Ok(Answer { text, data: Output { objects, total: found.len() }, picture: None })
    }
}
