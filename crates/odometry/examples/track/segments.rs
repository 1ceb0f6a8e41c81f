//! Segments that tracking gets after each frame, as from a method.

use splatseg_geometry::{Pose, SegmentMap};

/// The segments of a frame: `truth`, `walls` or `grid`, as the example's options explain; `None` for others.
pub fn segments(ids: &str, truth: Option<&SegmentMap>, (width, height): (usize, usize)) -> Option<SegmentMap> {
    match ids {
        "truth" => truth.cloned(),
        "walls" => truth.map(|truth| truth.map(|id| if *id <= 6 { 1 } else { *id })),
        "grid" => Some(SegmentMap::from_fn(width, height, |column, row| {
            1 + (4 * column / width) as u32 + 4 * (3 * row / height) as u32
        })),
        _ => None,
    }
}

/// A hash (FNV-1a) of the bits of all poses.
pub fn hash(poses: impl Iterator<Item = Pose>) -> u64 {
    let bytes = poses.flat_map(|pose| pose.to_row_major()).flat_map(|number| number.to_bits().to_le_bytes());
    bytes.fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}
