//! The map's data for the page.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use glam::{DVec3, Vec3};
use serde::Serialize;
use splatseg_geometry::{MapView, SegmentId};

/// Maximum number of drawn Gaussians: a laptop can still rotate them smoothly.
pub const MAX_POINTS: usize = 100_000;

/// The Gaussians of a map for the page, in base64: little-endian 16-bit numbers, and colours of three bytes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MapData {
    /// Number of drawn Gaussians.
    count: usize,
    /// Number of Gaussians in the map that have a place.
    total: usize,
    /// Minimum corner of the map's bounding box, metres, relative to the run's origin.
    min: Vec3,
    /// Sides of the box, metres.
    size: Vec3,
    /// Centres, x, y and z, as fractions of the box: 65535 is its far side.
    positions: String,
    /// The largest standard deviation, metres.
    max_radius: f32,
    /// Standard deviations, as fractions of `max_radius`.
    radii: String,
    /// Colours, sRGB.
    colors: String,
    /// Object id of each Gaussian, 0 for none: little-endian 32-bit numbers.
    ids: String,
}

/// Returns the data of a map's wanted objects, relative to an origin in world coordinates. Gaussians whose distance is
/// not known are left out: they would hide behind everything and make the view tiny.
pub fn map_data(map: &MapView<'_>, origin: DVec3, is_wanted: impl Fn(SegmentId) -> bool) -> MapData {
    let ids = map.segment_ids();
    let has_place = |index: &usize| map.surfaces[*index].has_place();
    let wanted: Vec<usize> =
        (0..map.gaussian_count()).filter(has_place).filter(|index| is_wanted(ids[*index])).collect();
    let total = wanted.len();
    let is_finite = |index: &usize| map.means[*index].is_finite();
    let drawn: Vec<usize> = evenly(total, MAX_POINTS).map(|place| wanted[place]).filter(is_finite).collect();
    // Fewer points must cover the same surfaces.
    let growth = (total as f32 / drawn.len().max(1) as f32).sqrt();
    let min = drawn.iter().map(|index| map.means[*index]).reduce(Vec3::min).unwrap_or_default();
    let max = drawn.iter().map(|index| map.means[*index]).reduce(Vec3::max).unwrap_or_default();
    let radius = |index: &usize| map.radii[*index] * growth;
    let max_radius = drawn.iter().map(radius).fold(0.0, f32::max);
    let size = max - min;
    let place = |index: &usize| {
        let offset = map.means[*index] - min;
        [(offset.x, size.x), (offset.y, size.y), (offset.z, size.z)].map(|(offset, size)| fraction(offset, size))
    };
    MapData {
        count: drawn.len(),
        total,
        min: min + (map.origin - origin).as_vec3(),
        size,
        positions: words(drawn.iter().flat_map(place)),
        max_radius,
        radii: words(drawn.iter().map(|index| fraction(radius(index), max_radius))),
        colors: STANDARD.encode(drawn.iter().flat_map(|index| map.colors[*index]).collect::<Vec<u8>>()),
        ids: STANDARD.encode(drawn.iter().flat_map(|index| ids[*index].to_le_bytes()).collect::<Vec<u8>>()),
    }
}

/// At most `max` of the numbers below `total`, evenly spaced.
fn evenly(total: usize, max: usize) -> impl Iterator<Item = usize> {
    let count = total.min(max);
    (0..count).map(move |step| step * total / count)
}

/// `part / whole` as a 16-bit number.
fn fraction(part: f32, whole: f32) -> u16 {
    if whole > 0.0 { (part / whole * f32::from(u16::MAX)).round() as u16 } else { 0 }
}

fn words(words: impl Iterator<Item = u16>) -> String {
    STANDARD.encode(words.flat_map(u16::to_le_bytes).collect::<Vec<u8>>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_large_map_is_thinned_out_evenly() {
        assert_eq!(evenly(3, 5).collect::<Vec<_>>(), [0, 1, 2]);
        assert_eq!(evenly(10, 4).collect::<Vec<_>>(), [0, 2, 5, 7]);
        assert_eq!(evenly(0, 4).count(), 0);
    }

    #[test]
    fn fractions_span_16_bits() {
        assert_eq!([0.0, 1.0, 2.0].map(|part| fraction(part, 2.0)), [0, 32768, 65535]);
        assert_eq!(fraction(0.0, 0.0), 0);
    }
}
