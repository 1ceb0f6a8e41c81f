//! `picture_of`: an object as the camera saw it, outlined.

use crate::Assistant;
use crate::canvas::Canvas;
use crate::facts::{called, rounded};
use crate::object_reference::ObjectReference;
use crate::open_map::{BestKeyframe, LoadedMap};
use crate::tool::{Answer, Tool, ToolError};
use rmcp::schemars::{self, JsonSchema};
use serde::{Deserialize, Serialize};
use splatseg::names::segments_of_keyframe;
use splatseg_geometry::{Image, SegmentId, SegmentMap};
use std::collections::BTreeMap;

/// Longest side of the picture, pixels, unless it is smaller than the keyframe's.
const SIDE: usize = 640;
/// Around the object in a close-up, as a share of its longer side.
const MARGIN: f64 = 0.4;
const OUTLINE: [u8; 3] = [255, 0, 200];
/// A close-up is enlarged by this much at most: more shows only blur.
const MAX_ENLARGED: usize = 6;

/// The arguments of `picture_of`.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Input {
    /// The object.
    object: ObjectReference,
    /// True for the object with little around it, enlarged; false for all that the camera saw.
    #[serde(default)]
    close_up: bool,
}

/// The answer of `picture_of`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Output {
    /// The object.
    id: SegmentId,
    /// Its name.
    name: Option<String>,
    /// Number of the keyframe that the picture was taken from.
    keyframe: u32,
    /// Where the camera was, map coordinates, metres.
    camera_m: [f64; 3],
    /// Width and height of the picture, pixels.
    size_px: [usize; 2],
}

/// The tool.
pub enum PictureOf {}

impl Tool for PictureOf {
    type Input = Input;
    type Output = Output;
    const NAME: &'static str = "picture_of";
    const TITLE: &'static str = "Picture of an object";
    const DESCRIPTION: &'static str = "Shows an object as the camera saw it best, in a small picture with the object \
                                       outlined in magenta. It may have been moved since.";

    fn call(input: Input, assistant: &mut Assistant) -> Result<Answer<Output>, ToolError> {
        let id = assistant.meant(&input.object)?;
        let map = assistant.map.current();
        let best = best_keyframe(map, id)?;
        let view = map.keyframes().map_err(ToolError)?.into_iter().nth(best.index);
        let shown = view.and_then(|view| Some((view.color()?, view)));
        let shown = shown.and_then(|(color, view)| {
            let segments = segments_of_keyframe(&map.map.memory, &view, &color)?;
            Some((color, segments, view))
        });
        let (color, segments, view) = shown.ok_or_else(|| ToolError(not_shown(id)))?;
        let (width, height) = color.size();
        let window = if input.close_up { window(&segments, id) } else { Window([0, 0, width, height]) };
        let canvas = Canvas::new(outlined(&color, &segments, id, window));
        let object = map.object(id);
        let text = format!("{} in keyframe {}, outlined in magenta.", object.map_or_else(String::new, called), view.id);
        let data = Output {
            id,
            name: object.and_then(|object| object.label.clone()),
            keyframe: view.id,
            camera_m: rounded(view.world_from_camera.translation()),
            size_px: [canvas.size().0, canvas.size().1],
        };
        Ok(Answer { text, data, picture: Some(canvas.jpeg()?) })
    }
}

fn not_shown(id: SegmentId) -> String {
    format!("No keyframe of the map shows object {id}: there is no picture of it. plan_view shows where it is.")
}

/// The keyframe that shows the most of an object. The first call looks at all keyframes.
fn best_keyframe(map: &mut LoadedMap, id: SegmentId) -> Result<BestKeyframe, ToolError> {
    if map.pictures.is_none() {
        map.pictures = Some(best_keyframes(map).map_err(ToolError)?);
    }
    let pictures = map.pictures.as_ref();
    if pictures.is_some_and(BTreeMap::is_empty) {
        let problem = "The map has no pictures: it was saved without keyframes, or by a version that kept no colour.";
        return Err(ToolError(problem.to_owned()));
    }
    pictures.and_then(|pictures| pictures.get(&id)).copied().ok_or_else(|| ToolError(not_shown(id)))
}

