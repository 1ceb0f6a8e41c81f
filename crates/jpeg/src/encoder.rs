//! A JPEG encoder: baseline, chroma at half the resolution (4:2:0), the Huffman tables of the standard's annex K.
//!
//! The forward transform is that of Arai, Agui and Nakajima (1988) in floating point: its scale factors are part of the
//! quantisation. Blocks are transformed eight columns at a time, which compilers turn into vector code.

use std::f32::consts::FRAC_1_SQRT_2;
use thiserror::Error;

/// Samples on a side of a block.
const SIDE: usize = 8;
/// Pixels on a side of a minimum coded unit: four blocks of luma, one of each chroma.
const UNIT: usize = 2 * SIDE;
/// The largest width and height that a frame header can state.
const MAX_SIZE: usize = 65_535;

/// A block, row by row.
type Block = [[f32; SIDE]; SIDE];

/// Position in a block, row by row, of each coefficient in zigzag order (T.81 figure A.6).
const ZIGZAG: [u8; 64] = [
    0, 1, 8, 16, 9, 2, 3, 10, 17, 24, 32, 25, 18, 11, 4, 5, 12, 19, 26, 33, 40, 48, 41, 34, 27, 20, 13, 6, 7, 14, 21,
    28, 35, 42, 49, 56, 57, 50, 43, 36, 29, 22, 15, 23, 30, 37, 44, 51, 58, 59, 52, 45, 38, 31, 39, 46, 53, 60, 61, 54,
    47, 55, 62, 63,
];

/// Quantisation of luma at quality 50, row by row (T.81 table K.1).
const LUMA_STEPS: [u16; 64] = [
    16, 11, 10, 16, 24, 40, 51, 61, 12, 12, 14, 19, 26, 58, 60, 55, 14, 13, 16, 24, 40, 57, 69, 56, 14, 17, 22, 29, 51,
    87, 80, 62, 18, 22, 37, 56, 68, 109, 103, 77, 24, 35, 55, 64, 81, 104, 113, 92, 49, 64, 78, 87, 103, 121, 120, 101,
    72, 92, 95, 98, 112, 100, 103, 99,
];
/// Quantisation of chroma at quality 50, row by row (T.81 table K.2).
const CHROMA_STEPS: [u16; 64] = [
    17, 18, 24, 47, 99, 99, 99, 99, 18, 21, 26, 66, 99, 99, 99, 99, 24, 26, 56, 99, 99, 99, 99, 99, 47, 66, 99, 99, 99,
    99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99,
    99, 99, 99, 99, 99, 99,
];

/// A Huffman table as files have it: how many codes have 1 to 16 bits, and their symbols (T.81 tables K.3 to K.6).
struct CodeTable {
    counts: [u8; 16],
    symbols: &'static [u8],
}

