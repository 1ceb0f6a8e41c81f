//! Sums over the points of an alignment. Blocks of points are added up in a fixed order, so that the result does not
//! depend on the number of threads.

use crate::linear::Matrix6;
use crate::se3::Twist;
use glam::Vec3;

/// Points per block.
pub(crate) const BLOCK: usize = 600;

const BINS: usize = 256;

/// Geometry or image is judged by at least this many points.
const MIN_MEASUREMENTS: f32 = 150.0;

/// Numbers of points.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Counts {
    /// Points that project into the image.
    pub(crate) visible: f32,
    /// Visible points at which the frame has depth.
    pub(crate) with_depth: f32,
    /// Points whose measured depth agrees with the plane.
    pub(crate) near_plane: f32,
    /// Visible points with texture that are not covered by something nearer.
    pub(crate) with_texture: f32,
    /// Points with texture whose luminance agrees.
    pub(crate) same_grey: f32,
}

impl Counts {
    /// Share of a keyframe's `points` that the frame confirms, by geometry or image, 0 to 1.
    pub(crate) fn agreement(&self, points: usize) -> f32 {
        (self.near_plane + self.same_grey) / (2.0 * points.max(1) as f32)
    }

    /// Shares of the visible measurements that agree with the keyframe: of the distances, and of the luminance. `None`
    /// where there is too little to judge.
    pub(crate) fn inliers(&self) -> [Option<f32>; 2] {
        let judged = |agreeing: f32, measured: f32| (measured >= MIN_MEASUREMENTS).then(|| agreeing / measured);
        [judged(self.near_plane, self.with_depth), judged(self.same_grey, self.with_texture)]
    }

    /// Mean of [`Self::inliers`] over those that can be judged; 0 if none can.
    pub(crate) fn mean_inliers(&self) -> f32 {
        match self.inliers() {
            [Some(geometry), Some(image)] => 0.5 * (geometry + image),
            [one, other] => one.or(other).unwrap_or(0.0),
        }
    }
}

/// Sums over points.
#[derive(Clone, Default)]
pub(crate) struct Sums {
    /// Upper triangle of Σ information · J Jᵀ, row by row.
    products: [f32; 21],
    /// Σ information · J r.
    residuals: [f32; 6],
    /// How far a point seems to move per change of the focal length's logarithm; zero while that is not asked for.
    pub(crate) stretch: Vec3,
    /// Σ information · J s, Σ information · s² and Σ information · s r, with the derivative s with respect to the focal
    /// length's logarithm.
    focal: [f64; 8],
    /// The same two in double precision, over blocks.
    total_products: [f64; 21],
    total_residuals: [f64; 6],
    pub(crate) counts: Counts,
    pub(crate) distances: Histogram,
    pub(crate) greys: Histogram,
    pub(crate) exposure: Exposure,
}

impl Sums {
    /// Adds a residual with its derivative, [translation, rotation].
    pub(crate) fn add_row(&mut self, translation: Vec3, rotation: Vec3, residual: f32, information: f32) {
        let row = [translation.x, translation.y, translation.z, rotation.x, rotation.y, rotation.z];
        let mut next = 0;
        for (index, first) in row.iter().enumerate() {
            let weighted = first * information;
            for second in &row[index..] {
                self.products[next] += weighted * second;
                next += 1;
            }
            self.residuals[index] += weighted * residual;
        }
        if self.stretch != Vec3::ZERO {
            let stretch = translation.dot(self.stretch);
            let weighted = f64::from(stretch * information);
            row.iter().chain([&stretch, &residual]).zip(&mut self.focal).for_each(|(factor, sum)| {
                *sum += weighted * f64::from(*factor);
            });
        }
    }

    /// Derivatives of the cost with respect to the focal length's logarithm: with the pose, twice with itself, once.
    pub(crate) fn focal(&self) -> (Twist, f64, f64) {
        let [x, y, z, a, b, c, twice, once] = self.focal;
        ([x, y, z, a, b, c], twice, once)
    }

    /// Adds the sums of a block.
    pub(crate) fn add(&mut self, block: &Self) {
        for (total, part) in self.total_products.iter_mut().zip(block.products) {
            *total += f64::from(part);
        }
        for (total, part) in self.total_residuals.iter_mut().zip(block.residuals) {
            *total += f64::from(part);
        }
        let (counts, more) = (&mut self.counts, &block.counts);
        counts.visible += more.visible;
        counts.with_depth += more.with_depth;
        counts.near_plane += more.near_plane;
        counts.with_texture += more.with_texture;
        counts.same_grey += more.same_grey;
        self.distances.merge(&block.distances);
        self.greys.merge(&block.greys);
        self.exposure.merge(&block.exposure);
    }

