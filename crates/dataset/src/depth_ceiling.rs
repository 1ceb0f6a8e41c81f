//! A constant depth that may mean "no measurement": 10 m, 4095 mm or a renderer's far plane, where only 0 and 65535 are known
//! to mean it. It would be taken for a wall.

use splatseg_geometry::{CowImage, Image};

/// The check takes this many frames with depth, from the first on.
const FRAMES: usize = 4;
/// The largest depth is suspicious from this share of the pixels on...
const MIN_SHARE: f64 = 0.03;
/// ...if fewer than this share of as many pixels are up to [`NEAR`] nearer: surfaces go on, and sensors are noisy...
const MAX_NEAR: f64 = 0.2;
/// ...and at most this share of the other pixels has the depth of the frame before: neither does the camera stand still
/// nor is all depth free of noise.
const MAX_UNCHANGED: f64 = 0.7;
/// Depths that are nearer than the largest by at most this share are near it.
const NEAR: f32 = 0.05;

/// Check of the first frames.
#[derive(Debug, Default)]
pub(crate) struct DepthCeiling {
    /// Number of frames so far, with the same largest depth.
    frames: usize,
    is_done: bool,
    /// Depth of the last frame, metres.
    last: Option<Image<f32>>,
    /// Largest depth, metres.
    farthest: f32,
}

impl DepthCeiling {
    /// Checks the depth of the next frame, metres, 0 if missing. Returns a warning with the last one that is needed.
    pub(crate) fn check(&mut self, depth: &CowImage<'_, f32>) -> Option<String> {
        if self.is_done {
            return None;
        }
        let farthest = depth.pixels().iter().copied().fold(0.0, f32::max);
        if farthest <= 0.0 {
            return None;
        }
        let share = constant_share(depth, farthest);
        let is_same = self.last.as_ref().is_none_or(|last| {
            farthest.to_bits() == self.farthest.to_bits() && unchanged_share(last, depth, farthest) <= MAX_UNCHANGED
        });
        let Some(share) = share.filter(|_| is_same) else {
            *self = Self { is_done: true, ..Self::default() };
            return None;
        };
        self.frames += 1;
        if self.frames < FRAMES {
            (self.last, self.farthest) = (Some(depth.clone().into_owned()), farthest);
            return None;
        }
        *self = Self { is_done: true, ..Self::default() };
        Some(format!(
            "{:.0} % of the pixels have exactly the largest depth, {farthest} m, as in the frames before: it is taken for a \
             surface; if it means that nothing was measured, use --max-depth-m {farthest}",
            100.0 * share
        ))
    }
}

/// Returns the share of the pixels that have the largest depth, if it is suspicious.
fn constant_share(depth: &CowImage<'_, f32>, farthest: f32) -> Option<f64> {
    let count =
        |is_counted: &dyn Fn(f32) -> bool| depth.pixels().iter().filter(|depth| is_counted(**depth)).count() as f64;
    let constant = count(&|depth| depth >= farthest);
    let near = count(&|depth| depth < farthest && depth >= farthest * (1.0 - NEAR));
    let share = constant / depth.pixels().len() as f64;
    (share > MIN_SHARE && near < MAX_NEAR * constant).then_some(share)
}

/// Returns the share of the pixels nearer than the largest depth that have the same depth in both frames; all if there are
/// none.
fn unchanged_share(last: &Image<f32>, depth: &CowImage<'_, f32>, farthest: f32) -> f64 {
    let pairs = last.pixels().iter().zip(depth.pixels());
    let nearer = pairs.filter(|(_, depth)| **depth > 0.0 && **depth < farthest);
    let (mut same, mut all) = (0.0, 0.0);
    for (last, depth) in nearer {
        all += 1.0;
        same += f64::from(u8::from(last.to_bits() == depth.to_bits()));
    }
    if all > 0.0 { same / all } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A slanted floor that the camera moves over, and `far` in the upper part of the image.
    fn warning(far: impl Fn(usize, usize, usize) -> f32) -> Option<String> {
        let mut check = DepthCeiling::default();
        let frame = |index: usize| {
            Image::from_fn(64, 48, |column, row| {
                let is_floor = row >= 10;
                if is_floor { 1.0 + (row * 7 + column + index) as f32 * 0.005 } else { far(index, column, row) }
            })
        };
        let found: Vec<String> = (0..3 * FRAMES).filter_map(|index| check.check(&frame(index))).collect();
        assert!(found.len() < 2, "once: {found:?}");
        found.into_iter().next()
    }

    #[test]
    fn a_constant_largest_depth_is_doubted() {
        for far in [10.0, 4.095, 65.0] {
            let text = warning(|_, _, _| far).unwrap();
            assert!(text.starts_with(&format!("21 % of the pixels have exactly the largest depth, {far} m")), "{text}");
        }
    }

    #[test]
    fn surfaces_are_not_doubted() {
        assert_eq!(warning(|_, _, _| 0.0), None, "missing");
        assert_eq!(warning(|index, _, _| 10.0 + index as f32 * 0.01), None, "a wall that comes nearer");
        assert_eq!(warning(|_, column, row| 10.0 - (column + row) as f32 * 0.001), None, "a slanted wall");
        assert_eq!(warning(|_, column, _| if column < 4 { 10.0 } else { 0.0 }), None, "a small part");
        let mut check = DepthCeiling::default();
        let still = Image::from_fn(64, 48, |column, row| if row < 10 { 2.0 } else { 1.0 + column as f32 * 0.001 });
        assert!((0..9).all(|_| check.check(&still).is_none()), "a camera that stands still before a wall");
        let mut check = DepthCeiling::default();
        assert!((0..9).all(|_| check.check(&Image::filled(64, 48, 2.0)).is_none()), "only a wall");
    }
}
