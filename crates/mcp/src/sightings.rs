//! When each object was seen, from the `objects.json` of a run or a live session, or from the map itself.

use crate::McpError;
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

/// Adds the last frame that showed each object of a map, as the map remembers it: its number of all runs, and its time.
/// Returns the latest one; `None` if the map remembers no times.
pub fn add_map_sightings(list: &mut ObjectList, map: &NamedMap) -> Option<FrameStamp> {
    let frames = map.memory.last_seen();
    list.all().find_map(|object| object.last_seen_s)?;
    for object in list.objects.iter_mut().chain(&mut list.not_counted) {
        let number = frames.get(&object.id).map(|frame| *frame as usize);
        object.last_frame = number.zip(object.last_seen_s).map(|(number, time_s)| FrameStamp {
            number,
            name: None,
            file: None,
            time_s: Some(time_s),
        });
    }
    list.all().filter_map(|object| object.last_frame.as_ref()).max_by_key(|frame| frame.number).cloned()
}

/// Adds the frames that showed each object of a map. Returns the last frame that showed any.
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
        object.last_frame.clone_from(&sighted.last_frame);
        object.confidence = sighted.confidence;
    }
    if common == 0 && !list.objects.is_empty() {
        return Err(wrong("has no object of the map, so it is of another map".to_owned()));
    }
    let last = seen.all().filter_map(|object| object.last_frame.as_ref()).max_by_key(|frame| frame.number);
    Ok(last.cloned())
}
