//! Names of result files.

use std::borrow::Cow;

/// Digits in the names of numbered results, enough for nine hours at 30 frames per second.
const DIGITS: usize = 6;

/// Returns the name of a frame's result files. Numbers are zero-padded to six digits, so that files sort by number and
/// programs such as ffmpeg find them (`%06d`). Other names are unchanged.
pub fn padded_number(name: &str) -> Cow<'_, str> {
    if is_number(name) && name.len() < DIGITS { Cow::Owned(format!("{name:0>DIGITS$}")) } else { Cow::Borrowed(name) }
}

/// Removes leading zeros if the name is a number. Other names are unchanged. Padded and unpadded names of one frame
/// give the same result.
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