const LUMA_DC: CodeTable = CodeTable {
    counts: [0, 1, 5, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0],
    symbols: &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11],
};
const CHROMA_DC: CodeTable = CodeTable {
    counts: [0, 3, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0],
    symbols: &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11],
};
const LUMA_AC: CodeTable = CodeTable {
    counts: [0, 2, 1, 3, 3, 2, 4, 3, 5, 5, 4, 4, 0, 0, 1, 0x7D],
    symbols: &[
        0x01, 0x02, 0x03, 0x00, 0x04, 0x11, 0x05, 0x12, 0x21, 0x31, 0x41, 0x06, 0x13, 0x51, 0x61, 0x07, 0x22, 0x71,
        0x14, 0x32, 0x81, 0x91, 0xA1, 0x08, 0x23, 0x42, 0xB1, 0xC1, 0x15, 0x52, 0xD1, 0xF0, 0x24, 0x33, 0x62, 0x72,
        0x82, 0x09, 0x0A, 0x16, 0x17, 0x18, 0x19, 0x1A, 0x25, 0x26, 0x27, 0x28, 0x29, 0x2A, 0x34, 0x35, 0x36, 0x37,
        0x38, 0x39, 0x3A, 0x43, 0x44, 0x45, 0x46, 0x47, 0x48, 0x49, 0x4A, 0x53, 0x54, 0x55, 0x56, 0x57, 0x58, 0x59,
        0x5A, 0x63, 0x64, 0x65, 0x66, 0x67, 0x68, 0x69, 0x6A, 0x73, 0x74, 0x75, 0x76, 0x77, 0x78, 0x79, 0x7A, 0x83,
        0x84, 0x85, 0x86, 0x87, 0x88, 0x89, 0x8A, 0x92, 0x93, 0x94, 0x95, 0x96, 0x97, 0x98, 0x99, 0x9A, 0xA2, 0xA3,
        0xA4, 0xA5, 0xA6, 0xA7, 0xA8, 0xA9, 0xAA, 0xB2, 0xB3, 0xB4, 0xB5, 0xB6, 0xB7, 0xB8, 0xB9, 0xBA, 0xC2, 0xC3,
        0xC4, 0xC5, 0xC6, 0xC7, 0xC8, 0xC9, 0xCA, 0xD2, 0xD3, 0xD4, 0xD5, 0xD6, 0xD7, 0xD8, 0xD9, 0xDA, 0xE1, 0xE2,
        0xE3, 0xE4, 0xE5, 0xE6, 0xE7, 0xE8, 0xE9, 0xEA, 0xF1, 0xF2, 0xF3, 0xF4, 0xF5, 0xF6, 0xF7, 0xF8, 0xF9, 0xFA,
    ],
};
const CHROMA_AC: CodeTable = CodeTable {
    counts: [0, 2, 1, 2, 4, 4, 3, 4, 7, 5, 4, 4, 0, 1, 2, 0x77],
    symbols: &[
        0x00, 0x01, 0x02, 0x03, 0x11, 0x04, 0x05, 0x21, 0x31, 0x06, 0x12, 0x41, 0x51, 0x07, 0x61, 0x71, 0x13, 0x22,
        0x32, 0x81, 0x08, 0x14, 0x42, 0x91, 0xA1, 0xB1, 0xC1, 0x09, 0x23, 0x33, 0x52, 0xF0, 0x15, 0x62, 0x72, 0xD1,
        0x0A, 0x16, 0x24, 0x34, 0xE1, 0x25, 0xF1, 0x17, 0x18, 0x19, 0x1A, 0x26, 0x27, 0x28, 0x29, 0x2A, 0x35, 0x36,
        0x37, 0x38, 0x39, 0x3A, 0x43, 0x44, 0x45, 0x46, 0x47, 0x48, 0x49, 0x4A, 0x53, 0x54, 0x55, 0x56, 0x57, 0x58,
        0x59, 0x5A, 0x63, 0x64, 0x65, 0x66, 0x67, 0x68, 0x69, 0x6A, 0x73, 0x74, 0x75, 0x76, 0x77, 0x78, 0x79, 0x7A,
        0x82, 0x83, 0x84, 0x85, 0x86, 0x87, 0x88, 0x89, 0x8A, 0x92, 0x93, 0x94, 0x95, 0x96, 0x97, 0x98, 0x99, 0x9A,
        0xA2, 0xA3, 0xA4, 0xA5, 0xA6, 0xA7, 0xA8, 0xA9, 0xAA, 0xB2, 0xB3, 0xB4, 0xB5, 0xB6, 0xB7, 0xB8, 0xB9, 0xBA,
        0xC2, 0xC3, 0xC4, 0xC5, 0xC6, 0xC7, 0xC8, 0xC9, 0xCA, 0xD2, 0xD3, 0xD4, 0xD5, 0xD6, 0xD7, 0xD8, 0xD9, 0xDA,
        0xE2, 0xE3, 0xE4, 0xE5, 0xE6, 0xE7, 0xE8, 0xE9, 0xEA, 0xF2, 0xF3, 0xF4, 0xF5, 0xF6, 0xF7, 0xF8, 0xF9, 0xFA,
    ],
};

/// Why an image cannot be encoded.
#[derive(Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum EncodeError {
    /// JPEG has no images of this size.
    #[error("an image of {0}x{1} pixels cannot be a JPEG: 1 to {MAX_SIZE} are possible on each side")]
    Size(usize, usize),
    /// The number of pixels is not that of the size.
    #[error("{pixels} pixels are no image of {width}x{height}")]
    PixelCount {
        /// Number of pixels.
        pixels: usize,
        /// Stated width.
        width: usize,
        /// Stated height.
        height: usize,
    },
}

