//! How noisy a frame's depth is.
//!
//! What matters is the noise that smoothing leaves, as the network sees normals of smoothed depth: white noise of two
//! centimetres costs it nothing, noise that neighbours share costs it much. So planes are fitted to the smoothed depth.
//!
//! Planes are fitted to inverse depth, over which a plane in space is linear. The noise of stereo and structured light is
//! the same near and far there, as they measure disparity.

use splatseg_geometry::CowImage;

/// Half the side of the windows that planes are fitted to, pixels. Smaller windows do not see noise that neighbours
/// share: the plane follows it.
const REACH: usize = 6;
/// Distance of a window's samples, pixels.
const SAMPLE_STEP: usize = 2;
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
    let deviations = centres(height).flat_map(|row| {
        let rows = row - REACH..row + REACH + 1;
        let lines: Vec<Line<'_>> =
            rows.step_by(SAMPLE_STEP).map(|row| (depth.row(row), &smooth[row * width..])).collect();
        centres(width).filter_map(move |column| deviation(&lines, column))
    });
    let mut deviations: Vec<f64> = deviations.collect();
    if deviations.len() < MIN_WINDOWS {
        return None;
    }
    let quarter = deviations.len() / 4;
    let (_, quartile, _) = deviations.select_nth_unstable_by(quarter, f64::total_cmp);
    Some(*quartile * DISTANCE * DISTANCE)
}

/// A row of the depth, and of the smoothed depth.
type Line<'a> = (&'a [f32], &'a [f32]);

/// Deviation of the inverse smoothed depth from a plane, in a window of some lines around a column, 1/m.
fn deviation(lines: &[Line<'_>], column: usize) -> Option<f64> {
    // Sums over the samples with depth of the products of 1, x, y and the inverse depth.
    let (mut count, mut x, mut y, mut value) = (0.0, 0.0, 0.0, 0.0);
    let (mut xx, mut xy, mut yy, mut x_value, mut y_value, mut square) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    for (down, (depth, smooth)) in lines.iter().enumerate() {
        let columns = (column - REACH..column + REACH + 1).step_by(SAMPLE_STEP);
        for (right, column) in columns.enumerate().filter(|(_, column)| depth[*column] > 0.0) {
            let (right, down, inverse) = (right as f64, down as f64, 1.0 / f64::from(smooth[column]));
            count += 1.0;
            x += right;
            y += down;
            value += inverse;
            xx += right * right;
            xy += right * down;
            yy += down * down;
            x_value += right * inverse;
            y_value += down * inverse;
            square += inverse * inverse;
        }
    }
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
