//! Names of result files.

use std::borrow::Cow;

/// Digits in the names of numbered results: nine hours at 30 frames per second.
const DIGITS: usize = 6;

/// The name of a frame's result files. A number is padded with zeros to six digits, so that files sort by number and
/// programs such as ffmpeg find them (`%06d`); every other name stays as it is.
pub fn padded_number(name: &str) -> Cow<'_, str> {
    if is_number(name) && name.len() < DIGITS { Cow::Owned(format!("{name:0>DIGITS$}")) } else { Cow::Borrowed(name) }
}

/// The name without leading zeros if it is a number; every other name as it is. Names of one frame, padded or not, have
/// the same.
pub fn unpadded_number(name: &str) -> &str {
    if !is_number(name) {
        return name;
    }
    match name.trim_start_matches('0') {
        "" => "0",
        digits => digits,
    }
}

fn is_number(name: &str) -> bool {
    !name.is_empty() && name.bytes().all(|byte| byte.is_ascii_digit())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_numbers_are_padded() {
        let names = ["10", "0", "000010", "1234567", "frame-000010", "1.5", "", "-3"];
        let padded = names.map(padded_number);
        assert_eq!(padded, ["000010", "000000", "000010", "1234567", "frame-000010", "1.5", "", "-3"]);
        let unpadded = names.map(unpadded_number);
        assert_eq!(unpadded, ["10", "0", "10", "1234567", "frame-000010", "1.5", "", "-3"]);
    }
}