/// Encodes an RGB image, row-major, at a quality of 1 to 100 (others are taken as the nearest of these, with libjpeg's
/// scale of steps). Runs on the calling thread; the same input gives the same bytes.
///
/// # Errors
/// [`EncodeError`] if a side is 0 or above 65,535, or the number of pixels is another.
pub fn encode(pixels: &[[u8; 3]], width: usize, height: usize, quality: u8) -> Result<Vec<u8>, EncodeError> {
    if [width, height].iter().any(|side| !(1..=MAX_SIZE).contains(side)) {
        return Err(EncodeError::Size(width, height));
    }
    if pixels.len() != width * height {
        return Err(EncodeError::PixelCount { pixels: pixels.len(), width, height });
    }
    let steps = [scaled(&LUMA_STEPS, quality), scaled(&CHROMA_STEPS, quality)];
    let mut bytes = Vec::with_capacity(pixels.len() / 2 + 1024);
    write_header(&mut bytes, (width as u16, height as u16), &steps);
    let luma = Channel::new(&steps[0], &LUMA_DC, &LUMA_AC);
    let chroma = Channel::new(&steps[1], &CHROMA_DC, &CHROMA_AC);
    let mut bits = BitWriter { bytes, held: 0, count: 0 };
    let mut last = [0; 3];
    let mut rows = UnitRow::new(width);
    for top in (0..height).step_by(UNIT) {
        rows.load(pixels, width, height, top);
        for left in (0..rows.width).step_by(UNIT) {
            for (row, column) in [(0, 0), (0, SIDE), (SIDE, 0), (SIDE, SIDE)] {
                luma.write(&mut bits, rows.luma_block(row, left + column), &mut last[0]);
            }
            for (index, plane) in rows.chroma.iter().enumerate() {
                chroma.write(&mut bits, block(plane, rows.width / 2, 0, left / 2), &mut last[1 + index]);
            }
        }
    }
    let mut bytes = bits.finish();
    bytes.extend([0xFF, 0xD9]);
    Ok(bytes)
}

/// A table of steps for a quality, row by row.
fn scaled(steps: &[u16; 64], quality: u8) -> [u8; 64] {
    let quality = u32::from(quality.clamp(1, 100));
    let percent = if quality < 50 { 5000 / quality } else { 200 - 2 * quality };
    steps.map(|step| ((u32::from(step) * percent + 50) / 100).clamp(1, 255) as u8)
}

/// Writes all segments before the compressed data.
fn write_header(bytes: &mut Vec<u8>, (width, height): (u16, u16), steps: &[[u8; 64]; 2]) {
    let segment = |bytes: &mut Vec<u8>, marker: u8, content: &[u8]| {
        bytes.extend([0xFF, marker]);
        bytes.extend((content.len() as u16 + 2).to_be_bytes());
        bytes.extend(content);
    };
    bytes.extend([0xFF, 0xD8]);
    // JFIF 1.1, square pixels, no thumbnail.
    segment(bytes, 0xE0, b"JFIF\0\x01\x01\0\0\x01\0\x01\0\0");
    for (number, steps) in steps.iter().enumerate() {
        let in_order = ZIGZAG.map(|position| steps[usize::from(position)]);
        segment(bytes, 0xDB, &[&[number as u8], &in_order[..]].concat());
    }
    let size = [height.to_be_bytes(), width.to_be_bytes()].concat();
    segment(bytes, 0xC0, &[&[8], &size[..], &[3, 1, 0x22, 0, 2, 0x11, 1, 3, 0x11, 1]].concat());
    for (class, table) in [(0x00, &LUMA_DC), (0x10, &LUMA_AC), (0x01, &CHROMA_DC), (0x11, &CHROMA_AC)] {
        segment(bytes, 0xC4, &[&[class], &table.counts[..], table.symbols].concat());
    }
    segment(bytes, 0xDA, &[3, 1, 0x00, 2, 0x11, 3, 0x11, 0, 63, 0]);
}

/// The samples of one row of coded units, around 0, and as wide as whole units. Beyond the image its last pixels are
/// repeated.
struct UnitRow {
    width: usize,
    luma: Vec<f32>,
    /// Cb and Cr, at half the resolution.
    chroma: [Vec<f32>; 2],
    /// Two rows of Cb and Cr at the image's resolution.
    full: [Vec<f32>; 4],
}

impl UnitRow {
    fn new(width: usize) -> Self {
        let width = width.div_ceil(UNIT) * UNIT;
        let plane = || vec![0.0; width / 2 * SIDE];
        let full = || vec![0.0; width];
        Self {
            width,
            luma: vec![0.0; width * UNIT],
            chroma: [plane(), plane()],
            full: [full(), full(), full(), full()],
        }
    }

