//! `where_is`: where an object is, and what is beside it.

use super::what_is_near::{NearObject, near};
use crate::Assistant;
use crate::facts::{ObjectFacts, called, place, rounded, solid};
use crate::object_reference::ObjectReference;
use crate::tool::{Answer, Tool, ToolError};
use rmcp::schemars::{self, JsonSchema};
use serde::{Deserialize, Serialize};
use splatseg_objects::OrientedBox;

/// Number of neighbours that are told.
const NEIGHBOURS: usize = 4;
/// Farther objects are no neighbours, metres.
const RADIUS: f64 = 1.0;

/// The arguments of `where_is`.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Input {
    /// The object.
    object: ObjectReference,
}

/// The answer of `where_is`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Output {
    /// The object.
    object: ObjectFacts,
    /// Its tightest box; null if it never had depth.
    r#box: Option<TightBox>,
    /// Smallest coordinates of it, metres.
    min_m: Option<[f64; 3]>,
    /// Largest coordinates of it, metres.
    max_m: Option<[f64; 3]>,
    /// Objects within 1 m, the nearest first; 4 at most.
    neighbours: Vec<NearObject>,
}

/// A box of any orientation.
#[derive(Debug, Serialize, JsonSchema)]
pub struct TightBox {
    /// Its centre, metres.
    center_m: [f64; 3],
    /// Lengths of its sides along its own axes, metres.
    size_m: [f32; 3],
    /// Quaternion x, y, z, w that turns its axes into the map's.
    rotation: [f32; 4],
}

impl From<&OrientedBox> for TightBox {
    fn from(of: &OrientedBox) -> Self {
        Self { center_m: rounded(of.center), size_m: of.size.to_array(), rotation: of.rotation.to_array() }
    }
}

/// The tool.
pub enum WhereIs {}

impl Tool for WhereIs {
    type Input = Input;
    type Output = Output;
    const NAME: &'static str = "where_is";
    const TITLE: &'static str = "Where is an object";
    const DESCRIPTION: &'static str = "Tells where an object is: position, box, room if known, when it was last seen, and \
                                       what is beside it. The map tells where it was then; it may have been moved since.";

    fn call(input: Input, assistant: &mut Assistant) -> Result<Answer<Output>, ToolError> {
        let id = assistant.meant(&input.object)?;
        let map = assistant.map.current();
        let object = map.object(id).ok_or_else(|| ToolError(format!("The map has no object {id}.")))?;
        let facts = ObjectFacts::new(object, map);
        let neighbours = solid(object).map(|own| near(map, &own, RADIUS, Some(id))).unwrap_or_default();
        let neighbours: Vec<NearObject> = neighbours.into_iter().take(NEIGHBOURS).collect();
        let mut text = called(object);
        match (facts.center_m, facts.size_m) {
            (Some(center), Some([long, middle, short])) => {
                text += &format!(" is at {} m and measures {long:.2} x {middle:.2} x {short:.2} m.", place(center));
            }
            _ => text += " never had depth, so its place is not known.",
        }
        text += &facts
            .room
            .as_ref()
            .map_or_else(|| " Its room is not known.".to_owned(), |room| format!(" It is in {room}."));
        text += &match (&facts.last_seen, &map.sightings_problem) {
            (Some(seen), _) => format!(" It was last seen {}.", seen.words()),
            (None, Some(problem)) => format!(" When it was last seen is not known: {problem}."),
            (None, None) => " When it was last seen is not known.".to_owned(),
        };
        if !neighbours.is_empty() {
            let near: Vec<String> = neighbours.iter().map(NearObject::words).collect();
            text += &format!(" Near it: {}.", near.join("; "));
        }
        let shape = object.shape.as_ref();
        let data = Output {
            r#box: shape.map(|shape| TightBox::from(&shape.oriented_box)),
            min_m: shape.map(|shape| rounded(shape.axis_aligned_box.min)),
            max_m: shape.map(|shape| rounded(shape.axis_aligned_box.max)),
            object: facts,
            neighbours,
        };
        Ok(Answer { text, data, picture: None })
    }
}
