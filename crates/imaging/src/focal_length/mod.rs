//! The focal length of a camera that nothing describes, from the motion of its images alone (self-calibration).
//!
//! Corners are followed through a few seconds of the recording. Where the camera has moved enough, two frames are a pair of
//! views: for each of a row of focal lengths, the motion between them is found that explains the corners best, and the
//! focal length whose motions explain all pairs best is taken. Nothing about depth is needed. The principal point is the
//! middle of the image, pixels are square, and the lens does not distort; whether a lens that does explains the views
//! better is told.
//!
//! | file | |
//! | --- | --- |
//! | `grey_pyramid.rs` | grey values of an image at several resolutions |
//! | `corners.rs` | corners that can be followed (Shi and Tomasi, 1994) |
//! | `view_pairs.rs` | corners followed from frame to frame (Lucas and Kanade; Bouguet, 2001), and pairs of views |
//! | `camera_motion.rs` | the motion of a pair for a focal length, by epipolar lines or as a rotation |

mod camera_motion;
mod corners;
mod grey_pyramid;
mod view_pairs;

use grey_pyramid::GreyPyramid;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use splatseg_geometry::Image;
use view_pairs::{ViewPair, view_pairs};

/// Focal lengths that are compared, in long sides of the image: views of 118 to 22 degrees, in steps of 7 %.
const SHORTEST: f64 = 0.3;
const FOCAL_LENGTHS: usize = 33;
const STEP: f64 = 1.07;

/// This many parts of a recording are used, spread over it...
const PARTS: usize = 10;
/// ...each with this many consecutive frames: a second of most cameras.
const FRAMES_OF_PART: usize = 30;

/// With fewer pairs of views the estimate is a matter of chance.
const MIN_PAIRS: usize = 4;
/// The estimate is dropped if the pairs say that its deviation is larger: usual cameras differ by 0.2.
const MAX_DEVIATION: f64 = 0.1;
/// Smallest deviation from distortion and rolling shutters: the error of estimates of real cameras.
const SYSTEMATIC: f64 = 0.04;
/// The same for a focal length of one long side. It grows with the square: the less a camera sees, the less a turn differs
/// from a translation. Long ones were estimated too short by 6 to 12 %.
const SYSTEMATIC_OF_LONG: f64 = 0.055;
/// The strength of the barrel distortion that is tried: places in the corners of an image of 4:3 are 8 % closer to its middle.
const BARREL: f64 = 0.2;
/// Draws of pairs from which the deviation is estimated (bootstrap).
const DRAWS: usize = 200;

/// An estimated focal length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FocalLength {
    /// Focal length in long sides of the image.
    pub long_sides: f64,
    /// Standard deviation of its logarithm: the scatter of the pairs, and the influence of lenses and shutters.
    pub deviation: f64,
    /// Whether a lens with barrel distortion explains the pairs better: then the focal length is worse than its deviation
    /// says.
    pub distorts: bool,
}

/// Estimates the focal length from the images of a recording. `read` returns an image, or `None` if it cannot be read; all
/// images have one size. `None` if the images do not tell it: the camera hardly moves, or they have too few corners.
///
/// The result is the same for any number of threads.
pub fn estimated_focal_length(
    frames: usize,
    read: &(dyn Fn(usize) -> Option<Image<[u8; 3]>> + Sync),
) -> Option<FocalLength> {
    let read_any = |index: usize| read(index).filter(|image| !image.pixels().is_empty());
    let pairs: Vec<Vec<ViewPair>> = parts_of(frames)
        .into_par_iter()
        .map(|part| view_pairs(part.map_while(read_any).map(|image| GreyPyramid::new(&image))))
        .collect();
    let pairs = pairs.concat();
    if pairs.len() < MIN_PAIRS {
        return None;
    }
    let costs: Vec<Costs> = pairs.par_iter().map(|pair| camera_motion::costs(pair, &focal_lengths())).collect();
    let bent: Vec<Costs> =
        pairs.par_iter().map(|pair| camera_motion::costs(&pair.straightened(BARREL), &focal_lengths())).collect();
    let long_sides = best(&sums(costs.iter()))?;
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let (mut squares, mut bent_is_better) = (0.0, 0);
    for _ in 0..DRAWS {
        let drawn: Vec<usize> = (0..costs.len()).map(|_| rng.random_range(0..costs.len())).collect();
        let [straight, bent] = [&costs, &bent].map(|costs| sums(drawn.iter().map(|index| &costs[*index])));
        squares += best(&straight).map_or(f64::INFINITY, |drawn| libm::log(drawn / long_sides).powi(2));
        bent_is_better += usize::from(camera_motion::least(&bent) < camera_motion::least(&straight));
    }
    let scatter = (squares / DRAWS as f64).sqrt();
    let systematic = SYSTEMATIC.max(SYSTEMATIC_OF_LONG * long_sides * long_sides);
    let deviation = scatter.hypot(systematic);
    let distorts = bent_is_better * 40 >= DRAWS * 39;
    (scatter <= MAX_DEVIATION).then_some(FocalLength { long_sides, deviation, distorts })
}

/// The cost of a pair of views for each of the focal lengths.
type Costs = [f64; FOCAL_LENGTHS];

/// The focal lengths that are compared.
fn focal_lengths() -> Costs {
    let mut focal = SHORTEST / STEP;
    std::array::from_fn(|_| {
        focal *= STEP;
        focal
    })
}

/// The frames that are looked at: parts of consecutive frames, spread over the recording.
fn parts_of(frames: usize) -> Vec<std::ops::Range<usize>> {
    let parts = frames.div_ceil(FRAMES_OF_PART).clamp(1, PARTS);
    let start = |part: usize| part * frames / parts;
    (0..parts).map(|part| start(part)..start(part + 1).min(start(part) + FRAMES_OF_PART)).collect()
}

/// The sums over pairs of views.
fn sums<'a>(costs: impl Iterator<Item = &'a Costs>) -> Costs {
    costs.fold([0.0; FOCAL_LENGTHS], |sums, costs| std::array::from_fn(|index| sums[index] + costs[index]))
}

/// The focal length that costs least, between those that were compared; `None` if it is the first or last of them.
fn best(sums: &Costs) -> Option<f64> {
    let least = (0..FOCAL_LENGTHS).min_by(|a, b| sums[*a].total_cmp(&sums[*b]))?;
    let &[before, at, after] = sums.get(least.checked_sub(1)?..)?.first_chunk()?;
    let curvature = before - 2.0 * at + after;
    let between = if curvature > 0.0 { 0.5 * (before - after) / curvature } else { 0.0 };
    Some(focal_lengths()[least] * libm::pow(STEP, between))
}

#[cfg(test)]
mod tests;
