//! `what_changed`: differences to an earlier map of the place, or to the map when the server started.

use crate::Assistant;
use crate::facts::{called, place, rounded, thousandths};
use crate::tool::{Answer, Tool, ToolError};
use rmcp::schemars::{self, JsonSchema};
use serde::{Deserialize, Serialize};
use splatseg::pipeline::{NamedMap, depth_views};
use splatseg_geometry::SegmentId;
use splatseg_objects::{ChangedObject, MapChanges, ObjectList, ObservedMap};

const DEFAULT_LIMIT: usize = 30;
const MAX_LIMIT: usize = 100;

/// With which map to compare.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Since {
    /// With the earlier map that the server was started with.
    EarlierMap,
    /// With this map as it was when the server started.
    ServerStart,
}

/// The arguments of `what_changed`.
#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Input {
    /// With which map to compare. If not given: with the earlier map if there is one.
    since: Option<Since>,
    /// Maximum number of objects of each kind, 1 to 100; 30 if not given.
    #[schemars(range(min = 1, max = 100))]
    limit: Option<usize>,
}

/// The answer of `what_changed`.
#[derive(Debug, Default, Serialize, JsonSchema)]
pub struct Output {
    /// Objects whose place is empty now.
    gone: Vec<Changed>,
    /// Objects whose place was empty before.
    new: Vec<Changed>,
    /// Objects that are at another place now.
    moved: Vec<Moved>,
    /// Number of objects of each kind, with those beyond the limit.
    counts: Counts,
}

/// Numbers of objects.
#[derive(Debug, Default, Serialize, JsonSchema)]
pub struct Counts {
    gone: usize,
    new: usize,
    moved: usize,
    unchanged: usize,
    /// Of the earlier map, but nobody has looked at their place since.
    not_looked_at: usize,
    /// At places that nobody had looked at before.
    newly_seen: usize,
}

/// An object that is gone or new.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Changed {
    /// Its id in its map.
    id: SegmentId,
    /// Its name.
    name: Option<String>,
    /// Centre of its box, metres.
    center_m: [f64; 3],
    /// How sure that is, 0 to 1.
    confidence: f64,
}

/// An object that is at another place.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Moved {
    before: Changed,
    after: Changed,
    /// Distance between the centres, metres.
    distance_m: f64,
}

/// The tool.
pub enum WhatChanged {}

impl Tool for WhatChanged {
    type Input = Input;
    type Output = Output;
    const NAME: &'static str = "what_changed";
    const TITLE: &'static str = "What has changed";
    const DESCRIPTION: &'static str = "Tells which objects are gone, new or moved, compared with an earlier map of the \
                                       place or with this map when the server started. Only places that were looked at \
                                       both times count.";

    fn call(input: Input, assistant: &mut Assistant) -> Result<Answer<Output>, ToolError> {
        let limit = input.limit.unwrap_or(DEFAULT_LIMIT);
        if !(1..=MAX_LIMIT).contains(&limit) {
            return Err(ToolError(format!("limit: found {limit}, expected 1 to {MAX_LIMIT}.")));
        }
        let default = if assistant.earlier.is_some() { Since::EarlierMap } else { Since::ServerStart };
        let (what, before_list, after_list, changes) = match input.since.unwrap_or(default) {
            Since::EarlierMap => {
                let Some((earlier, path)) = assistant.earlier.as_ref().zip(assistant.earlier_path.as_ref()) else {
                    return Err(ToolError("The server was started without an earlier map (--earlier).".to_owned()));
                };
                let (list, what) = (earlier.object_list(), path.display().to_string());
                let current = assistant.map.current();
                (what, list, &current.list, between(earlier, &current.map)?)
            }
            Since::ServerStart => {
                let Some((first, current)) = assistant.map.since_start() else {
                    let text = "The map's file has not changed since the server started.".to_owned();
                    return Ok(Answer { text, data: Output::default(), picture: None });
                };
                let what = "the map when the server started".to_owned();
                (what, first.list.clone(), &current.list, between(&first.map, &current.map)?)
            }
        };
        Ok(answer(&what, &changes, [&before_list, after_list], limit))
    }
}

/// Compares two maps.
fn between(before: &NamedMap, after: &NamedMap) -> Result<MapChanges, ToolError> {
    let missing = || ToolError("A map without keyframes does not tell what was looked at.".to_owned());
    let keyframes = |map: &NamedMap| map.keyframes.clone().ok_or_else(missing);
    let (earlier, later) = (keyframes(before)?, keyframes(after)?);
    let views = |keyframes: &[u8], earlier: Option<&[u8]>| {
        depth_views(keyframes, earlier).map_err(|error| ToolError(error.to_string()))
    };
    let new_views = views(&later, Some(&earlier))?;
    if new_views.is_empty() {
        return Err(ToolError(
            "Nothing was looked at since: the map has no keyframes besides the earlier ones.".to_owned(),
        ));
    }
    let before = ObservedMap::new(&before.memory.map(), views(&earlier, None)?);
    Ok(MapChanges::between(&before, &ObservedMap::new(&after.memory.map(), new_views)))
}

fn answer(what: &str, changes: &MapChanges, [before, after]: [&ObjectList; 2], limit: usize) -> Answer<Output> {
    let changed = |object: &ChangedObject, list: &ObjectList| Changed {
        id: object.id,
        name: list.get(object.id).and_then(|object| object.label.clone()),
        center_m: rounded(object.shape.oriented_box.center),
        confidence: thousandths(object.confidence),
    };
    let words = |object: &ChangedObject, list: &ObjectList| {
        let name = list.get(object.id).map_or_else(|| format!("object {}", object.id), called);
        format!("{name} at {}", place(rounded(object.shape.oriented_box.center)))
    };
    let MapChanges { gone, new, moved, unchanged, not_looked_at, newly_seen, .. } = changes;
    let counts = Counts {
        gone: gone.len(),
        new: new.len(),
        moved: moved.len(),
        unchanged: unchanged.len(),
        not_looked_at: not_looked_at.len(),
        newly_seen: newly_seen.len(),
    };
    let mut text = format!(
        "Since {what}: {} gone, {} new, {} moved, {} unchanged, {} not looked at again, {} seen for the first time.",
        counts.gone, counts.new, counts.moved, counts.unchanged, counts.not_looked_at, counts.newly_seen
    );
    gone.iter().take(limit).for_each(|object| text += &format!("\ngone: {}", words(object, before)));
    new.iter().take(limit).for_each(|object| text += &format!("\nnew: {}", words(object, after)));
    for moved in moved.iter().take(limit) {
        let (from, to) = (words(&moved.before, before), place(rounded(moved.after.shape.oriented_box.center)));
        text += &format!("\nmoved: {from} to {to}, {:.2} m, id now {}", moved.distance, moved.after.id);
    }
    let moves = moved.iter().take(limit).map(|moved| Moved {
        before: changed(&moved.before, before),
        after: changed(&moved.after, after),
        distance_m: thousandths(moved.distance),
    });
    let data = Output {
        gone: gone.iter().take(limit).map(|object| changed(object, before)).collect(),
        new: new.iter().take(limit).map(|object| changed(object, after)).collect(),
        moved: moves.collect(),
        counts,
    };
    Answer { text, data, picture: None }
}
