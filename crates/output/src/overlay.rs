//! Segments drawn over their image, for viewing.

use crate::glyphs::{GLYPH_HEIGHT, text_pixels, text_width};
use crate::{OutputError, write_unsynced};
use splatseg_geometry::{CowImage, Image, SegmentId, SegmentMap};
use std::cmp::Reverse;
use std::ops::Range;
use std::path::Path;

const JPEG_QUALITY: u8 = 90;
/// Opacity of a segment's colour over the image, percent.
const OPACITY_PERCENT: u32 = 50;
/// `(thickness of the digits, side of a square)`, pixels: a part of a segment is numbered with the first thickness
/// whose square fits into it.
const ROOM_FOR_TEXT: [(usize, usize); 2] = [(2, 21), (1, 11)];

/// The colour of a segment, sRGB: the same in every frame and run, and far from the colours of neighbouring ids.
pub fn segment_color(id: SegmentId) -> [u8; 3] {
    // Golden-ratio steps never repeat a hue; lightness and saturation distinguish ids with similar hues.
    let hue = (f64::from(id) * 0.618_033_988_749_895).fract();
    let lightness = [0.55, 0.42, 0.68][id as usize % 3];
    let saturation = [0.95, 0.70][(id as usize / 3) % 2];
    let chroma = (1.0 - (2.0 * lightness - 1.0_f64).abs()) * saturation;
    // Each channel is full within a sixth of the circle around its own hue and fades over the next sixth.
    let channel = |own_hue: f64| {
        let turn = (hue - own_hue).abs();
        let ramp = (2.0 - 6.0 * turn.min(1.0 - turn)).clamp(0.0, 1.0);
        ((lightness + chroma * (ramp - 0.5)) * 255.0).round() as u8
    };
    [channel(0.0), channel(1.0 / 3.0), channel(2.0 / 3.0)]
}

/// The image with every segment tinted in [`segment_color`], outlined, and numbered where there is room. All images are
/// `[height, width]`, of the same size.
///
/// # Errors
/// [`OutputError::SizesDiffer`].
pub fn draw_overlay(color: &CowImage<'_, [u8; 3]>, segments: &SegmentMap) -> Result<Image<[u8; 3]>, OutputError> {
    if color.size() != segments.size() {
        return Err(OutputError::SizesDiffer { image: color.size(), segments: segments.size() });
    }
    Ok(draw(color.clone().into_owned(), segments))
}

/// Writes [`draw_overlay`] as a JPEG, atomically, without waiting for the disk. The folder must exist.
///
/// # Errors
/// [`OutputError`] names the path; no partial file is left.
pub fn write_overlay_jpeg(
    path: &Path,
    color: &CowImage<'_, [u8; 3]>,
    segments: &SegmentMap,
) -> Result<(), OutputError> {
    let overlay = draw_overlay(color, segments)?;
    let encoded = splatseg_jpeg::encode(overlay.pixels(), overlay.width(), overlay.height(), JPEG_QUALITY)
        .map_err(|source| OutputError::EncodeJpeg { path: path.to_owned(), source })?;
    write_unsynced(path, &encoded)
}

fn draw(mut image: Image<[u8; 3]>, segments: &SegmentMap) -> Image<[u8; 3]> {
    let (width, height) = segments.size();
    let mut last = (0, segment_color(0));
    for (row, pixels) in image.pixels_mut().chunks_mut(width.max(1)).enumerate() {
        let below = segments.row((row + 1).min(height - 1));
        let mut column = 0;
        for run in segments.row(row).chunk_by(|one, next| one == next) {
            let (id, columns) = (run[0], column..column + run.len());
            column = columns.end;
            if id != last.0 {
                last = (id, segment_color(id));
            }
            let (pixels, below) = (&mut pixels[columns.clone()], &below[columns]);
            for (pixel, below) in pixels.iter_mut().zip(below) {
                let inside = if id == 0 { *pixel } else { blended(*pixel, last.1) };
                *pixel = if id == *below { inside } else { [255; 3] };
            }
            if column < width {
                pixels[run.len() - 1] = [255; 3];
            }
        }
    }
    for spot in label_spots(segments) {
        draw_number(&mut image, &spot);
    }
    image
}

