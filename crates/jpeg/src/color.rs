//! Conversion from the file's colour space to RGB.

/// Colour space of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ColorModel {
    /// Luma only.
    Grey,
    /// Luma and two chroma components (JFIF, ITU-R BT.601).
    YCbCr,
    /// Red, green and blue.
    Rgb,
}

/// Offset of chroma samples.
const CENTRE: i16 = 128;

// Factors of JFIF (1.402, 0.71414, 0.34414, 1.772) with 16 fractional bits. Whole multiples are subtracted and added
// separately, so that the factors fit in 16 bits.
const RED_FROM_CR: i32 = 91_881 - (1 << 16);
const GREEN_FROM_CR: i32 = (1 << 16) - 46_802;
const GREEN_FROM_CB: i32 = -22_554;
const BLUE_FROM_CB: i32 = 116_130 - (2 << 16);

/// One half with 16 fractional bits.
const HALF: i32 = 1 << 15;

/// Number of pixels converted together.
const CHUNK: usize = 64;

/// Converts a row of YCbCr samples. All slices have the same length.
pub(super) fn from_ycbcr([y, cb, cr]: [&[u8]; 3], pixels: &mut [[u8; 3]]) {
    let (chunks, rest) = pixels.as_chunks_mut();
    let ((ys, y_rest), (cbs, cb_rest), (crs, cr_rest)) = (y.as_chunks(), cb.as_chunks(), cr.as_chunks());
    let (mut red_green, mut blue) = ([0; CHUNK], [0; CHUNK]);
    for (((pixels, y), cb), cr) in chunks.iter_mut().zip(ys).zip(cbs).zip(crs) {
        convert_chunk([y, cb, cr], &mut red_green, &mut blue);
        interleave(&red_green, &blue, pixels);
    }
    for (((pixel, y), cb), cr) in rest.iter_mut().zip(y_rest).zip(cb_rest).zip(cr_rest) {
        *pixel = rgb(*y, *cb, *cr);
    }
}

/// Converts pixels to red (low byte) combined with green, and blue. A separate function, so that compilers vectorise
/// it.
#[inline(never)]
fn convert_chunk([y, cb, cr]: [&[u8; CHUNK]; 3], red_green: &mut [u16; CHUNK], blue: &mut [u8; CHUNK]) {
    for at in 0..CHUNK {
        let [r, g, b] = rgb(y[at], cb[at], cr[at]);
        red_green[at] = u16::from(r) | u16::from(g) << 8;
        blue[at] = b;
    }
}

/// Interleaves the output of [`convert_chunk`] into pixels, four at a time.
fn interleave(red_green: &[u16; CHUNK], blue: &[u8; CHUNK], pixels: &mut [[u8; 3]; CHUNK]) {
    let (red_green, _) = red_green.as_chunks::<4>();
    let (blue, _) = blue.as_chunks::<4>();
    let (targets, _) = pixels.as_flattened_mut().as_chunks_mut::<12>();
    for ((target, red_green), blue) in targets.iter_mut().zip(red_green).zip(blue) {
        let [rg0, rg1, rg2, rg3] = red_green.map(u64::from);
        let [b0, b1, b2, b3] = blue.map(u64::from);
        let low = rg0 | b0 << 16 | rg1 << 24 | b1 << 40 | rg2 << 48;
        let high = (b2 | rg3 << 8 | b3 << 24) as u32;
        target[..8].copy_from_slice(&low.to_le_bytes());
        target[8..].copy_from_slice(&high.to_le_bytes());
    }
}

#[inline(always)]
fn rgb(y: u8, cb: u8, cr: u8) -> [u8; 3] {
    let (y, cb, cr) = (i16::from(y), i16::from(cb) - CENTRE, i16::from(cr) - CENTRE);
    let product = |value: i16, factor: i32| i32::from(value) * factor;
    let red = y + cr + ((product(cr, RED_FROM_CR) + HALF) >> 16) as i16;
    let green = y - cr + ((product(cb, GREEN_FROM_CB) + product(cr, GREEN_FROM_CR) + HALF) >> 16) as i16;
    let blue = y + 2 * cb + ((product(cb, BLUE_FROM_CB) + HALF) >> 16) as i16;
    [red, green, blue].map(|value| value.clamp(0, 255) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_the_formula() {
        for (y, cb, cr) in [(0, 128, 128), (255, 128, 128), (76, 85, 255), (150, 44, 21), (29, 255, 107), (90, 1, 254)]
        {
            let (blue, red) = (f64::from(cb) - 128.0, f64::from(cr) - 128.0);
            let exact = [1.402 * red, -0.344_14 * blue - 0.714_14 * red, 1.772 * blue];
            let exact = exact.map(|difference| (f64::from(y) + difference).round().clamp(0.0, 255.0) as u8);
            assert_eq!(rgb(y, cb, cr), exact);
        }
    }
}
