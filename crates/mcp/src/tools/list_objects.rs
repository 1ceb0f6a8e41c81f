//! `list_objects`: the objects of the map, a page at a time.

use crate::Assistant;
use crate::facts::{ObjectFacts, counted};
use crate::tool::{Answer, Tool, ToolError};
use rmcp::schemars::{self, JsonSchema};
use serde::{Deserialize, Serialize};
use splatseg_objects::Object;

const DEFAULT_LIMIT: usize = 25;
const MAX_LIMIT: usize = 100;

/// The arguments of `list_objects`.
#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Input {
    /// Only objects whose name contains this text. Use find_objects for free words.
    name: Option<String>,
    /// Only objects whose longest side has at least this length, metres.
    min_size_m: Option<f64>,
    /// Only objects whose longest side has at most this length, metres.
    max_size_m: Option<f64>,
    /// Only objects that were seen at this time or later, in seconds as in last_seen.time_s.
    seen_since_s: Option<f64>,
    /// Also list tentative objects, which were seen in one frame only and may be mistakes.
    tentative: bool,
    /// Number of objects to skip: next_offset of the page before.
    offset: usize,
    /// Maximum number of objects, 1 to 100; 25 if not given.
    #[schemars(range(min = 1, max = 100))]
    limit: Option<usize>,
}

/// The answer of `list_objects`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Output {
    /// The objects of this page: those that most frames show first, then by id.
    objects: Vec<ObjectFacts>,
    /// Number of objects that fit, on all pages.
    total: usize,
    /// Offset of the next page; null on the last one.
    next_offset: Option<usize>,
}

/// The tool.
pub enum ListObjects {}

impl Tool for ListObjects {
    type Input = Input;
    type Output = Output;
    const NAME: &'static str = "list_objects";
    const TITLE: &'static str = "List objects";
    const DESCRIPTION: &'static str = "Lists the objects of the map with id, name, colour, size and position, a page at a \
                                       time. Can be narrowed by name, size and time.";

    fn call(input: Input, assistant: &mut Assistant) -> Result<Answer<Output>, ToolError> {
        let limit = input.limit.unwrap_or(DEFAULT_LIMIT);
        if !(1..=MAX_LIMIT).contains(&limit) {
            return Err(ToolError(format!("limit: found {limit}, expected 1 to {MAX_LIMIT}.")));
        }
        let map = assistant.map.current();
        let has_times = || map.list.all().any(|object| object.last_frame.as_ref().is_some_and(|f| f.time_s.is_some()));
        if input.seen_since_s.is_some() && !has_times() {
            return Err(ToolError(
                "seen_since_s cannot be used: the times when objects were seen are not known.".to_owned(),
            ));
        }
        let all = if input.tentative { map.list.clone().with_tentative() } else { map.list.clone() };
        let fitting: Vec<&Object> = all.objects.iter().filter(|object| input.fits(object)).collect();
        let page = fitting.iter().skip(input.offset).take(limit);
        let objects: Vec<ObjectFacts> = page.map(|object| ObjectFacts::new(object, map)).collect();
        let end = input.offset.saturating_add(objects.len());
        let next_offset = (end < fitting.len()).then_some(end);
        let mut text = format!("{} of {}", objects.len(), counted(fitting.len(), "object"));
        objects.iter().for_each(|object| text += &format!("\n{}", object.line()));
        if let Some(next) = next_offset {
            text += &format!("\nMore with offset {next}.");
        }
        Ok(Answer { text, data: Output { objects, total: fitting.len(), next_offset }, picture: None })
    }
}

impl Input {
    fn fits(&self, object: &Object) -> bool {
        let contains = |name: &String| {
            object.label.as_ref().is_some_and(|label| label.to_lowercase().contains(&name.trim().to_lowercase()))
        };
        let side = object.shape.as_ref().map(|shape| f64::from(shape.oriented_box.size.max_element()));
        let time = object.last_frame.as_ref().and_then(|frame| frame.time_s);
        self.name.as_ref().is_none_or(contains)
            && self.min_size_m.is_none_or(|min| side.is_some_and(|side| side >= min))
            && self.max_size_m.is_none_or(|max| side.is_some_and(|side| side <= max))
            && self.seen_since_s.is_none_or(|since| time.is_some_and(|time| time >= since))
    }
}