fn best_keyframes(map: &LoadedMap) -> Result<BTreeMap<SegmentId, BestKeyframe>, String> {
    let mut best: BTreeMap<SegmentId, BestKeyframe> = BTreeMap::new();
    for (index, view) in map.keyframes()?.into_iter().enumerate() {
        let Some(color) = view.color() else { continue };
        let Some(segments) = segments_of_keyframe(&map.map.memory, &view, &color) else { continue };
        for (id, area) in segments.areas().into_iter().filter(|(id, _)| *id != 0) {
            let known = best.entry(id).or_insert(BestKeyframe { index, area });
            if area > known.area {
                *known = BestKeyframe { index, area };
            }
        }
    }
    Ok(best)
}

/// A part of an image: left, top, width and height, pixels.
#[derive(Clone, Copy, Debug)]
struct Window([usize; 4]);

/// The part of an image around an object.
fn window(segments: &SegmentMap, id: SegmentId) -> Window {
    let (width, height) = segments.size();
    let (mut left, mut top, mut right, mut bottom) = (width, height, 0, 0);
    for row in 0..height {
        for column in (0..width).filter(|column| segments[(*column, row)] == id) {
            (left, right) = (left.min(column), right.max(column + 1));
            (top, bottom) = (top.min(row), bottom.max(row + 1));
        }
    }
    if right <= left {
        return Window([0, 0, width, height]);
    }
    let margin = ((MARGIN * (right - left).max(bottom - top) as f64) as usize).max(8);
    let (left, top) = (left.saturating_sub(margin), top.saturating_sub(margin));
    Window([left, top, (right + margin).min(width) - left, (bottom + margin).min(height) - top])
}

/// A part of an image, enlarged, with the outline of an object.
fn outlined(color: &Image<[u8; 3]>, segments: &SegmentMap, id: SegmentId, window: Window) -> Image<[u8; 3]> {
    let Window([left, top, width, height]) = window;
    let factor = (SIDE / width.max(height).max(1)).clamp(1, MAX_ENLARGED);
    let shows = |column: usize, row: usize| segments[(left + column / factor, top + row / factor)] == id;
    let (width, height) = (width * factor, height * factor);
    Image::from_fn(width, height, |column, row| {
        // Two pixels wide, outside the object, so that nothing of it is hidden.
        let (columns, rows) =
            (column.saturating_sub(2)..(column + 3).min(width), row.saturating_sub(2)..(row + 3).min(height));
        if !shows(column, row) && rows.clone().any(|row| columns.clone().any(|column| shows(column, row))) {
            OUTLINE
        } else {
            between(color, (left, column, factor), (top, row, factor))
        }
    })
}

/// An enlarged image's pixel, between those of the image. Along each axis: first pixel of the part, pixel of the enlarged
/// image, factor.
fn between(color: &Image<[u8; 3]>, across: (usize, usize, usize), down: (usize, usize, usize)) -> [u8; 3] {
    let along = |(first, at, factor): (usize, usize, usize), side: usize| {
        let place = (first as f64 + (at as f64 + 0.5) / factor as f64 - 0.5).clamp(0.0, (side - 1) as f64);
        let start = place.floor() as usize;
        (start, (start + 1).min(side - 1), place - place.floor())
    };
    let ((x, next_x, share_x), (y, next_y, share_y)) = (along(across, color.width()), along(down, color.height()));
    std::array::from_fn(|channel| {
        let of = |x: usize, y: usize| f64::from(color[(x, y)][channel]);
        let upper = of(x, y) + share_x * (of(next_x, y) - of(x, y));
        let lower = of(x, next_y) + share_x * (of(next_x, next_y) - of(x, next_y));
        (upper + share_y * (lower - upper)).round() as u8
    })
}
