//! Which object a client means: an id, or words.

use crate::Assistant;
use crate::facts::{ObjectFacts, called};
use crate::tool::ToolError;
use rmcp::schemars::{self, JsonSchema};
use serde::Deserialize;
use splatseg::names::{FoundObject, Query, find_objects};
use splatseg_geometry::SegmentId;
use splatseg_objects::ObjectList;
use std::collections::BTreeSet;

/// Maximum length of a text of a client, bytes.
pub const MAX_WORDS: usize = 300;
/// Maximum number of ids or names in an error.
const LISTED: usize = 20;
/// The best object is meant if the second best fits by this factor less.
const CLEARLY_BETTER: f32 = 0.8;

/// An object: its id, e.g. 15, or words that only it fits, e.g. "red mug".
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "expected the id of an object, e.g. 15, or words, e.g. \"red mug\"")]
pub enum ObjectReference {
    /// The id of an object.
    Id(SegmentId),
    /// Words that only one object fits: its name, a colour, a size; or its id as text.
    Words(String),
}

impl Assistant {
    /// The id of the object that is meant.
    pub(crate) fn meant(&mut self, reference: &ObjectReference) -> Result<SegmentId, ToolError> {
        let words = match reference {
            ObjectReference::Id(id) => return self.known(*id),
            ObjectReference::Words(words) => words.trim(),
        };
        if let Ok(id) = words.trim_start_matches('#').parse() {
            return self.known(id);
        }
        let found = self.found(words)?;
        match found.as_slice() {
            [] => Err(ToolError(self.nothing_fits(words))),
            [one] => Ok(one.id),
            // "the largest": the first one is meant, however much larger it is than the second.
            [one, ..] if Query::new(words).is_superlative() && one.by.contains(&"size") => Ok(one.id),
            [one, other, ..] if other.score <= CLEARLY_BETTER * one.score => Ok(one.id),
            several => {
                let map = self.map.current();
                let fit = several.iter().filter(|found| found.score > CLEARLY_BETTER * several[0].score);
                let lines = fit.take(LISTED).filter_map(|found| map.object(found.id));
                let lines: Vec<String> = lines.map(|object| ObjectFacts::new(object, map).line()).collect();
                Err(ToolError(format!("Several objects fit {words:?}; give the id of one:\n{}", lines.join("\n"))))
            }
        }
    }

    /// The objects that fit words, best first.
    pub(crate) fn found(&mut self, words: &str) -> Result<Vec<FoundObject>, ToolError> {
        let map = self.map.current();
        if words.len() > MAX_WORDS {
            return Err(ToolError(format!("The words are too long: {} bytes, at most {MAX_WORDS}.", words.len())));
        }
        if words.trim().is_empty() {
            return Err(ToolError("There are no words; give a name, a colour or a size, e.g. \"red mug\".".to_owned()));
        }
        let query = Query::new(words);
        if query.thing.is_empty() && query.color.is_none() && query.size.is_none() {
            return Err(ToolError(format!("{words:?} says nothing of an object; give a name, a colour or a size.")));
        }
        find_objects(&query, &map.list, &map.map.names, self.network.as_ref())
            .map_err(|error| ToolError(format!("{}: {error}", self.map.path().display())))
    }

    /// Message to a client whose words fit nothing.
    pub(crate) fn nothing_fits(&mut self, words: &str) -> String {
        format!("No object fits {words:?}. {}", known_names(&self.map.current().list))
    }

    fn known(&mut self, id: SegmentId) -> Result<SegmentId, ToolError> {
        let map = self.map.current();
        if map.object(id).is_some() {
            return Ok(id);
        }
        let known: Vec<SegmentId> = map.list.objects.iter().map(|object| object.id).collect();
        let (first, more) = known.split_at(known.len().min(LISTED));
        let first: Vec<String> = first.iter().map(ToString::to_string).collect();
        let more = if more.is_empty() { String::new() } else { format!(" and {} more (list_objects)", more.len()) };
        Err(ToolError(format!("The map has no object {id}; it has {}{more}.", first.join(", "))))
    }

    /// An object in words, e.g. `mug (15)`.
    pub(crate) fn called(&mut self, id: SegmentId) -> String {
        self.map.current().object(id).map_or_else(|| format!("object {id}"), called)
    }
}

/// The names in a map.
fn known_names(list: &ObjectList) -> String {
    let names: BTreeSet<&str> = list.objects.iter().filter_map(|object| object.label.as_deref()).collect();
    if names.is_empty() {
        return "No object has a name: ask for colours and sizes (\"the largest\", \"red\"), or look at picture_of."
            .to_owned();
    }
    let rest = names.len().saturating_sub(LISTED);
    let first: Vec<&str> = names.into_iter().take(LISTED).collect();
    let more = if rest > 0 { format!(" and {rest} more") } else { String::new() };
    format!("The names are {}{more}.", first.join(", "))
}
