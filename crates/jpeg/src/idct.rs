//! The inverse cosine transform (T.81 A.3.3), rounded as in libjpeg's accurate integer method.
//!
//! The method (after Loeffler, Ligtenberg and Moschytz, ICASSP 1989) uses constants with 13 fractional bits. It
//! transforms columns first and rounds the intermediate result to two fractional bits. Its sums are exact, so their
//! order does not matter. Here each one-dimensional transform is a matrix product.

use super::frame::{BLOCK, BLOCK_LEN, ZIGZAG};

/// Fractional bits of constants.
const CONSTANT_BITS: u32 = 13;
/// Fractional bits between the passes.
const BETWEEN_BITS: u32 = 2;
/// A one-dimensional transform scales by √8, so a block is scaled by 8.
const SCALE_BITS: u32 = 3;

/// In zigzag order, all coefficients before this one have frequencies below 4 in both directions.
const FIRST_BEYOND_HALF: usize = 10;

/// Offset of the samples.
const CENTRE: i16 = 128;

// The method's constants. The factors below are sums of them, from expanding its steps.
const C0_298: i32 = 2446;
const C0_390: i32 = 3196;
const C0_541: i32 = 4433;
const C0_765: i32 = 6270;
const C0_899: i32 = 7373;
const C1_175: i32 = 9633;
const C1_501: i32 = 12299;
const C1_847: i32 = 15137;
const C1_961: i32 = 16069;
const C2_053: i32 = 16819;
const C2_562: i32 = 20995;
const C3_072: i32 = 25172;

/// Factors of the coefficients 2 and 6.
const EVEN: [[i32; 2]; 2] = [[C0_541 + C0_765, C0_541], [C0_541, C0_541 - C1_847]];

/// Factors of the coefficients 1, 3, 5 and 7.
const ODD: [[i32; 4]; 4] = [
    [C1_175 - C0_390 + C1_501 - C0_899, C1_175, C1_175 - C0_390, C1_175 - C0_899],
    [C1_175, C1_175 - C1_961 + C3_072 - C2_562, C1_175 - C2_562, C1_175 - C1_961],
    [C1_175 - C0_390, C1_175 - C2_562, C1_175 - C0_390 + C2_053 - C2_562, C1_175],
    [C1_175 - C0_899, C1_175 - C1_961, C1_175, C1_175 - C1_961 + C0_298 - C0_899],
];

/// Dequantised coefficients of a block.
pub(super) struct Coefficients {
    /// Row-major, with the vertical frequency as the row.
    values: [i16; BLOCK_LEN],
    /// Zigzag index of the last nonzero AC coefficient, or 0.
    last: usize,
}

impl Coefficients {
    /// Creates a block from its DC coefficient.
    #[inline(always)]
    pub(super) fn new(first: i16, quantisation: u16) -> Self {
        let mut values = [0; BLOCK_LEN];
        values[0] = dequantised(first, quantisation);
        Self { values, last: 0 }
    }

    /// Sets the coefficient at zigzag index `place`, below 64. Must be called with increasing `place`.
    #[inline(always)]
    pub(super) fn set(&mut self, place: usize, value: i16, quantisation: u16) {
        self.values[usize::from(ZIGZAG[place]) % BLOCK_LEN] = dequantised(value, quantisation);
        self.last = place;
    }

    /// Computes the samples, row by row.
    #[inline(always)]
    pub(super) fn samples(&self) -> [u8; BLOCK_LEN] {
        if self.last == 0 {
            let value = ((i32::from(self.values[0]) + (1 << (SCALE_BITS - 1))) >> SCALE_BITS) + i32::from(CENTRE);
            return [value.clamp(0, 255) as u8; BLOCK_LEN];
        }
        if self.last < FIRST_BEYOND_HALF {
            transform::<{ BLOCK / 2 }>(&self.values)
        } else {
            transform::<BLOCK>(&self.values)
        }
    }
}

/// Wraps on overflow, which does not occur in valid files.
#[inline(always)]
fn dequantised(value: i16, quantisation: u16) -> i16 {
    value.wrapping_mul(quantisation as i16)
}

/// Transforms a block in which only the first `COUNT` frequencies in both directions are nonzero.
#[inline(never)]
fn transform<const COUNT: usize>(values: &[i16; BLOCK_LEN]) -> [u8; BLOCK_LEN] {
    let columns_done = pass::<COUNT, { CONSTANT_BITS - BETWEEN_BITS }>(values);
    let rows_done = pass::<COUNT, { CONSTANT_BITS + BETWEEN_BITS + SCALE_BITS }>(&transposed(&columns_done));
    let mut samples = [0; BLOCK_LEN];
    for (sample, value) in samples.iter_mut().zip(rows_done) {
        *sample = (value.clamp(-CENTRE, CENTRE - 1) + CENTRE) as u8;
    }
    transposed(&samples)
}

