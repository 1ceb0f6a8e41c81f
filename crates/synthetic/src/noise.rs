//! Simulated Kinect measurements.

use glam::Vec3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use splatseg_geometry::Image;

/// Range of the sensor, metres.
const RANGE_M: std::ops::RangeInclusive<f32> = 0.4..=8.0;
/// Below this cosine between the ray and the surface normal, more and more measurements are lost.
const GRAZING_COSINE: f32 = 0.25;
/// Neighbours farther apart than this, relative to their depth, are at an edge...
const EDGE_STEP: f32 = 0.06;
/// ...where this fraction of the measurements is lost.
const EDGE_DROPOUT: f32 = 0.6;
/// Standard deviation of the colour noise, on a scale of 0 to 255.
const COLOR_SIGMA: f32 = 2.5;

/// Noise added to a rendered frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Noise {
    /// No noise.
    #[default]
    None,
    /// Like a Kinect: depth noise of 0.0012 + 0.0019 (z − 0.4)² metres, dropouts at grazing angles and edges, a range
    /// of 0.4 to 8 metres, and slight colour noise.
    Kinect,
}

/// Surface sample hit by a ray.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Sample {
    pub(super) id: u32,
    /// z-depth, metres.
    pub(super) depth: f32,
    /// sRGB, 0..=255.
    pub(super) color: Vec3,
    /// Cosine of the angle between the ray and the surface's normal.
    pub(super) cosine: f32,
}

/// Simulates a Kinect's measurement of `exact`: colour and depth, row-major. Deterministic for a seed and frame,
/// regardless of the number of threads, because each row has its own random numbers.
pub(super) fn kinect_measurements(exact: &Image<Sample>, seed: u64, frame: usize) -> Vec<([u8; 3], f32)> {
    let measure_row = |row: usize| {
        let mut random = ChaCha8Rng::seed_from_u64(seed ^ (frame as u64).rotate_left(32));
        random.set_stream(row as u64 + 1);
        (0..exact.width())
            .map(|column| {
                let sample = exact[(column, row)];
                let color = sample.color
                    + COLOR_SIGMA * Vec3::from(std::array::from_fn::<f32, 3, _>(|_| gaussian(&mut random)));
                (color_bytes(color), measured_depth(sample, is_edge(exact, column, row), &mut random))
            })
            .collect::<Vec<_>>()
    };
    (0..exact.height()).into_par_iter().map(measure_row).flatten_iter().collect()
}

/// Rounds a colour in 0..=255 to bytes.
pub(super) fn color_bytes(color: Vec3) -> [u8; 3] {
    color.to_array().map(|value| value.round().clamp(0.0, 255.0) as u8)
}

fn measured_depth(sample: Sample, edge: bool, random: &mut ChaCha8Rng) -> f32 {
    // Always draw the same count of random numbers, so that one pixel does not affect its neighbours.
    let (error, chance) = (gaussian(random), random.random::<f32>());
    let z = sample.depth;
    let grazing = ((GRAZING_COSINE - sample.cosine) / GRAZING_COSINE).clamp(0.0, 1.0);
    let dropout = if edge { grazing.max(EDGE_DROPOUT) } else { grazing };
    if chance < dropout || !RANGE_M.contains(&z) {
        return 0.0;
    }
    (z + error * (0.0012 + 0.0019 * (z - 0.4).powi(2))).max(0.0)
}

fn is_edge(exact: &Image<Sample>, column: usize, row: usize) -> bool {
    let z = exact[(column, row)].depth;
    let columns = column.saturating_sub(1)..=(column + 1).min(exact.width() - 1);
    columns.into_iter().any(|beside| {
        let mut rows = row.saturating_sub(1)..=(row + 1).min(exact.height() - 1);
        rows.any(|below| (exact[(beside, below)].depth - z).abs() > EDGE_STEP * z)
    })
}

/// Draws a standard normal number (Box-Muller).
fn gaussian(random: &mut ChaCha8Rng) -> f32 {
    let radius = (-2.0 * (1.0 - random.random::<f32>()).ln()).sqrt();
    radius * (std::f32::consts::TAU * random.random::<f32>()).cos()
}
