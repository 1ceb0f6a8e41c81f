//! Text files of other programs and systems: byte order marks, UTF-16, and decimal commas.
//!
//! Editors and shells of Windows write a mark at the start of a file, which is not part of its text, or UTF-16. Programs in
//! many countries write decimal commas.

use thiserror::Error;

/// The byte order mark in UTF-8.
const UTF8_MARK: &[u8] = b"\xEF\xBB\xBF";

/// A file that is not text.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum TextError {
    /// The bytes are not UTF-8.
    #[error("bytes that are not text")]
    NotUtf8,
    /// Every other byte is zero, as in UTF-16.
    #[error("UTF-16 without a byte order mark")]
    Utf16WithoutMark,
    /// UTF-16 that ends within a character or pairs characters wrongly.
    #[error("damaged UTF-16")]
    DamagedUtf16,
    /// The mark of UTF-32.
    #[error("UTF-32")]
    Utf32,
}

/// Returns the bytes without a byte order mark in UTF-8.
pub fn without_mark(bytes: &[u8]) -> &[u8] {
    bytes.strip_prefix(UTF8_MARK).unwrap_or(bytes)
}

/// Converts the bytes of a text file to UTF-8 without a byte order mark. UTF-16 is recognised by its mark. Other bytes that
/// are not UTF-8 stay, so that the caller may skip the lines that have them.
///
/// # Errors
/// If the bytes are UTF-32, or UTF-16 that is damaged or has no mark.
pub fn utf8_bytes(mut bytes: Vec<u8>) -> Result<Vec<u8>, TextError> {
    match bytes.as_slice() {
        // The mark of UTF-16 with a zero character after it.
        [0xFF, 0xFE, 0, 0, ..] | [0, 0, 0xFE, 0xFF, ..] => Err(TextError::Utf32),
        [0xFF, 0xFE, rest @ ..] => from_utf16(rest, u16::from_le_bytes).map(String::into_bytes),
        [0xFE, 0xFF, rest @ ..] => from_utf16(rest, u16::from_be_bytes).map(String::into_bytes),
        [0xEF, 0xBB, 0xBF, ..] => {
            bytes.drain(..UTF8_MARK.len());
            Ok(bytes)
        }
        _ if looks_like_utf16(&bytes) => Err(TextError::Utf16WithoutMark),
        _ => Ok(bytes),
    }
}

/// Converts the bytes of a text file to text without a byte order mark. UTF-16 is recognised by its mark.
///
/// # Errors
/// Those of [`utf8_bytes`], and [`TextError::NotUtf8`].
pub fn text_of(bytes: Vec<u8>) -> Result<String, TextError> {
    String::from_utf8(utf8_bytes(bytes)?).map_err(|_| TextError::NotUtf8)
}

/// Returns true if a line has several numbers, and one of them has a decimal comma, as in `0,5 1,25`. Numbers that are
/// separated by commas alone have none.
pub fn has_decimal_commas(line: &str) -> bool {
    if !line.contains(',') {
        return false;
    }
    let is_separator = |letter: char| letter.is_whitespace() || letter == ';';
    let words = || line.split(is_separator).filter(|word| !word.is_empty());
    words().nth(1).is_some() && words().any(is_number_with_comma)
}

/// Returns true for a number with one comma, between digits.
pub fn is_number_with_comma(word: &str) -> bool {
    let Some((whole, fraction)) = word.trim_start_matches(['+', '-']).split_once(',') else { return false };
    let digits = fraction.split(['e', 'E']).next().unwrap_or_default();
    let are_digits = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    are_digits(whole) && are_digits(digits) && word.replace(',', ".").parse::<f64>().is_ok()
}

fn from_utf16(bytes: &[u8], unit: fn([u8; 2]) -> u16) -> Result<String, TextError> {
    let (pairs, rest) = bytes.as_chunks::<2>();
    if !rest.is_empty() {
        return Err(TextError::DamagedUtf16);
    }
    let units = pairs.iter().map(|pair| unit(*pair));
    char::decode_utf16(units).collect::<Result<String, _>>().map_err(|_| TextError::DamagedUtf16)
}

/// Returns true if the beginning of a file looks like Latin letters and digits in UTF-16.
fn looks_like_utf16(bytes: &[u8]) -> bool {
    let (pairs, _) = bytes.get(..bytes.len().min(64)).unwrap_or_default().as_chunks::<2>();
    let all = |is_letter: fn(&[u8; 2]) -> bool| pairs.len() > 1 && pairs.iter().all(is_letter);
    all(|[low, high]| *low != 0 && *high == 0) || all(|[high, low]| *low != 0 && *high == 0)
}

/// Returns a text as a cell of comma-separated values: in quotes if RFC 4180 requires it.
///
/// ```
/// use splatseg_files::csv_cell;
/// assert_eq!(csv_cell("dev-a"), "dev-a");
/// assert_eq!(csv_cell("synthetic:frames=3,seed=1"), "\"synthetic:frames=3,seed=1\"");
/// assert_eq!(csv_cell("a\"b"), "\"a\"\"b\"");
/// ```
pub fn csv_cell(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn utf16(text: &str, bytes: fn(u16) -> [u8; 2]) -> Vec<u8> {
        text.encode_utf16().flat_map(bytes).collect()
    }

    #[test]
    fn marks_and_utf16_are_read() {
        let text = "525 0 319.5\r\nä 🙂\n";
        assert_eq!(text_of(text.into()).unwrap(), text);
        let marked = format!("\u{FEFF}{text}");
        assert_eq!(text_of(marked.clone().into_bytes()).unwrap(), text);
        assert_eq!(without_mark(marked.as_bytes()), text.as_bytes());
        for bytes in [u16::to_le_bytes, u16::to_be_bytes] {
            assert_eq!(text_of(utf16(&marked, bytes)).unwrap(), text);
            assert_eq!(text_of(utf16("525 0", bytes)), Err(TextError::Utf16WithoutMark));
            let mut cut_off = utf16(&marked, bytes);
            cut_off.pop();
            assert_eq!(text_of(cut_off), Err(TextError::DamagedUtf16));
        }
        assert_eq!(text_of(vec![0xFF, 0xFE, 0, 0, b'5', 0, 0, 0]), Err(TextError::Utf32));
        assert_eq!(text_of(vec![b'5', 0xFF]), Err(TextError::NotUtf8));
        assert_eq!(utf8_bytes(vec![b'5', 0xFF]), Ok(vec![b'5', 0xFF]));
        assert_eq!((text_of(Vec::new()), utf8_bytes(vec![0])), (Ok(String::new()), Ok(vec![0])));
    }

    #[test]
    fn decimal_commas_differ_from_separators() {
        for line in ["0,5 1,25 3", "525,8\t0 319,5", "1305031102,175304 rgb/1.png", "-0,5;0;1", "1 +2,5e-3"] {
            assert!(has_decimal_commas(line), "{line}");
        }
        for line in
            ["0.5 1.25", "1,2,3,4", "1.5,2.5", "1, 2, 3", "0,5", "a,b c", "1,a 2", "1,2,3 4", "", ",", "1.5,2 3"]
        {
            assert!(!has_decimal_commas(line), "{line}");
        }
    }
}
