//! The picture at the top of the README, from the clip of `splatseg demo`.

use anyhow::{Context, ensure};
use image::codecs::jpeg::JpegEncoder;
use splatseg::{Pipeline, Settings};
use splatseg_dataset::{FrameStream, GroundTruth, open_scene};
use splatseg_geometry::{Image, SegmentId, SegmentMap};
use splatseg_output::{draw_overlay, write_atomically};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The clip of `splatseg demo`.
const CLIP: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../crates/splatseg-cli/demo");
/// The shown frames, two per row. The second shows another part of the room, the third and fourth return to the first.
/// Other frames fail the check, because the floor beside the desk has a separate id there.
const SHOWN: [usize; 4] = [8, 19, 26, 29];
/// Minimum area of an object in a frame, pixels; smaller ones are not checked there.
const MIN_AREA: usize = 300;
/// Magnification of the frames, to make ids legible.
const ENLARGED: usize = 2;
/// White margin between frames, pixels.
const GAP: usize = 8;
const JPEG_QUALITY: u8 = 80;

/// Make the README's picture: four frames of the demo with the ids found
///
/// Fails if an object does not have the same id in all frames that show it.
#[derive(clap::Args)]
pub struct Arguments {
    /// The picture
    #[arg(long, value_name = "FILE.jpg", default_value = "docs/images/demo.jpg")]
    out: PathBuf,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let frames = process_clip()?;
    let kept = objects_that_keep_their_id(&frames)?;
    write_picture(&arguments.out, &frames)?;
    println!("{}: {kept} objects are in several of the frames, each with one id", arguments.out.display());
    Ok(())
}

/// A shown frame.
struct ShownFrame {
    color: Image<[u8; 3]>,
    segments: SegmentMap,
    truth: SegmentMap,
}

/// Runs the clip as `splatseg demo` does, up to the last shown frame.
fn process_clip() -> anyhow::Result<Vec<ShownFrame>> {
    let settings = Settings::default();
    let scene = open_scene(CLIP, &settings.dataset)?;
    let stream = FrameStream::open(scene, &settings.dataset, GroundTruth::Read)?;
    let mut pipeline = Pipeline::builder(&settings).build()?;
    let mut shown = Vec::new();
    for (index, processed) in pipeline.run(stream).enumerate().take(SHOWN[SHOWN.len() - 1] + 1) {
        let processed = processed?;
        let segments = processed.result?.output.segments;
        if SHOWN.contains(&index) {
            let truth = processed.ground_truth.context("the clip has no labels")?;
            shown.push(ShownFrame { color: processed.frame.color().clone().into_owned(), segments, truth });
        }
    }
    Ok(shown)
}

/// Counts the true objects in two or more of the frames. Fails if the id of one of them changes.
fn objects_that_keep_their_id(frames: &[ShownFrame]) -> anyhow::Result<usize> {
    let mut seen: BTreeMap<SegmentId, Vec<SegmentId>> = BTreeMap::new();
    for frame in frames {
        for (object, id) in main_ids(frame) {
            seen.entry(object).or_default().push(id);
        }
    }
    seen.retain(|_, ids| ids.len() > 1);
    for (object, ids) in &seen {
        ensure!(ids[1..].iter().all(|id| *id == ids[0]), "object {object} has the ids {ids:?}: choose other frames");
    }
    Ok(seen.len())
}

/// The id that covers most of each true object.
fn main_ids(frame: &ShownFrame) -> BTreeMap<SegmentId, SegmentId> {
    let mut counts: BTreeMap<SegmentId, BTreeMap<SegmentId, usize>> = BTreeMap::new();
    for (object, id) in frame.truth.pixels().iter().zip(frame.segments.pixels()).filter(|(object, _)| **object != 0) {
        *counts.entry(*object).or_default().entry(*id).or_default() += 1;
    }
    counts.retain(|_, ids| ids.values().sum::<usize>() >= MIN_AREA);
    let largest = |ids: BTreeMap<SegmentId, usize>| ids.into_iter().max_by_key(|(_, area)| *area).map(|(id, _)| id);
    counts.into_iter().filter_map(|(object, ids)| Some((object, largest(ids)?))).collect()
}

fn write_picture(path: &Path, frames: &[ShownFrame]) -> anyhow::Result<()> {
    let tiles: Vec<Image<[u8; 3]>> = frames.iter().map(tile).collect::<anyhow::Result<_>>()?;
    let (width, height) = tiles.first().context("the clip has too few frames")?.size();
    let picture = Image::from_fn(2 * width + GAP, 2 * height + GAP, |column, row| {
        let (right, x) = within(column, width);
        let (below, y) = within(row, height);
        match (x, y) {
            (Some(x), Some(y)) => tiles[2 * below + right][(x, y)],
            _ => [255; 3],
        }
    });
    let bytes: Vec<u8> = picture.pixels().iter().flatten().copied().collect();
    let mut encoded = Vec::new();
    JpegEncoder::new_with_quality(&mut encoded, JPEG_QUALITY).encode(
        &bytes,
        picture.width() as u32,
        picture.height() as u32,
        image::ExtendedColorType::Rgb8,
    )?;
    write_atomically(path, &encoded)?;
    Ok(())
}

/// A frame with its ids, enlarged.
fn tile(frame: &ShownFrame) -> anyhow::Result<Image<[u8; 3]>> {
    let (width, height) = (ENLARGED * frame.color.width(), ENLARGED * frame.color.height());
    let color = Image::from_fn(width, height, |column, row| frame.color[(column / ENLARGED, row / ENLARGED)]);
    let segments = Image::from_fn(width, height, |column, row| frame.segments[(column / ENLARGED, row / ENLARGED)]);
    Ok(draw_overlay(&color, &segments)?)
}

/// The index of the tile, 0 or 1, and the pixel's position in it; the position is `None` in the gap between the tiles.
fn within(pixel: usize, size: usize) -> (usize, Option<usize>) {
    match pixel {
        _ if pixel < size => (0, Some(pixel)),
        _ if pixel < size + GAP => (0, None),
        _ => (1, Some(pixel - size - GAP)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_readmes_picture_shows_objects_that_keep_their_ids() {
        let kept = objects_that_keep_their_id(&process_clip().unwrap()).unwrap();
        assert!(kept >= 8, "{kept}: too few for a picture of objects that keep their ids");
    }

    #[test]
    fn an_object_that_changes_its_id_is_noticed() {
        let frame = |id| ShownFrame {
            color: Image::filled(20, 20, [0; 3]),
            segments: SegmentMap::filled(20, 20, id),
            truth: SegmentMap::filled(20, 20, 1),
        };
        assert_eq!(objects_that_keep_their_id(&[frame(3), frame(3)]).unwrap(), 1);
        assert!(objects_that_keep_their_id(&[frame(3), frame(4)]).is_err());
    }
}