    /// Σ information · J Jᵀ over all blocks.
    pub(crate) fn hessian(&self) -> Matrix6 {
        // Index of the first element of each row of the upper triangle.
        const ROWS: [usize; 6] = [0, 6, 11, 15, 18, 20];
        let element = |row: usize, column: usize| self.total_products[ROWS[row] + column - row];
        std::array::from_fn(|row| std::array::from_fn(|column| element(row.min(column), row.max(column))))
    }

    /// Σ information · J r over all blocks.
    pub(crate) fn gradient(&self) -> Twist {
        self.total_residuals
    }
}

/// A histogram of absolute residuals; the last bin has all that are larger.
#[derive(Clone)]
pub(crate) struct Histogram([u16; BINS]);

impl Default for Histogram {
    fn default() -> Self {
        Self([0; BINS])
    }
}

impl Histogram {
    /// Adds a residual, in units of a bin.
    pub(crate) fn add(&mut self, bins: f32) {
        self.0[(bins as usize).min(BINS - 1)] += 1;
    }

    /// Adds a residual that is larger than all bins.
    pub(crate) fn add_largest(&mut self) {
        self.0[BINS - 1] += 1;
    }

    fn merge(&mut self, other: &Self) {
        for (bin, more) in self.0.iter_mut().zip(other.0) {
            *bin = bin.saturating_add(more);
        }
    }

    /// The median, in units of a bin; `None` without residuals.
    pub(crate) fn median(&self) -> Option<f32> {
        let total: u32 = self.0.iter().map(|count| u32::from(*count)).sum();
        if total == 0 {
            return None;
        }
        let (mut before, half) = (0.0, total as f32 * 0.5);
        for (bin, count) in self.0.iter().enumerate() {
            let count = f32::from(*count);
            if before + count >= half {
                return Some(bin as f32 + (half - before) / count.max(1.0));
            }
            before += count;
        }
        None
    }
}

/// Weighted moments of the luminance in the keyframe and in the frame, for the change of exposure between them.
#[derive(Clone, Copy, Default)]
pub(crate) struct Exposure {
    weight: f32,
    key: f32,
    frame: f32,
    key_key: f32,
    key_frame: f32,
}

impl Exposure {
    pub(crate) fn add(&mut self, key: f32, frame: f32, weight: f32) {
        // Around the middle of the range, so that sums stay small.
        let (key, frame) = (key - 128.0, frame - 128.0);
        self.weight += weight;
        self.key += weight * key;
        self.frame += weight * frame;
        self.key_key += weight * key * key;
        self.key_frame += weight * key * frame;
    }

    fn merge(&mut self, other: &Self) {
        self.weight += other.weight;
        self.key += other.key;
        self.frame += other.frame;
        self.key_key += other.key_key;
        self.key_frame += other.key_frame;
    }

    /// Gain, within limits, and offset that predict the frame's luminance from the keyframe's. `None` with too few
    /// points.
    pub(crate) fn regression(&self, (least, most): (f32, f32)) -> Option<(f32, f32)> {
        if self.weight < 30.0 {
            return None;
        }
        let (key, frame) = (self.key / self.weight, self.frame / self.weight);
        let variance = self.key_key / self.weight - key * key;
        let covariance = self.key_frame / self.weight - key * frame;
        let gain = if variance > 25.0 { (covariance / variance).clamp(least, most) } else { 1.0 };
        Some((gain, frame + 128.0 - gain * (key + 128.0)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_is_that_of_the_values() {
        let mut histogram = Histogram::default();
        assert_eq!(histogram.median(), None);
        for value in 0..101 {
            histogram.add(value as f32 + 0.5);
        }
        assert!((histogram.median().unwrap() - 50.5).abs() < 0.6);
    }

    #[test]
    fn exposure_is_found() {
        let mut exposure = Exposure::default();
        for key in 0..200 {
            exposure.add(key as f32, 0.9 * key as f32 + 12.0, 1.0);
        }
        let (gain, offset) = exposure.regression((0.6, 1.6)).unwrap();
        assert!((gain - 0.9).abs() < 1e-3 && (offset - 12.0).abs() < 0.1, "{gain} {offset}");
        assert_eq!(Exposure::default().regression((0.6, 1.6)), None);
    }
}