    fn load(&mut self, pixels: &[[u8; 3]], width: usize, height: usize, top: usize) {
        for pair in 0..SIDE {
            for odd in 0..2 {
                let row = 2 * pair + odd;
                let source = (top + row).min(height - 1) * width;
                let luma = &mut self.luma[row * self.width..][..self.width];
                let [blue, red] = &mut self.full[2 * odd..2 * odd + 2] else { unreachable!("two rows of each") };
                convert(&pixels[source..source + width], luma, blue, red);
            }
            for (chroma, plane) in self.chroma.iter_mut().enumerate() {
                let into = &mut plane[pair * self.width / 2..][..self.width / 2];
                let (upper, lower) = (&self.full[chroma], &self.full[2 + chroma]);
                for ((mean, upper), lower) in into.iter_mut().zip(upper.chunks_exact(2)).zip(lower.chunks_exact(2)) {
                    *mean = 0.25 * (upper[0] + upper[1] + lower[0] + lower[1]);
                }
            }
        }
    }

    fn luma_block(&self, row: usize, column: usize) -> Block {
        block(&self.luma, self.width, row, column)
    }
}

/// One row of pixels as luma and chroma around 0 (JFIF 1.02), its last pixel repeated to the end.
fn convert(pixels: &[[u8; 3]], luma: &mut [f32], blue: &mut [f32], red: &mut [f32]) {
    let (luma, luma_rest) = luma.split_at_mut(pixels.len());
    let (blue, blue_rest) = blue.split_at_mut(pixels.len());
    let (red, red_rest) = red.split_at_mut(pixels.len());
    for (((pixel, luma), blue), red) in pixels.iter().zip(&mut *luma).zip(&mut *blue).zip(&mut *red) {
        let [r, g, b] = pixel.map(f32::from);
        *luma = 0.299 * r + 0.587 * g + 0.114 * b - 128.0;
        *blue = -0.168_735_9 * r - 0.331_264_1 * g + 0.5 * b;
        *red = 0.5 * r - 0.418_687_6 * g - 0.081_312_4 * b;
    }
    for (row, rest) in [(&*luma, luma_rest), (&*blue, blue_rest), (&*red, red_rest)] {
        rest.fill(row[row.len() - 1]);
    }
}

/// The block of a plane at a row and column.
fn block(plane: &[f32], width: usize, top: usize, left: usize) -> Block {
    std::array::from_fn(|row| {
        let at = (top + row) * width + left;
        std::array::from_fn(|column| plane[at + column])
    })
}

/// How the blocks of luma or of chroma are written.
struct Channel {
    /// Factor of each coefficient, `[column][row]`: the inverse of its step and of the transform's scale.
    factors: Block,
    dc: [Code; 16],
    ac: Box<[Code; 256]>,
}

/// A Huffman code: its bits and their number.
#[derive(Clone, Copy, Default)]
struct Code {
    bits: u16,
    count: u8,
}

impl Channel {
    fn new(steps: &[u8; 64], dc: &CodeTable, ac: &CodeTable) -> Self {
        const SCALES: [f32; SIDE] = [1.0, 1.387_04, 1.306_563, 1.175_876, 1.0, 0.785_695, 0.541_196, 0.275_899];
        let factor = |row: usize, column: usize| {
            1.0 / (f32::from(steps[SIDE * row + column]) * SCALES[row] * SCALES[column] * SIDE as f32)
        };
        let (mut dc_codes, mut ac_codes) = ([Code::default(); 16], Box::new([Code::default(); 256]));
        dc.fill(&mut dc_codes);
        ac.fill(&mut ac_codes[..]);
        let factors = std::array::from_fn(|column| std::array::from_fn(|row| factor(row, column)));
        Self { factors, dc: dc_codes, ac: ac_codes }
    }

    /// Transforms, quantises and codes a block. `last` is the first coefficient of the block before it.
    fn write(&self, bits: &mut BitWriter, mut samples: Block, last: &mut i32) {
        transform(&mut samples);
        samples = transposed(&samples);
        transform(&mut samples);
        // Transposed: [column][row].
        let mut quantised = [[0i16; SIDE]; SIDE];
        for ((out, samples), factors) in quantised.iter_mut().zip(&samples).zip(&self.factors) {
            for ((out, sample), factor) in out.iter_mut().zip(samples).zip(factors) {
                let value = sample * factor;
                *out = (value + 0.5_f32.copysign(value)) as i16;
            }
        }
        let quantised = quantised.as_flattened();
        // Coefficients in zigzag order, and a bit for each that is not 0.
        let mut in_order = [0i16; 64];
        let mut set = 0u64;
        for (index, (value, position)) in in_order.iter_mut().zip(ZIGZAG).enumerate() {
            *value = quantised[usize::from(position % 8 * 8 + position / 8)];
            set |= u64::from(*value != 0) << index;
        }
        let first = i32::from(in_order[0]);
        bits.put_value(&self.dc, 0, first - *last);
        *last = first;
        let mut done = 0;
        set &= !1;
        while set != 0 {
            let index = set.trailing_zeros();
            let mut run = index - done - 1;
            while run > 15 {
                bits.put(self.ac[0xF0]);
                run -= 16;
            }
            bits.put_value(&self.ac[..], run as usize, i32::from(in_order[index as usize]));
            done = index;
            set &= set - 1;
        }
        if done < 63 {
            bits.put(self.ac[0]);
        }
    }
}

