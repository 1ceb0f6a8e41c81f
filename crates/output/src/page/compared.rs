//! The ids of ground truth or of another run, shown on the page of a run in the place of its own.
//!
//! | file | contents |
//! | --- | --- |
//! | `viewer/compared.js` | name, figure, and which objects are the same |
//! | `viewer/compared-000.js` … | ids of the pixels of the same frames as in `viewer/frames-000.js` |
//!
//! The page loads the first one, which it does not if nothing is compared.

use super::{HTML, Page, RUN_SCRIPTS, STYLE, VIEWER_SCRIPT, ids, json};
use crate::{OutputError, ResultFolder};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::{Deserialize, Serialize};
use splatseg_geometry::{SegmentId, SegmentMap};
use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::path::Path;

/// Objects of both sides are the same if they overlap by at least this IoU over all frames, the largest first.
const MIN_IOU: f64 = 0.1;
/// Largest file of a page's data that is read, bytes.
const MAX_BYTES: u64 = 1 << 30;
/// Begins and ends a page's data.
const RUN_DATA: (&str, &str) = ("var splatsegRun=", ";");

/// The element that loads the comparison.
const SCRIPT: &str = "<script src=\"viewer/compared.js\"></script>\n";

/// The ids of two sides, frame by frame.
#[derive(Debug, Default)]
pub struct ComparedIds {
    /// By name of the frame's file: width, height and encoded ids of the other side.
    frames: BTreeMap<String, EncodedIds>,
    own: BTreeMap<SegmentId, u64>,
    other: BTreeMap<SegmentId, u64>,
    /// Pixels that have an own id and an id of the other side.
    overlaps: BTreeMap<(SegmentId, SegmentId), u64>,
}

/// Width, height and encoded ids of a frame.
type EncodedIds = (usize, usize, String);

/// Data of a comparison on the page.
#[derive(Debug, Serialize)]
struct ComparisonData<'a> {
    name: &'a str,
    figure: &'a str,
    /// Ids that are the same object: of the other side, and own.
    pairs: Vec<(SegmentId, SegmentId)>,
}

/// The part of a page's data that a comparison needs.
#[derive(Debug, Deserialize)]
struct PageFrames {
    frames_per_chunk: usize,
    frames: Vec<String>,
}

impl ComparedIds {
    /// Adds a frame of two sides, `[height, width]` each, 0 for no object. Of different sizes, only the other side is shown.
    /// `file` is the name of the frame's files in the folder of the run.
    pub fn add(&mut self, file: &str, own: &SegmentMap, other: &SegmentMap) {
        let small = ids::reduce_ids(other);
        let encoded = (small.width(), small.height(), STANDARD.encode(ids::encode_ids(&small)));
        self.frames.insert(file.to_owned(), encoded);
        if own.size() != other.size() {
            return;
        }
        for (own, other) in own.pixels().iter().copied().zip(other.pixels().iter().copied()) {
            for (id, areas) in [(own, &mut self.own), (other, &mut self.other)] {
                if id > 0 {
                    *areas.entry(id).or_default() += 1;
                }
            }
            if own > 0 && other > 0 {
                *self.overlaps.entry((own, other)).or_default() += 1;
            }
        }
    }

    /// Own ids and those of the other side that are the same object: the pairs with the largest IoU over all frames first, each
    /// id once.
    pub fn pairs(&self) -> Vec<(SegmentId, SegmentId)> {
        let area = |areas: &BTreeMap<SegmentId, u64>, id| areas.get(&id).copied().unwrap_or(0);
        let iou = |(own, other): (SegmentId, SegmentId), both: u64| {
            both as f64 / (area(&self.own, own) + area(&self.other, other) - both) as f64
        };
        let mut found: Vec<_> = self.overlaps.iter().map(|(pair, both)| (iou(*pair, *both), *pair)).collect();
        found.sort_by(|one, two| two.0.total_cmp(&one.0).then(one.1.cmp(&two.1)));
        let (mut own, mut other) = (BTreeSet::new(), BTreeSet::new());
        let mut pairs = Vec::new();
        for (_, pair) in found.into_iter().take_while(|(iou, _)| *iou >= MIN_IOU) {
            if !own.contains(&pair.0) && !other.contains(&pair.1) {
                own.insert(pair.0);
                other.insert(pair.1);
                pairs.push(pair);
            }
        }
        pairs
    }

