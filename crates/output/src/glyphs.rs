//! A tiny font: digits for segment ids, capital letters for names.

/// Width of a glyph, pixels.
const GLYPH_WIDTH: usize = 5;
/// Height of a glyph, pixels.
pub const GLYPH_HEIGHT: usize = 7;
/// Distance between the left edges of neighbouring glyphs, pixels.
const GLYPH_ADVANCE: usize = GLYPH_WIDTH + 1;

/// One row of pixels per byte; the highest of the five bits is the leftmost pixel.
const DIGITS: [[u8; GLYPH_HEIGHT]; 10] = [
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

/// The letters from A to Z, as [`DIGITS`].
const LETTERS: [[u8; GLYPH_HEIGHT]; 26] = [
    [0b01110, 0b10001, 0b10001, 0b11111, 0b10001, 0b10001, 0b10001],
    [0b11110, 0b10001, 0b10001, 0b11110, 0b10001, 0b10001, 0b11110],
    [0b01110, 0b10001, 0b10000, 0b10000, 0b10000, 0b10001, 0b01110],
    [0b11100, 0b10010, 0b10001, 0b10001, 0b10001, 0b10010, 0b11100],
    [0b11111, 0b10000, 0b10000, 0b11110, 0b10000, 0b10000, 0b11111],
    [0b11111, 0b10000, 0b10000, 0b11110, 0b10000, 0b10000, 0b10000],
    [0b01110, 0b10001, 0b10000, 0b10011, 0b10001, 0b10001, 0b01111],
    [0b10001, 0b10001, 0b10001, 0b11111, 0b10001, 0b10001, 0b10001],
    [0b01110, 0b00100, 0b00100, 0b00100, 0b00100, 0b00100, 0b01110],
    [0b00111, 0b00010, 0b00010, 0b00010, 0b00010, 0b10010, 0b01100],
    [0b10001, 0b10010, 0b10100, 0b11000, 0b10100, 0b10010, 0b10001],
    [0b10000, 0b10000, 0b10000, 0b10000, 0b10000, 0b10000, 0b11111],
    [0b10001, 0b11011, 0b10101, 0b10101, 0b10001, 0b10001, 0b10001],
    [0b10001, 0b11001, 0b11001, 0b10101, 0b10011, 0b10011, 0b10001],
    [0b01110, 0b10001, 0b10001, 0b10001, 0b10001, 0b10001, 0b01110],
    [0b11110, 0b10001, 0b10001, 0b11110, 0b10000, 0b10000, 0b10000],
    [0b01110, 0b10001, 0b10001, 0b10001, 0b10101, 0b10010, 0b01101],
    [0b11110, 0b10001, 0b10001, 0b11110, 0b10100, 0b10010, 0b10001],
    [0b01111, 0b10000, 0b10000, 0b01110, 0b00001, 0b00001, 0b11110],
    [0b11111, 0b00100, 0b00100, 0b00100, 0b00100, 0b00100, 0b00100],
    [0b10001, 0b10001, 0b10001, 0b10001, 0b10001, 0b10001, 0b01110],
    [0b10001, 0b10001, 0b10001, 0b10001, 0b01010, 0b01010, 0b00100],
    [0b10001, 0b10001, 0b10001, 0b10101, 0b10101, 0b11011, 0b10001],
    [0b10001, 0b10001, 0b01010, 0b00100, 0b01010, 0b10001, 0b10001],
    [0b10001, 0b10001, 0b01010, 0b00100, 0b00100, 0b00100, 0b00100],
    [0b11111, 0b00001, 0b00010, 0b00100, 0b01000, 0b10000, 0b11111],
];
/// Drawn for what the font lacks.
const BLANK: [u8; GLYPH_HEIGHT] = [0; GLYPH_HEIGHT];
const HYPHEN: [u8; GLYPH_HEIGHT] = [0, 0, 0, 0b01110, 0, 0, 0];
const POINT: [u8; GLYPH_HEIGHT] = [0, 0, 0, 0, 0, 0b01100, 0b01100];

/// Rows of a character. Letters are drawn as capitals.
fn glyph(character: char) -> &'static [u8; GLYPH_HEIGHT] {
    let place = |first: char| (character.to_ascii_uppercase() as usize).wrapping_sub(first as usize);
    match character {
        '-' | '_' => &HYPHEN,
        '.' => &POINT,
        _ => DIGITS.get(place('0')).or_else(|| LETTERS.get(place('A'))).unwrap_or(&BLANK),
    }
}

/// Width of a text on one line, pixels. Digits, letters of English, hyphens and points are drawn; anything else is left
/// blank.
pub fn text_width(text: &str) -> usize {
    (text.chars().count() * GLYPH_ADVANCE).saturating_sub(1)
}

/// The `(column, row)` of every set pixel of a text on one line, relative to its upper left corner.
pub fn text_pixels(text: &str) -> Vec<(usize, usize)> {
    let mut pixels = Vec::new();
    for (place, character) in text.chars().enumerate() {
        for (row, bits) in glyph(character).iter().enumerate() {
            let columns = (0..GLYPH_WIDTH).filter(|column| bits >> (GLYPH_WIDTH - 1 - column) & 1 == 1);
            pixels.extend(columns.map(|column| (place * GLYPH_ADVANCE + column, row)));
        }
    }
    pixels
}
