//! Rotary position encoding in place.

use rayon::prelude::*;

/// Rotates channels 2i and 2i + 1 of every row by the row's i-th angle. `rows` is `[n, 2 · pairs]`; `angles` is
/// `[period, pairs]` of (cosine, sine), and row r takes the angles r modulo `period`.
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
