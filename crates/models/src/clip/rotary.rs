//! The rotary position encoding of a Perception Encoder: pairs of channels of queries and keys are turned by angles that
//! grow with column and row. The token of the class is not turned.

use rayon::prelude::*;

/// Frequencies fall from 1 to 1 / TEMPERATURE.
const TEMPERATURE: f32 = 10000.0;
/// Columns and rows are counted from here.
const POSITION_OF_FIRST: f32 = 1.0;

/// Cosine and sine for each patch and pair of channels of a head, `[grid · grid, head width / 2]`. The first half of the
/// pairs depends on the column, the second on the row; both are counted from 1.
pub(super) fn angles(grid: usize, head_width: usize) -> Vec<[f32; 2]> {
    let quarter = head_width / 4;
    let frequency = |index: usize| 1.0 / TEMPERATURE.powf(index as f32 / quarter as f32);
    let turn = |position: usize, index: usize| {
        let angle = (position as f32 + POSITION_OF_FIRST) * frequency(index);
        [angle.cos(), angle.sin()]
    };
    (0..grid * grid)
        .flat_map(|patch| {
            let columns = (0..quarter).map(move |index| turn(patch % grid, index));
            columns.chain((0..quarter).map(move |index| turn(patch / grid, index)))
        })
        .collect()
}

/// Turns queries and keys. `rows` is `[images, 1 + patches, 3 · width]`, where `angles` are of all patches.
pub(super) fn turn(rows: &mut [f32], width: usize, heads: usize, angles: &[[f32; 2]]) {
    let pairs = width / heads / 2;
    let count = angles.len() / pairs + 1;
    rows.par_chunks_exact_mut(3 * width).with_min_len(32).enumerate().for_each(|(row, values)| {
        let token = row % count;
        if token == 0 {
            return;
        }
        let angles = &angles[(token - 1) * pairs..][..pairs];
        for head in values[..2 * width].chunks_exact_mut(2 * pairs) {
            for (pair, [cosine, sine]) in head.as_chunks_mut::<2>().0.iter_mut().zip(angles) {
                let [a, b] = *pair;
                *pair = [a * cosine - b * sine, b * cosine + a * sine];
            }
        }
    });
}