/// Transforms all columns and drops `SHIFT` bits. Only the first `COUNT` frequencies are nonzero.
#[inline(always)]
fn pass<const COUNT: usize, const SHIFT: u32>(input: &[i16; BLOCK_LEN]) -> [i16; BLOCK_LEN] {
    let mut output = [0; BLOCK_LEN];
    // The columns are independent, so compilers vectorise this loop.
    for column in 0..BLOCK {
        let mut x = [0; BLOCK];
        for frequency in 0..COUNT {
            x[frequency] = i32::from(input[BLOCK * frequency + column]);
        }
        let sum = (x[0] + x[4]) << CONSTANT_BITS;
        let difference = (x[0] - x[4]) << CONSTANT_BITS;
        let outer = x[2] * EVEN[0][0] + x[6] * EVEN[0][1];
        let inner = x[2] * EVEN[1][0] + x[6] * EVEN[1][1];
        let even = [sum + outer, difference + inner, difference - inner, sum - outer];
        for k in 0..4 {
            let odd = x[1] * ODD[k][0] + x[3] * ODD[k][1] + x[5] * ODD[k][2] + x[7] * ODD[k][3];
            output[BLOCK * k + column] = rounded::<SHIFT>(even[k] + odd);
            output[BLOCK * (BLOCK - 1 - k) + column] = rounded::<SHIFT>(even[k] - odd);
        }
    }
    output
}

/// Divides by a power of two, rounds, and clamps to 16 bits.
#[inline(always)]
fn rounded<const SHIFT: u32>(value: i32) -> i16 {
    ((value + (1 << (SHIFT - 1))) >> SHIFT).clamp(i32::from(i16::MIN), i32::from(i16::MAX)) as i16
}

/// Transposes a block. An index has three bits for the row and three for the column. A perfect shuffle, which vector
/// instructions can do at once, rotates all six by one.
#[inline(always)]
fn transposed<T: Copy + Default>(block: &[T; BLOCK_LEN]) -> [T; BLOCK_LEN] {
    shuffled(&shuffled(&shuffled(block)))
}

#[inline(always)]
fn shuffled<T: Copy + Default>(values: &[T; BLOCK_LEN]) -> [T; BLOCK_LEN] {
    let mut mixed = [T::default(); BLOCK_LEN];
    for at in 0..BLOCK_LEN / 2 {
        mixed[2 * at] = values[at];
        mixed[2 * at + 1] = values[at + BLOCK_LEN / 2];
    }
    mixed
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_1_SQRT_2, PI};

    /// Computes a sample by the definition (T.81 A.3.3).
    fn exact(values: &[i16; BLOCK_LEN], x: usize, y: usize) -> f64 {
        let wave = |frequency: usize, at: usize| {
            let scale = if frequency == 0 { FRAC_1_SQRT_2 } else { 1.0 };
            scale * ((2 * at + 1) as f64 * frequency as f64 * PI / 16.0).cos()
        };
        let terms = (0..BLOCK_LEN).map(|k| f64::from(values[k]) * wave(k % BLOCK, x) * wave(k / BLOCK, y));
        terms.sum::<f64>() / 4.0 + f64::from(CENTRE)
    }

    fn check(coefficients: &Coefficients) {
        let samples = coefficients.samples();
        assert_eq!(samples, transform::<BLOCK>(&coefficients.values));
        for (at, sample) in samples.iter().enumerate() {
            let expected = exact(&coefficients.values, at % BLOCK, at / BLOCK).clamp(0.0, 255.0);
            assert!((f64::from(*sample) - expected).abs() < 0.6, "{sample} {expected}");
        }
    }

    #[test]
    fn agrees_with_the_definition() {
        for first in [-200, -3, 4, 5, 77] {
            check(&Coefficients::new(first, 8));
            for last in [1, 5, FIRST_BEYOND_HALF - 1, FIRST_BEYOND_HALF, 63] {
                let mut coefficients = Coefficients::new(first, 8);
                for place in 1..=last {
                    coefficients.set(place, (place as i16 * 37 % 11 - 5) * 4 / (1 + place as i16 / 8), 3);
                }
                check(&coefficients);
            }
        }
    }

    #[test]
    fn extreme_coefficients_do_not_overflow() {
        for value in [i16::MIN, i16::MAX] {
            let values = std::array::from_fn(|k| if ODD[k % 4][k / 16] < 0 { value } else { !value });
            transform::<BLOCK>(&values);
            transform::<BLOCK>(&[value; BLOCK_LEN]);
        }
    }
}