    /// One line: how many objects of the other side have a partner, and which part of its pixels show that.
    pub fn figure(&self) -> String {
        let pairs = self.pairs();
        let agreed: u64 = pairs.iter().filter_map(|pair| self.overlaps.get(pair)).sum();
        let all: u64 = self.other.values().sum();
        let mut text = format!("{} of {} objects matched", pairs.len(), self.other.len());
        if all > 0 {
            let _ = write!(text, ", {:.1} % of their pixels", 100.0 * agreed as f64 / all as f64);
        }
        text
    }

    /// Adds the comparison to the page in the folder of a run, in the place of an earlier one. `name` is what the page calls
    /// the other side, `figure` a line about it.
    ///
    /// # Errors
    /// If the folder has no page with data of this form, or a file cannot be written.
    pub fn write(&self, folder: &mut dyn ResultFolder, name: &str, figure: &str) -> Result<(), OutputError> {
        let page = page_frames(&folder.path_of("viewer/run.js"))?;
        let mut pairs: Vec<_> = self.pairs().into_iter().map(|(own, other)| (other, own)).collect();
        pairs.sort_unstable_by_key(|(other, own)| (Reverse(self.other.get(other)), *own));
        let mut write = |file: &str, text: String| folder.write(file, text.as_bytes());
        for (number, frames) in page.frames.chunks(page.frames_per_chunk.max(1)).enumerate() {
            let file = format!("viewer/compared-{number:03}.js");
            let chunk: Vec<Option<&EncodedIds>> = frames.iter().map(|frame| self.frames.get(frame)).collect();
            write(&file, format!("splatsegCompared({number},{});\n", json(&file, &chunk)?))?;
        }
        let file = "viewer/compared.js";
        let data = ComparisonData { name, figure, pairs };
        write(file, format!("var splatsegComparison={};\n", json(file, &data)?))?;
        write("viewer/viewer.js", VIEWER_SCRIPT.to_owned())?;
        let scripts = format!("{SCRIPT}{RUN_SCRIPTS}");
        write(Page::FILE, HTML.replace(RUN_SCRIPTS, &scripts).replace("{{style}}", STYLE))
    }
}

/// The frames of a page, from its data.
fn page_frames(path: &Path) -> Result<PageFrames, OutputError> {
    let wrong = |source| OutputError::Read { path: path.to_owned(), source };
    let bytes = splatseg_files::read_file(path, MAX_BYTES).map_err(|error| wrong(std::io::Error::other(error)))?;
    let text = String::from_utf8_lossy(&bytes);
    let data = text.trim().strip_prefix(RUN_DATA.0).and_then(|text| text.strip_suffix(RUN_DATA.1));
    let data = data.ok_or_else(|| wrong(std::io::Error::other(format!("found no {:?} at its start", RUN_DATA.0))))?;
    serde_json::from_str(data).map_err(|error| wrong(error.into()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use splatseg_geometry::Image;

    #[test]
    fn objects_are_paired_by_their_overlap_over_all_frames_each_once() {
        let mut compared = ComparedIds::default();
        // The other side: 10 covers own 1 and a little of 2; 20 covers the rest of 2 in the second frame only.
        let own = Image::from_fn(10, 2, |column, _| if column < 5 { 1 } else { 2 });
        compared.add("0", &own, &Image::from_fn(10, 2, |column, _| if column < 6 { 10 } else { 0 }));
        compared.add("1", &own, &Image::from_fn(10, 2, |column, _| if column < 5 { 10 } else { 20 }));
        assert_eq!(compared.pairs(), [(1, 10), (2, 20)]);
        // 22 pixels of 10, of which 20 are of 1, and 10 of 20.
        assert_eq!(compared.figure(), "2 of 2 objects matched, 93.8 % of their pixels");
        compared.add("2", &own, &Image::from_fn(10, 2, |column, _| if column == 9 { 30 } else { 0 }));
        assert_eq!(compared.pairs(), [(1, 10), (2, 20)], "30 overlaps too little, and 2 has a partner");
        assert_eq!(ComparedIds::default().figure(), "0 of 0 objects matched");
    }
}
