//! Views of the objects of a saved map: its keyframes have small colour images, and the map tells which object each pixel
//! shows.

use splatseg_geometry::{Image, RgbdFrame, SegmentId, SegmentMap};
use splatseg_memory::SplatMemory;
use splatseg_objects::{BoundingBox, KeptViews, ObjectSighting, ViewedFrame};
use splatseg_odometry::{KeyframeView, PoseSourceError, keyframe_views};
use std::collections::BTreeMap;

/// The best views of each object of a map among its keyframes, whose images have at most 320 x 320 pixels; none of a map of
/// an earlier version, whose keyframes have no colour. `keyframes` are the bytes that the map was saved with.
///
/// # Errors
/// If the keyframes are damaged, or would take more than the memory limit.
pub fn views_from_keyframes(memory: &SplatMemory, keyframes: &[u8]) -> Result<KeptViews, PoseSourceError> {
    let mut views = KeptViews::default();
    for (number, view) in keyframe_views(keyframes, None)?.into_iter().enumerate() {
        let Some(color) = view.color() else { continue };
        let Some(larger) = segments_of_keyframe(memory, &view, &color) else { continue };
        let frame = ViewedFrame {
            color: &color,
            segments: &larger,
            depth: &view.depth,
            intrinsics: &view.intrinsics,
            world_from_camera: Some(&view.world_from_camera),
        };
        views.record(&frame, &sightings(&larger, number));
    }
    Ok(views)
}

/// Renders the map's object at each pixel of a keyframe's colour image. `None` if the keyframe is not a valid frame.
pub fn segments_of_keyframe(memory: &SplatMemory, view: &KeyframeView, color: &Image<[u8; 3]>) -> Option<SegmentMap> {
    let ids = ids_of(memory, view, color)?;
    Some(Image::from_fn(color.width(), color.height(), |column, row| {
        ids[(column * ids.width() / color.width(), row * ids.height() / color.height())]
    }))
}

/// Renders the map's object at each pixel of a keyframe's depth image. `None` if the keyframe is not a valid frame.
fn ids_of(memory: &SplatMemory, view: &KeyframeView, color: &Image<[u8; 3]>) -> Option<SegmentMap> {
    let (width, height) = view.depth.size();
    let small = Image::from_fn(width, height, |column, row| {
        color[(column * color.width() / width, row * color.height() / height)]
    });
    let depth = view.depth.as_borrowed();
    let frame = RgbdFrame::new(format!("keyframe {}", view.id), small, depth, view.intrinsics, view.world_from_camera);
    Some(memory.recall(&frame.ok()?).expected().segments.clone())
}

/// Area and box of each object in an image.
fn sightings(ids: &SegmentMap, number: usize) -> Vec<ObjectSighting> {
    let mut extents: BTreeMap<SegmentId, (usize, [usize; 4])> = BTreeMap::new();
    for row in 0..ids.height() {
        for (column, id) in ids.row(row).iter().enumerate().filter(|(_, id)| **id != 0) {
            let (area, [left, top, right, bottom]) = extents.entry(*id).or_insert((0, [column, row, column, row]));
            *area += 1;
            (*left, *top) = ((*left).min(column), (*top).min(row));
            (*right, *bottom) = ((*right).max(column), (*bottom).max(row));
        }
    }
    let sighting = |(id, (area, [left, top, right, bottom])): (SegmentId, (usize, [usize; 4]))| ObjectSighting {
        id,
        area,
        bounding_box: BoundingBox { x: left, y: top, width: right + 1 - left, height: bottom + 1 - top },
        confidence: 1.0,
        first_frame: number,
        last_frame: number,
    };
    extents.into_iter().map(sighting).collect()
}
