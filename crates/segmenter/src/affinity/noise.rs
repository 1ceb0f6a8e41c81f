//! How noisy a frame's depth is.
//!
//! The noise that smoothing leaves matters, as the network sees normals of smoothed depth: white noise of two
//! centimetres costs it nothing, noise that neighbours share costs it much. So planes are fitted to the smoothed depth.
//!
//! Planes are fitted to inverse depth, over which a plane in space is linear. The noise of stereo and structured light is
//! the same near and far there, as they measure disparity.

use rayon::prelude::*;
use splatseg_geometry::CowImage;
use splatseg_kernels::Instructions;

/// Half the side of the windows that planes are fitted to, pixels. Smaller windows do not see noise that neighbours
/// share: the plane follows it.
const REACH: usize = 6;
/// Distance of a window's samples, pixels.
const SAMPLE_STEP: usize = 2;
/// Samples that are summed side by side: those of a line of a window, `REACH + 1`, and one that does not count.
const LANES: usize = 8;
/// Distance of the windows, pixels.
const WINDOW_STEP: usize = 5;
/// Windows with fewer samples with depth are left out: 3 in 5.
const MIN_SAMPLES: f64 = 29.0;
/// Frames with fewer windows say nothing of their noise.
const MIN_WINDOWS: usize = 24;
/// Where noise is given: a deviation of inverse depth is this many metres per 1/m there.
const DISTANCE: f64 = 2.0;

/// Deviation of a frame's smoothed depth from planes, at a distance of 2 m, metres. The deviation at other distances grows
/// with their square. It is the quartile of the calmer windows, as the others contain edges and curved things. `depth` has 0
/// where it is missing, `smooth` is what [`inputs::compute`](super::inputs::compute) returns. `None` if too little of the
/// frame has depth.
pub(super) fn depth_noise(depth: &CowImage<'_, f32>, smooth: &[f32]) -> Option<f64> {
    let (width, height) = depth.size();
    if smooth.len() != width * height {
        return None;
    }
    let centres = |size: usize| (REACH..size.saturating_sub(REACH)).step_by(WINDOW_STEP);
    let rows: Vec<usize> = centres(height).collect();
    let instructions = Instructions::best();
    let deviations = rows.into_par_iter().map(|row| {
        let rows = (row - REACH..row + REACH + 1).step_by(SAMPLE_STEP);
        let lines: Vec<Line> = rows.map(|row| Line::new(depth.row(row), &smooth[row * width..])).collect();
        let mut deviations = Vec::with_capacity(width / WINDOW_STEP);
        instructions.run(
            #[inline(always)]
            || deviations.extend(centres(width).filter_map(|column| deviation(&lines, column - REACH))),
        );
        deviations
    });
    let mut deviations = deviations.collect::<Vec<Vec<f64>>>().concat();
    if deviations.len() < MIN_WINDOWS {
        return None;
    }
    let quarter = deviations.len() / 4;
    let (_, quartile, _) = deviations.select_nth_unstable_by(quarter, f64::total_cmp);
    Some(*quartile * DISTANCE * DISTANCE)
}

/// Samples of a row: those of even columns, and those of odd ones.
struct Line([Samples; SAMPLE_STEP]);

/// Every second pixel of a row, followed by samples without depth.
struct Samples {
    /// 1 where there is depth.
    valid: Vec<f64>,
    /// Inverse smoothed depth, 1/m; 0 where there is no depth.
    inverse: Vec<f64>,
}

impl Line {
    fn new(depth: &[f32], smooth: &[f32]) -> Self {
        Self(std::array::from_fn(|start| {
            let len = depth.len().saturating_sub(start).div_ceil(SAMPLE_STEP) + LANES;
            let mut samples = Samples { valid: vec![0.0; len], inverse: vec![0.0; len] };
            let pixels = depth.iter().zip(smooth).skip(start).step_by(SAMPLE_STEP);
            let out = samples.valid.iter_mut().zip(&mut samples.inverse);
            for ((valid, inverse), (depth, smooth)) in out.zip(pixels) {
                if *depth > 0.0 {
                    (*valid, *inverse) = (1.0, 1.0 / f64::from(*smooth));
                }
            }
            samples
        }))
    }
}

