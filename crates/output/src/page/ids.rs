//! Compact encoding of a frame's ids, small enough to store for every frame of a long run.
//!
//! Most pixels have the id of the pixel above. A frame is therefore a sequence of triples: the number of pixels equal
//! to the pixel above, the number of following pixels with one other id, and that id. Above the first row, all ids are
//! 0. Numbers are in base 128, the lowest digit first, with the top bit set on all digits but the last (LEB128).
//! `viewer/src/frame_ids.js` decodes this.

use splatseg_geometry::{Image, SegmentMap};

/// Frames are reduced to this width, pixels. In a frame of width 640, a click is then off by up to a pixel.
const MAX_WIDTH: usize = 320;

/// Reduces an id image to at most 320 columns, taking the id at the centre of each new pixel.
pub fn reduce_ids(ids: &SegmentMap) -> SegmentMap {
    let (width, height) = ids.size();
    if width <= MAX_WIDTH {
        return ids.clone();
    }
    let (columns, rows) = (MAX_WIDTH, (height * MAX_WIDTH).div_ceil(width));
    Image::from_fn(columns, rows, |column, row| {
        ids[((2 * column + 1) * width / (2 * columns), (2 * row + 1) * height / (2 * rows))]
    })
}

/// Encodes ids, row-major, as triples of LEB128 numbers: the number of pixels equal to the pixel above (0 above the first
/// row), the number of following pixels with one other id, and that id. The last triple ends after its first number if no
/// other id follows.
pub fn encode_ids(ids: &SegmentMap) -> Vec<u8> {
    let (width, pixels) = (ids.width(), ids.pixels());
    let is_as_above = |index: usize| pixels[index] == if index < width { 0 } else { pixels[index - width] };
    let mut bytes = Vec::new();
    let mut start = 0;
    while start < pixels.len() {
        let other = (start..pixels.len()).find(|index| !is_as_above(*index)).unwrap_or(pixels.len());
        push(&mut bytes, other - start);
        let Some(id) = pixels.get(other) else { break };
        let end = (other..pixels.len()).find(|index| pixels[*index] != *id).unwrap_or(pixels.len());
        push(&mut bytes, end - other);
        push(&mut bytes, *id as usize);
        start = end;
    }
    bytes
}

fn push(bytes: &mut Vec<u8>, mut number: usize) {
    while number > 127 {
        bytes.push(number as u8 | 128);
        number >>= 7;
    }
    bytes.push(number as u8);
}

#[cfg(test)]
mod tests {
    use super::*;
    use splatseg_geometry::SegmentId;

    /// Decodes ids as the page's script does.
    fn decoded(bytes: &[u8], width: usize, height: usize) -> SegmentMap {
        let mut bytes = bytes.iter();
        let mut number = || {
            let (mut value, mut shift) = (0, 0);
            for byte in bytes.by_ref() {
                value |= usize::from(byte & 127) << shift;
                shift += 7;
                if *byte < 128 {
                    break;
                }
            }
            value
        };
        let mut ids: Vec<SegmentId> = Vec::new();
        while ids.len() < width * height {
            for _ in 0..number() {
                ids.push(if ids.len() < width { 0 } else { ids[ids.len() - width] });
            }
            let (count, id) = (number(), number());
            ids.extend(std::iter::repeat_n(id as SegmentId, count));
        }
        SegmentMap::from_pixels(width, height, ids).unwrap()
    }

    #[test]
    fn ids_come_back() {
        let noisy = |column: usize, row: usize| ((column * 7919 + row * 104_729) % 13 * 5041) as SegmentId;
        let blocks = |column: usize, row: usize| (1 + column / 9 + 10 * (row / 7)) as SegmentId;
        for (width, height) in [(1, 1), (300, 2), (31, 40)] {
            for ids in [
                Image::from_fn(width, height, noisy),
                Image::from_fn(width, height, blocks),
                Image::filled(width, height, 0),
                Image::filled(width, height, 65535),
            ] {
                assert_eq!(decoded(&encode_ids(&ids), width, height), ids);
            }
        }
        assert_eq!(encode_ids(&Image::filled(0, 0, 0)), [] as [u8; 0]);
    }

    #[test]
    fn upright_borders_cost_nothing_after_the_first_row() {
        let stripes = Image::from_fn(320, 240, |column, _| (column / 32) as SegmentId);
        assert!(encode_ids(&stripes).len() < 40);
    }

    #[test]
    fn large_frames_are_reduced_to_the_middles_of_pixels() {
        let ids = Image::from_fn(960, 720, |column, row| (1000 * row + column) as SegmentId);
        let small = reduce_ids(&ids);
        assert_eq!(small.size(), (320, 240));
        assert_eq!((small[(0, 0)], small[(319, 239)]), (1001, 718_958));
        assert_eq!(reduce_ids(&Image::filled(321, 1, 7)).size(), (320, 1));
        assert_eq!(reduce_ids(&small), small);
    }
}