impl CodeTable {
    /// Writes the code of each symbol (T.81 annex C).
    fn fill(&self, codes: &mut [Code]) {
        let mut symbols = self.symbols.iter();
        let mut next = 0;
        for (length, count) in (1..).zip(self.counts) {
            for symbol in symbols.by_ref().take(usize::from(count)) {
                codes[usize::from(*symbol)] = Code { bits: next, count: length };
                next += 1;
            }
            next <<= 1;
        }
    }
}

/// Transforms along the rows' index, all columns at once (Arai, Agui and Nakajima), without its scale.
fn transform(v: &mut Block) {
    let add = |a: [f32; SIDE], b: [f32; SIDE]| -> [f32; SIDE] { std::array::from_fn(|i| a[i] + b[i]) };
    let sub = |a: [f32; SIDE], b: [f32; SIDE]| -> [f32; SIDE] { std::array::from_fn(|i| a[i] - b[i]) };
    let mul = |a: [f32; SIDE], factor: f32| -> [f32; SIDE] { a.map(|a| a * factor) };
    let (s0, d0) = (add(v[0], v[7]), sub(v[0], v[7]));
    let (s1, d1) = (add(v[1], v[6]), sub(v[1], v[6]));
    let (s2, d2) = (add(v[2], v[5]), sub(v[2], v[5]));
    let (s3, d3) = (add(v[3], v[4]), sub(v[3], v[4]));
    let (outer, inner) = (add(s0, s3), add(s1, s2));
    v[0] = add(outer, inner);
    v[4] = sub(outer, inner);
    let difference = sub(s0, s3);
    let turned = mul(add(sub(s1, s2), difference), FRAC_1_SQRT_2);
    v[2] = add(difference, turned);
    v[6] = sub(difference, turned);
    let (low, middle, high) = (add(d3, d2), add(d2, d1), add(d1, d0));
    let common = mul(sub(low, high), 0.382_683_4);
    let low = add(mul(low, 0.541_196_1), common);
    let high = add(mul(high, 1.306_563), common);
    let middle = mul(middle, FRAC_1_SQRT_2);
    let (sum, rest) = (add(d0, middle), sub(d0, middle));
    v[5] = add(rest, low);
    v[3] = sub(rest, low);
    v[1] = add(sum, high);
    v[7] = sub(sum, high);
}

fn transposed(block: &Block) -> Block {
    std::array::from_fn(|column| std::array::from_fn(|row| block[row][column]))
}

/// Collects bits, the first one highest, with a 0 byte after each 0xFF.
struct BitWriter {
    bytes: Vec<u8>,
    held: u64,
    count: u32,
}

impl BitWriter {
    fn put(&mut self, code: Code) {
        self.put_bits(u32::from(code.bits), u32::from(code.count));
    }

    /// Writes a value: the code of `run` zeros before it and of its size, and its bits (T.81 F.1.2).
    fn put_value(&mut self, codes: &[Code], run: usize, value: i32) {
        let size = 32 - value.unsigned_abs().leading_zeros();
        let code = codes[run << 4 | size as usize];
        let bits = (value + (value >> 31)) as u32 & ((1 << size) - 1);
        self.put_bits(u32::from(code.bits) << size | bits, u32::from(code.count) + size);
    }

    fn put_bits(&mut self, bits: u32, count: u32) {
        self.held = self.held << count | u64::from(bits);
        self.count += count;
        while self.count >= 8 {
            self.count -= 8;
            let byte = (self.held >> self.count) as u8;
            self.bytes.push(byte);
            if byte == 0xFF {
                self.bytes.push(0);
            }
        }
    }

    /// Fills the last byte with ones.
    fn finish(mut self) -> Vec<u8> {
        self.put_bits(0x7F, 7);
        self.bytes
    }
}
