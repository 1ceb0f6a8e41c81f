//! When each object was seen, from the map itself, and from the `objects.json` of a run or a live session, which tells only of
//! that run.

use crate::McpError;
use crate::facts::is_date;
use splatseg::pipeline::NamedMap;
use splatseg_files::{read_file, text_of};
use splatseg_objects::{FrameStamp, ObjectList};
use std::path::{Path, PathBuf};

/// Maximum size of `objects.json`, bytes.
const MAX_BYTES: u64 = 64 << 20;

/// The file in which a live session keeps the objects of a map: `home.objects.json` beside `home.ply`.
pub fn file_beside(map: &Path) -> PathBuf {
    map.with_extension("objects.json")
}

/// Adds the last frame that showed each object of a map, as the map remembers it: its number of all runs, and its time if
/// that is a date. Other clocks begin anew with each recording, so their times tell nothing. Returns the latest frame; `None`
/// if the map remembers no times.
pub fn add_map_sightings(list: &mut ObjectList, map: &NamedMap) -> Option<FrameStamp> {
    let frames = map.memory.last_seen();
    list.all().find_map(|object| object.last_seen_s)?;
    for object in list.objects.iter_mut().chain(&mut list.not_counted) {
        let number = frames.get(&object.id).map(|frame| *frame as usize);
        // If it was first seen by another clock, the latest time may be of an earlier recording than the latest frame.
        let has_dates = object.first_seen_s.is_some_and(is_date);
        object.last_frame = number.zip(object.last_seen_s).map(|(number, time_s)| FrameStamp {
            number,
            name: None,
            file: None,
            time_s: Some(time_s).filter(|time| has_dates && is_date(*time)),
        });
    }
    list.all().filter_map(|object| object.last_frame.as_ref()).max_by_key(|frame| frame.number).cloned()
}

/// The later one of two frames, if both have dates; else the first of those that there are.
pub fn later_of(one: Option<FrameStamp>, other: Option<FrameStamp>) -> Option<FrameStamp> {
    let date = |frame: &Option<FrameStamp>| frame.as_ref().and_then(|frame| frame.time_s).filter(|time| is_date(*time));
    match (date(&one), date(&other)) {
        (Some(first), Some(second)) if second > first => other,
        _ => one.or(other),
    }
}

/// Adds the frames of the run of an `objects.json` that showed each object of a map; objects that it did not show keep what
/// the map told of them, and so do those that were seen later. Returns the last frame of the run that showed any.
pub fn add_sightings(list: &mut ObjectList, path: &Path) -> Result<Option<FrameStamp>, McpError> {
    let wrong = |problem: String| McpError::File { path: path.to_owned(), problem };
    let bytes = read_file(path, MAX_BYTES).map_err(|error| wrong(error.to_string()))?;
    let text = text_of(bytes).map_err(|error| wrong(error.to_string()))?;
    let seen: ObjectList =
        serde_json::from_str(&text).map_err(|error| wrong(format!("is not a valid objects.json: {error}")))?;
    if seen.format != ObjectList::FORMAT {
        return Err(wrong(format!("format: found {:?}, expected {:?}", seen.format, ObjectList::FORMAT)));
    }
    let mut common = 0;
    for object in list.objects.iter_mut().chain(&mut list.not_counted) {
        let Some(sighted) = seen.get(object.id) else { continue };
        common += 1;
        object.frames = sighted.frames;
        object.first_frame.clone_from(&sighted.first_frame);
        object.last_frame = later_of(sighted.last_frame.clone(), object.last_frame.take());
        object.confidence = sighted.confidence;
    }
    if common == 0 && !list.objects.is_empty() {
        return Err(wrong("has no object of the map, so it is of another map".to_owned()));
    }
    let last = seen.all().filter_map(|object| object.last_frame.as_ref()).max_by_key(|frame| frame.number);
    Ok(last.cloned())
}
