//! Axial rotary position encoding (official `position_encoding.py`).

use rayon::prelude::*;

/// Frequencies fall from 1 to 1 / TEMPERATURE.
const TEMPERATURE: f32 = 10000.0;

/// Rotary angles of a square map, `[side · side, channels / 2]` pairs (cosine, sine): pair i rotates channels 2i and
/// 2i + 1. The first half of the pairs depends on the column, the second half on the row.
pub fn rotary_angles(side: usize, channels: usize) -> Vec<[f32; 2]> {
    let quarter = channels / 4;
    let frequencies: Vec<f32> =
        (0..quarter).map(|i| 1.0 / TEMPERATURE.powf((4 * i) as f32 / channels as f32)).collect();
    let turn = |position: usize, frequency: &f32| {
        let angle = position as f32 * frequency;
        [angle.cos(), angle.sin()]
    };
    (0..side * side)
        .flat_map(|token| {
            let (column, row) = (token % side, token / side);
            let columns = frequencies.iter().map(move |frequency| turn(column, frequency));
            columns.chain(frequencies.iter().map(move |frequency| turn(row, frequency)))
        })
        .collect()
}

/// Rotates channels 2i and 2i + 1 of every row by the row's i-th angle. `rows` is `[n, 2 · pairs]`; `angles` is
/// `[period, pairs]` of (cosine, sine), and row r uses `angles[r % period]`.
pub fn rotate(rows: &mut [f32], angles: &[[f32; 2]], pairs: usize) {
    let period = angles.len() / pairs;
    rows.par_chunks_mut(2 * pairs).with_min_len(64).enumerate().for_each(|(row, values)| {
        let angles = &angles[row % period * pairs..][..pairs];
        for (pair, [cosine, sine]) in values.as_chunks_mut::<2>().0.iter_mut().zip(angles) {
            let [a, b] = *pair;
            *pair = [a * cosine - b * sine, a * sine + b * cosine];
        }
    });
}
