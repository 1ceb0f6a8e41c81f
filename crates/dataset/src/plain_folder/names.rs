//! Names, order and times of the images in a plain folder.

use crate::DatasetError;
use crate::listing::all_names_in;
use crate::stamps::{Stamp, TimeScale, TimeUnit};
use std::cmp::Ordering;
use std::path::{Path, PathBuf};

/// Folders of the images.
pub(super) const COLOR_FOLDER: &str = "color";
pub(super) const DEPTH_FOLDER: &str = "depth";
/// Digits of a time since 1970 in other units than seconds. ROS names files by nanoseconds.
const DIGITS: [(usize, TimeUnit); 3] =
    [(13, TimeUnit::Milliseconds), (16, TimeUnit::Microseconds), (19, TimeUnit::Nanoseconds)];

/// An image and its name without the extension.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct NamedImage {
    pub(super) stem: String,
    pub(super) path: PathBuf,
    /// Its time in seconds, if its name is one.
    pub(super) seconds: Option<f64>,
}

/// How two files are treated whose names differ only in the extension.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Twins {
    /// They are an error.
    Refused,
    /// The one whose extension comes first is read: the same depth may be stored twice, for different programs.
    FirstEnding,
}

/// The images of a folder.
#[derive(Debug)]
pub(super) struct Images {
    /// Sorted by time if all stems are times, otherwise by name.
    pub(super) images: Vec<NamedImage>,
    /// Number of files whose names are not UTF-8.
    pub(super) unreadable: usize,
}

impl Images {
    /// Lists the files with one of these extensions, in lower or upper case. Hidden files are skipped.
    ///
    /// # Errors
    /// If the folder cannot be read, or contains two files with the same stem that `twins` does not allow.
    pub(super) fn list(folder: &Path, endings: &[&str], twins: Twins) -> Result<Self, DatasetError> {
        // Read here only for the error: an unreadable folder must not look like an empty one.
        std::fs::read_dir(folder).map_err(|source| DatasetError::Io { path: folder.to_owned(), source })?;
        let mut images = Vec::new();
        let mut unreadable = 0;
        for name in all_names_in(folder) {
            let Some(name) = name.to_str() else {
                unreadable += 1;
                continue;
            };
            let rank = |ending: &str| endings.iter().position(|known| known.eq_ignore_ascii_case(ending));
            if let Some((stem, ending)) = name.rsplit_once('.')
                && let Some(rank) = rank(ending)
                && !name.starts_with('.')
            {
                let image = NamedImage { stem: stem.to_owned(), path: folder.join(name), seconds: None };
                images.push((rank, image));
            }
        }
        images.sort_by(|(a_rank, a), (b_rank, b)| by_name(&a.stem, &b.stem).then(a_rank.cmp(b_rank)));
        if twins == Twins::FirstEnding {
            images
                .dedup_by(|(rank, later), (earlier_rank, earlier)| later.stem == earlier.stem && rank != earlier_rank);
        }
        let mut images: Vec<NamedImage> = images.into_iter().map(|(_, image)| image).collect();
        if let Some([first, second]) = images.array_windows().find(|[first, second]| first.stem == second.stem) {
            return Err(DatasetError::Field {
                path: folder.to_owned(),
                field: format!("image {}", first.stem),
                found: format!("{} and {}", file_name(first), file_name(second)),
                expected: "one file of this name".to_owned(),
            });
        }
        set_times(folder, &mut images)?;
        let mut images = Self { images, unreadable };
        if let Some(times) = images.times() {
            let mut timed: Vec<(f64, NamedImage)> = times.into_iter().zip(images.images).collect();
            timed.sort_by(|(a, _), (b, _)| a.total_cmp(b));
            images.images = timed.into_iter().map(|(_, image)| image).collect();
        }
        Ok(images)
    }

    /// Returns the times in seconds, if all stems are times.
    pub(super) fn times(&self) -> Option<Vec<f64>> {
        self.images.iter().map(|image| image.seconds).collect()
    }
}

