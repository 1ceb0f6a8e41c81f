//! Corrected poses in a plain folder, `corrections.txt`.

use super::frames::FolderFrame;
use super::names::Images;
use super::poses::{Line, listed_pose};
use crate::DatasetError;
use crate::corrections::CorrectionList;
use crate::text::read_text_with_numbers;
use std::collections::BTreeMap;
use std::path::Path;

/// Maximum file size.
const MAX_BYTES: u64 = 64 << 20;
const EXPECTED: &str = "two names of frames and 7 numbers (after_frame frame tx ty tz qx qy qz qw)";

/// Reads the corrected poses of a folder's `frames`, which are those images of `color` that have depth.
///
/// # Errors
/// If the file cannot be read, a name is not that of a colour image, the corrected frame comes after the other, or a pose
/// is damaged; names the line.
pub(super) fn read_corrections(
    path: &Path,
    color: &Images,
    frames: &[FolderFrame],
) -> Result<CorrectionList, DatasetError> {
    let text = read_text_with_numbers(path, "list of corrections", MAX_BYTES)?;
    let positions: BTreeMap<&str, usize> =
        color.images.iter().enumerate().map(|(position, image)| (image.stem.as_str(), position)).collect();
    // Position of each frame among the colour images.
    let places: Vec<usize> = frames.iter().filter_map(|frame| positions.get(frame.name.as_str()).copied()).collect();
    let mut corrections = Vec::new();
    for line in text.lines().enumerate().filter_map(Line::new) {
        let [after, frame, numbers @ ..] = line.words.as_slice() else { return Err(line.wrong(path, EXPECTED)) };
        let position = |name: &str| {
            positions.get(name).copied().ok_or_else(|| line.wrong(path, &format!("{EXPECTED}; no image is {name}")))
        };
        let (after, corrected) = (position(after)?, position(frame)?);
        if corrected > after {
            return Err(line.wrong(path, &format!("{frame}, the corrected frame, not to come after the other")));
        }
        let numbers: Option<Vec<f64>> = numbers.iter().map(|word| word.parse().ok()).collect();
        let numbers = numbers.and_then(|numbers| <[f64; 7]>::try_from(numbers).ok());
        let numbers = numbers.ok_or_else(|| line.wrong(path, EXPECTED))?;
        if let (Some(pose), Ok(index)) = (listed_pose(path, &line, numbers)?, places.binary_search(&corrected)) {
            let known_with = places.partition_point(|place| *place <= after);
            corrections.push((known_with, index, pose));
        }
    }
    corrections.sort_by_key(|(known_with, ..)| *known_with);
    let mut list = CorrectionList::default();
    for (known_with, index, pose) in corrections {
        let Some(frame) = frames.get(index).filter(|_| known_with < frames.len()) else { continue };
        list.add(known_with, index, frame.pose.and_then(|pose| pose.world_from_camera), pose);
    }
    Ok(list)
}