fn blended(below: [u8; 3], above: [u8; 3]) -> [u8; 3] {
    std::array::from_fn(|channel| {
        let mixed = u32::from(above[channel]) * OPACITY_PERCENT + u32::from(below[channel]) * (100 - OPACITY_PERCENT);
        (mixed / 100) as u8
    })
}

/// A number to draw.
struct LabelSpot {
    id: SegmentId,
    /// Centre of the number, pixel (column, row).
    center: (usize, usize),
    /// Side of a digit's dot, pixels.
    dot: usize,
}

/// The innermost pixel of every connected part of a segment that is large enough to be numbered.
fn label_spots(segments: &SegmentMap) -> Vec<LabelSpot> {
    let width = segments.width();
    let clearance = border_distances(segments);
    let mut spots = Vec::new();
    for (id, innermost) in parts(segments, &clearance) {
        let side = 2 * clearance[innermost] as usize - 1;
        if let Some((dot, _)) = ROOM_FOR_TEXT.iter().find(|(_, room)| side >= *room) {
            spots.push(LabelSpot { id, center: (innermost % width, innermost / width), dot: *dot });
        }
    }
    spots
}

/// Pixels of a row with one id that lie side by side.
struct Run {
    columns: Range<usize>,
    id: SegmentId,
    /// The run that stands for its part so far; a run that stands for its part has its own number.
    part: usize,
    /// Of the part's pixels, the first one with the greatest clearance, row-major, if this run stands for the part.
    innermost: usize,
}

/// The connected parts of all segments, by their first pixel: the id of each, and the first of its pixels with the greatest
/// clearance.
fn parts(segments: &SegmentMap, clearance: &[u16]) -> Vec<(SegmentId, usize)> {
    let width = segments.width();
    let mut runs: Vec<Run> = Vec::new();
    let mut above = 0..0;
    for row in 0..segments.height() {
        let first = runs.len();
        let mut column = 0;
        for pixels in segments.row(row).chunk_by(|one, next| one == next) {
            let (id, columns) = (pixels[0], column..column + pixels.len());
            column = columns.end;
            if id == 0 {
                continue;
            }
            let pixels = row * width + columns.start..row * width + columns.end;
            let innermost = pixels.max_by_key(|index| (clearance[*index], Reverse(*index))).unwrap_or_default();
            let own = runs.len();
            runs.push(Run { columns: columns.clone(), id, part: own, innermost });
            while above.start < above.end && runs[above.start].columns.end <= columns.start {
                above.start += 1;
            }
            for index in above.clone() {
                if runs[index].columns.start >= columns.end {
                    break;
                }
                if runs[index].id == id {
                    join(&mut runs, index, own, clearance);
                }
            }
        }
        above = first..runs.len();
    }
    let stands_for_part = runs.iter().enumerate().filter(|(index, run)| run.part == *index);
    stands_for_part.map(|(_, run)| (run.id, run.innermost)).collect()
}

/// Makes one part of those of two runs; the earlier run stands for it.
fn join(runs: &mut [Run], one: usize, other: usize, clearance: &[u16]) {
    let (one, other) = (part_of(runs, one), part_of(runs, other));
    let (first, second) = (one.min(other), one.max(other));
    runs[second].part = first;
    let places = [runs[first].innermost, runs[second].innermost];
    runs[first].innermost =
        places.into_iter().max_by_key(|index| (clearance[*index], Reverse(*index))).unwrap_or_default();
}

/// The run that stands for the part of a run.
fn part_of(runs: &mut [Run], mut run: usize) -> usize {
    while runs[run].part != run {
        runs[run].part = runs[runs[run].part].part;
        run = runs[run].part;
    }
    run
}

/// For each pixel, row-major, the chessboard distance (at least 1) to the nearest pixel of another segment or outside
/// the image. Two passes: down from the pixels above and left, up from those below and right.
fn border_distances(segments: &SegmentMap) -> Vec<u16> {
    let (width, height) = segments.size();
    let mut distances = vec![u16::MAX; width * height];
    let outside = (vec![OUTSIDE; width], vec![0; width]);
    for row in 0..height {
        let (before, rest) = distances.split_at_mut(row * width);
        let (ids, near) = match row.checked_sub(1) {
            Some(above) => (segments.row(above), &before[above * width..]),
            None => (outside.0.as_slice(), outside.1.as_slice()),
        };
        let row = segments.row(row).iter().zip(&mut rest[..width]);
        relax(row, ids.iter().zip(near));
    }
    for row in (0..height).rev() {
        let (rest, after) = distances.split_at_mut((row + 1) * width);
        let (ids, near) = match row + 1 < height {
            true => (segments.row(row + 1), &after[..width]),
            false => (outside.0.as_slice(), outside.1.as_slice()),
        };
        let row = segments.row(row).iter().zip(&mut rest[row * width..]);
        relax(row.rev(), ids.iter().zip(near).rev());
    }
    distances
}

