//! Enlarges the segments of the half-size image to the size of the network's input.

use super::inputs::CHANNELS;
use rayon::prelude::*;
use splatseg_kernels::feature_map::FeatureMap;

/// Weights of the input's channels in the difference between two pixels: colour, inverse depth, validity, normals.
const WEIGHTS: [f32; CHANNELS] = [1.0, 1.0, 1.0, 8.0, 0.0, 0.5, 0.5, 0.5];

/// Returns the segment of each pixel of `input`, row-major.
///
/// The network's first pixel corresponds to the input's pixel at row and column `start`, 0 or 1, and every next one is 2
/// pixels further. A pixel between different segments gets the segment of the neighbour with the most similar input.
/// Ties go to the first neighbour in row-major order.
pub(super) fn enlarge(segments: &[u32], input: &FeatureMap, start: [usize; 2]) -> Vec<u32> {
    let (width, height) = (input.width(), input.height());
    let small_width = (width - start[1]).div_ceil(2);
    let small_height = (height - start[0]).div_ceil(2);
    // The network's pixels before and after a pixel of the input.
    let around = |place: usize, start: usize, small_size: usize| {
        let place = place.saturating_sub(start);
        [place / 2, place.div_ceil(2).min(small_size - 1)]
    };
    let mut enlarged = vec![0; width * height];
    enlarged.par_chunks_mut(width.max(1)).enumerate().for_each(|(row, out)| {
        let near_rows = around(row, start[0], small_height);
        let rows = near_rows.map(|row| &segments[row * small_width..][..small_width]);
        let own = channels(input, row);
        let near = near_rows.map(|row| channels(input, 2 * row + start[0]));
        for (column, out) in out.iter_mut().enumerate() {
            let columns = around(column, start[1], small_width);
            let first = rows[0][columns[0]];
            *out = first;
            if rows.iter().all(|row| row[columns[0]] == first && row[columns[1]] == first) {
                continue;
            }
            let mut least = f32::INFINITY;
            for (row, near) in rows.iter().zip(&near) {
                for small_column in columns {
                    let difference = difference(&own, column, near, 2 * small_column + start[1]);
                    if difference < least {
                        (least, *out) = (difference, row[small_column]);
                    }
                }
            }
        }
    });
    enlarged
}

/// Returns one row of every channel.
fn channels(input: &FeatureMap, row: usize) -> [&[f32]; CHANNELS] {
    std::array::from_fn(|channel| input.row(channel, row))
}

/// Weighted L1 distance between the inputs of two pixels.
fn difference(own: &[&[f32]; CHANNELS], column: usize, near: &[&[f32]; CHANNELS], near_column: usize) -> f32 {
    let differences = own.iter().zip(near).map(|(own, near)| (own[column] - near[near_column]).abs());
    differences.zip(WEIGHTS).map(|(difference, weight)| weight * difference).sum()
}