/// Deviation of the inverse smoothed depth from a plane, in a window of some lines from column `first` on, 1/m.
#[inline(always)]
fn deviation(lines: &[Line], first: usize) -> Option<f64> {
    // Sums over the samples with depth of the products of 1, x, y and the inverse depth; those of a column in each lane.
    let mut sums = [[0.0; LANES]; 10];
    for (down, line) in lines.iter().enumerate() {
        let samples = &line.0[first % SAMPLE_STEP];
        let valid = &samples.valid[first / SAMPLE_STEP..][..LANES];
        let inverse = &samples.inverse[first / SAMPLE_STEP..][..LANES];
        let y = down as f64;
        for lane in 0..LANES {
            let inside = if lane <= REACH { 1.0 } else { 0.0 };
            let (one, value, x) = (inside * valid[lane], inside * inverse[lane], lane as f64);
            let products = [
                one,
                x * one,
                y * one,
                value,
                x * x * one,
                x * y * one,
                y * y * one,
                x * value,
                y * value,
                value * value,
            ];
            sums.iter_mut().zip(products).for_each(|(sums, product)| sums[lane] += product);
        }
    }
    let [count, x, y, value, xx, xy, yy, x_value, y_value, square] = sums.map(|lanes| lanes.iter().sum::<f64>());
    if count < MIN_SAMPLES {
        return None;
    }
    // About the mean, the plane has two unknowns.
    let about = |sum: f64, first: f64, second: f64| sum - first * second / count;
    let (xx, xy, yy) = (about(xx, x, x), about(xy, x, y), about(yy, y, y));
    let (x_value, y_value, square) = (about(x_value, x, value), about(y_value, y, value), about(square, value, value));
    let determinant = xx * yy - xy * xy;
    let (slope_x, slope_y) = ((x_value * yy - y_value * xy) / determinant, (y_value * xx - x_value * xy) / determinant);
    let rest = square - slope_x * x_value - slope_y * y_value;
    rest.is_finite().then(|| (rest.max(0.0) / (count - 3.0)).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use splatseg_geometry::Image;

    /// A slanted wall 1.5 to 3 m away with white noise of `metres` at 2 m, of which a share has no depth.
    fn wall(metres: f64, missing: f64) -> CowImage<'static, f32> {
        let mut state = 3_u32;
        let mut random = move || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state >> 8) / f64::from(1 << 24)
        };
        Image::from_fn(320, 240, |column, row| {
            let inverse = 0.35 + column as f64 * 0.001 - row as f64 * 0.0001;
            // A sum of four has nearly a normal distribution, with a variance of a third.
            let noise: f64 = (0..4).map(|_| random() - 0.5).sum::<f64>() * 3f64.sqrt();
            if random() < missing { 0.0 } else { (1.0 / (inverse + noise * metres / 4.0)) as f32 }
        })
    }

    fn noise(depth: &CowImage<'_, f32>) -> Option<f64> {
        depth_noise(depth, depth.pixels())
    }

    #[test]
    fn white_noise_is_found_with_and_without_holes() {
        for metres in [0.0, 0.002, 0.01, 0.05] {
            for missing in [0.0, 0.3] {
                let found = noise(&wall(metres, missing)).unwrap();
                // The calmer quartile is a little less than the deviation.
                assert!((found - metres).abs() < 0.12 * metres + 1e-6, "{metres} m: {found}");
            }
        }
    }

    #[test]
    fn edges_are_no_noise() {
        let plain = wall(0.002, 0.0);
        let stripes = Image::from_fn(320, 240, |column, row| plain[(column, row)] * [1.0, 0.6][column / 30 % 2]);
        let found = noise(&stripes).unwrap();
        assert!(found < 0.004, "{found}");
    }

    #[test]
    fn too_little_depth_says_nothing() {
        assert_eq!(noise(&Image::filled(320, 240, 0.0)), None);
        assert_eq!(noise(&wall(0.01, 0.9)), None);
        assert_eq!(noise(&Image::filled(12, 200, 1.0)), None);
        assert_eq!(noise(&Image::filled(0, 0, 1.0)), None);
        assert_eq!(depth_noise(&wall(0.01, 0.0), &[]), None);
    }
}
