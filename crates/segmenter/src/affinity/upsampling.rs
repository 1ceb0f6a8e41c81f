//! Segments of the half-size image at the size of the network's input.

use rayon::prelude::*;
use splatseg_kernels::feature_map::FeatureMap;

/// Weights of the input's channels in the difference between two pixels: colour, inverse depth, validity, normals.
const WEIGHTS: [f32; 8] = [1.0, 1.0, 1.0, 8.0, 0.0, 0.5, 0.5, 0.5];

/// The segment of each pixel of `input`, row-major.
///
/// The network's pixel (column, row) is about the input's pixel (2 · column, 2 · row). A pixel between pixels of several
/// segments gets that of the one whose input is most like its own; of equal ones, that of the upper left.
pub(super) fn enlarge(segments: &[u32], input: &FeatureMap) -> Vec<u32> {
    let (width, height) = (input.width(), input.height());
    let small_width = width.div_ceil(2);
    let mut enlarged = vec![0; width * height];
    enlarged.par_chunks_mut(width.max(1)).enumerate().for_each(|(row, out)| {
        let upper = row / 2;
        let lower = (row.div_ceil(2)).min(height.div_ceil(2) - 1);
        for (column, out) in out.iter_mut().enumerate() {
            let left = column / 2;
            let right = column.div_ceil(2).min(small_width - 1);
            let candidates = [(left, upper), (right, upper), (left, lower), (right, lower)];
            let found = candidates.map(|(column, row)| segments[row * small_width + column]);
            *out = if found == [found[0]; 4] {
                found[0]
            } else {
                let differences = candidates.map(|(x, y)| difference(input, (column, row), (2 * x, 2 * y)));
                let best = (1..4).fold(0, |best, next| if differences[next] < differences[best] { next } else { best });
                found[best]
            };
        }
    });
    enlarged
}

/// How much the input differs between two pixels (column, row).
fn difference(input: &FeatureMap, a: (usize, usize), b: (usize, usize)) -> f32 {
    let channels = WEIGHTS.iter().enumerate();
    channels.map(|(channel, weight)| weight * (input.row(channel, a.1)[a.0] - input.row(channel, b.1)[b.0]).abs()).sum()
}