/// No segment has this id.
const OUTSIDE: SegmentId = SegmentId::MAX;

/// Limits the distances of a row, with its ids, by those of the row `near` it, and of the pixels before.
fn relax<'a>(
    row: impl Iterator<Item = (&'a SegmentId, &'a mut u16)>,
    mut near: impl Iterator<Item = (&'a SegmentId, &'a u16)>,
) {
    let mut next = || near.next().map_or((OUTSIDE, 0), |(id, distance)| (*id, *distance));
    let (mut before, mut near_before, mut near_here) = ((OUTSIDE, 0), (OUTSIDE, 0), next());
    for (id, distance) in row {
        let near_after = next();
        let beyond = |(other, distance): (SegmentId, u16)| if other == *id { distance } else { 0 };
        let nearest = beyond(before).min(beyond(near_before)).min(beyond(near_here)).min(beyond(near_after));
        *distance = (*distance).min(nearest.saturating_add(1));
        before = (*id, *distance);
        (near_before, near_here) = (near_here, near_after);
    }
}

/// White digits with a dark outline.
fn draw_number(image: &mut Image<[u8; 3]>, spot: &LabelSpot) {
    let digits = spot.id.to_string();
    let dot = spot.dot;
    let (text_columns, text_rows) = (text_width(&digits) * dot, GLYPH_HEIGHT * dot);
    let place = |center: usize, text: usize, side: usize| {
        center.saturating_sub(text / 2).max(1).min(side.saturating_sub(text + 1))
    };
    let left = place(spot.center.0, text_columns, image.width());
    let top = place(spot.center.1, text_rows, image.height());
    let pixels = text_pixels(&digits);
    let (width, height) = image.size();
    for (margin, ink) in [(1, [20; 3]), (0, [255; 3])] {
        for (column, row) in &pixels {
            let columns = (left + column * dot).saturating_sub(margin)..left + (column + 1) * dot + margin;
            for x in columns.take_while(|x| *x < width) {
                let rows = (top + row * dot).saturating_sub(margin)..top + (row + 1) * dot + margin;
                for y in rows.take_while(|y| *y < height) {
                    image[(x, y)] = ink;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_steady_and_distinct() {
        assert_eq!([1, 2, 3].map(segment_color), [1, 2, 3].map(segment_color));
        for id in 1..60u32 {
            for other in id + 1..id + 12 {
                let difference: i32 = (0..3)
                    .map(|channel| {
                        (i32::from(segment_color(id)[channel]) - i32::from(segment_color(other)[channel])).abs()
                    })
                    .sum();
                assert!(difference > 60, "ids {id} and {other}: {:?} {:?}", segment_color(id), segment_color(other));
            }
        }
    }

    #[test]
    fn numbers_stand_inside_their_region_even_if_its_centroid_does_not() {
        let frame = Image::from_fn(90, 90, |column, row| {
            let inner = (25..65).contains(&column) && (25..65).contains(&row);
            if inner { 1 } else { 2 }
        });
        let spots = label_spots(&frame);
        assert_eq!(spots.len(), 2);
        for spot in spots {
            assert_eq!(frame[spot.center], spot.id);
        }
    }

    #[test]
    fn small_regions_get_no_number() {
        let map = Image::from_fn(60, 60, |column, row| u32::from(column < 8 && row < 8));
        assert!(label_spots(&map).is_empty());
    }

    #[test]
    fn sizes_must_agree_and_nothing_panics_on_tiny_images() {
        assert!(draw_overlay(&Image::filled(3, 2, [0; 3]), &Image::filled(2, 3, 0)).is_err());
        for size in [0, 1, 2, 12] {
            let drawn = draw_overlay(&Image::filled(size, size, [9; 3]), &Image::filled(size, size, 70_000)).unwrap();
            assert_eq!(drawn.size(), (size, size));
        }
    }
}
