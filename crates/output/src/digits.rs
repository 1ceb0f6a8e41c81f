//! A tiny font for segment ids.

/// Width of a digit, pixels.
pub(super) const DIGIT_WIDTH: usize = 5;
/// Height of a digit, pixels.
pub(super) const DIGIT_HEIGHT: usize = 7;
/// Distance between the left edges of neighbouring digits, pixels.
pub(super) const DIGIT_ADVANCE: usize = DIGIT_WIDTH + 1;

/// One row of pixels per byte; the highest of the five bits is the leftmost pixel.
const GLYPHS: [[u8; DIGIT_HEIGHT]; 10] = [
    [0b01110, 0b10001, 0b10011, 0b10101, 0b11001, 0b10001, 0b01110],
    [0b00100, 0b01100, 0b00100, 0b00100, 0b00100, 0b00100, 0b01110],
    [0b01110, 0b10001, 0b00001, 0b00110, 0b01000, 0b10000, 0b11111],
    [0b11110, 0b00001, 0b00001, 0b01110, 0b00001, 0b00001, 0b11110],
    [0b00010, 0b00110, 0b01010, 0b10010, 0b11111, 0b00010, 0b00010],
    [0b11111, 0b10000, 0b11110, 0b00001, 0b00001, 0b10001, 0b01110],
    [0b00110, 0b01000, 0b10000, 0b11110, 0b10001, 0b10001, 0b01110],
    [0b11111, 0b00001, 0b00010, 0b00100, 0b01000, 0b01000, 0b01000],
    [0b01110, 0b10001, 0b10001, 0b01110, 0b10001, 0b10001, 0b01110],
    [0b01110, 0b10001, 0b10001, 0b01111, 0b00001, 0b00010, 0b01100],
];

/// The decimal digits of a number.
pub(super) fn decimal_digits(number: u32) -> Vec<u8> {
    number.to_string().bytes().map(|byte| byte - b'0').collect()
}

/// Width of digits written side by side, pixels.
pub(super) fn text_width(digits: &[u8]) -> usize {
    (digits.len() * DIGIT_ADVANCE).saturating_sub(1)
}

/// The `(column, row)` of every set pixel of digits written side by side, relative to their upper left corner.
pub(super) fn text_pixels(digits: &[u8]) -> Vec<(usize, usize)> {
    let mut pixels = Vec::new();
    for (place, digit) in digits.iter().enumerate() {
        for (row, bits) in GLYPHS[usize::from(*digit) % 10].iter().enumerate() {
            let columns = (0..DIGIT_WIDTH).filter(|column| bits >> (DIGIT_WIDTH - 1 - column) & 1 == 1);
            pixels.extend(columns.map(|column| (place * DIGIT_ADVANCE + column, row)));
        }
    }
    pixels
}