fn file_name(image: &NamedImage) -> String {
    image.path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Sets the times of the images whose names are times.
fn set_times(folder: &Path, images: &mut [NamedImage]) -> Result<(), DatasetError> {
    let stamps: Vec<_> = images.iter().map(|image| stamp_of(&image.stem)).collect();
    let with_point = stamps.iter().flatten().filter(|(_, unit)| unit.is_none()).map(|(stamp, _)| *stamp);
    let found = TimeScale::of(&with_point.collect::<Vec<_>>(), None);
    let scale = |unit: Option<TimeUnit>| unit.map_or(found, TimeScale::known);
    if let Some((stamp, unit)) = stamps.iter().flatten().next() {
        scale(*unit).tell(folder, stamp);
    }
    for (image, stamp) in images.iter_mut().zip(stamps) {
        let seconds = |(stamp, unit)| scale(unit).seconds(stamp, (&image.path, "name"));
        image.seconds = stamp.map(seconds).transpose()?;
    }
    Ok(())
}

/// Parses a time: digits with a decimal point between them, in a unit that is not known; or as many digits as a time since
/// 1970 in a shorter unit than seconds has.
fn stamp_of(text: &str) -> Option<(Stamp, Option<TimeUnit>)> {
    let is_digits = |part: &str| !part.is_empty() && part.bytes().all(|byte| byte.is_ascii_digit());
    if let Some((whole, fraction)) = text.split_once('.') {
        return if is_digits(whole) && is_digits(fraction) { Some((Stamp::parse(text)?, None)) } else { None };
    }
    let (_, unit) = DIGITS.into_iter().find(|(digits, _)| *digits == text.len() && is_digits(text))?;
    let stamp = Stamp::parse(text)?;
    // Numbers of frames may have leading zeros, but fewer digits than nanoseconds.
    let is_time = unit == TimeUnit::Nanoseconds || TimeUnit::since_1970(stamp) == Some(unit);
    is_time.then_some((stamp, Some(unit)))
}

/// Compares names, treating numbers in them as numbers: `frame_9`, then `frame_10`.
fn by_name(left: &str, right: &str) -> Ordering {
    let (mut left_rest, mut right_rest) = (left, right);
    loop {
        let (a, b) = (next_part(&mut left_rest), next_part(&mut right_rest));
        let order = match (as_number(a), as_number(b)) {
            // Longer numbers without leading zeros are larger.
            (Some(a), Some(b)) => a.len().cmp(&b.len()).then(a.cmp(b)),
            _ => a.cmp(b),
        };
        if order.is_ne() {
            return order;
        }
        if a.is_empty() && b.is_empty() {
            // They differ at most in leading zeros.
            return left.cmp(right);
        }
    }
}

/// Splits off the longest prefix that is all digits or has none. Empty at the end.
fn next_part<'a>(rest: &mut &'a str) -> &'a str {
    let is_digit = |letter: char| letter.is_ascii_digit();
    let starts_with_digit = rest.starts_with(is_digit);
    let end = rest.find(|letter| is_digit(letter) != starts_with_digit).unwrap_or(rest.len());
    let (part, after) = rest.split_at(end);
    *rest = after;
    part
}

/// Returns the digits of a part without leading zeros; `None` if the part is not a number.
fn as_number(part: &str) -> Option<&str> {
    part.starts_with(|letter: char| letter.is_ascii_digit()).then(|| part.trim_start_matches('0'))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn numbers_in_names_count_as_numbers() {
        let mut names = ["b2", "frame_10", "frame_9", "10", "9", "frame_09", "frame", "a10b2", "a10b11", "b_1"];
        names.sort_by(|a, b| by_name(a, b));
        assert_eq!(names, ["9", "10", "a10b2", "a10b11", "b2", "b_1", "frame", "frame_09", "frame_9", "frame_10"]);
    }

    #[test]
    fn times_have_a_point_or_the_digits_of_a_time_since_1970() {
        let seconds = |name: &str| {
            let mut images = vec![NamedImage { stem: name.to_owned(), path: name.into(), seconds: None }];
            set_times(Path::new("color"), &mut images).map(|()| images[0].seconds).map_err(|error| error.to_string())
        };
        for (name, time) in [
            ("1305031102.175304", 1_305_031_102.175_304),
            ("1305031102175304000", 1_305_031_102.175_304),
            ("1305031102175304", 1_305_031_102.175_304),
            ("1305031102175", 1_305_031_102.175),
            ("1305031102175.304", 1_305_031_102.175_304),
            ("0000000012500000000", 12.5),
            ("0.5", 0.5),
        ] {
            assert_eq!(seconds(name), Ok(Some(time)), "{name}");
        }
        let others = ["12", "000012", "1e3.0", "-1.5", "1.", ".5", "1.2.3", "a1.5", "", "130503110217530400", "9.x"];
        for other in others.into_iter().chain(["0000000000123", "0000000000000123"]) {
            assert_eq!(seconds(other), Ok(None), "{other}");
        }
        let told = seconds("9305031102175304000").unwrap_err();
        assert!(told.contains("name: found the time 9305031102175304000, which is after 2038"), "{told}");
    }

    proptest! {
        #[test]
        fn names_are_in_one_order(mut names in prop::collection::vec("[ab0-2é]{0,5}", 0..20)) {
            let mut backwards: Vec<String> = names.iter().rev().cloned().collect();
            names.sort_by(|a, b| by_name(a, b));
            backwards.sort_by(|a, b| by_name(a, b));
            prop_assert_eq!(names, backwards);
        }
    }
}
