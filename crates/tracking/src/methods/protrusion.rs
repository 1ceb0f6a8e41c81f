//! Predictions in front of the segment that explains them (`docs/METHOD.md`, "FastSAM-Splat").
//!
//! A memory explains a new prediction by a segment of which it is sure. Most such predictions are pieces of that segment: a
//! patch of its colour, one face of a box. What lies in front of the segment's surface is a thing of its own that earlier
//! frames took for a part of it, such as a cup on a table.
//!
//! This is not in the paper, and is not applied to the paper's memory of features.

use glam::{DMat3, DVec3};
use splatseg_geometry::{CowImage, SegmentId, SegmentMap, distance_transform};
use std::collections::BTreeMap;

/// The surface around a prediction is that within this city-block distance of it, pixels.
const MAX_DISTANCE: u32 = 8;

/// Fewer pixels with a depth around a prediction, or in it, say nothing.
const MIN_AREA: usize = 30;

/// How often the plane is fitted: each time, pixels far from the last one count less.
const FITS: usize = 5;

/// Pixels nearer to the plane than this fraction of their distance count alike.
const MIN_RESIDUAL: f64 = 0.01;

/// A prediction lies in front if it does so by more than this fraction of the distance...
const MIN_PROTRUSION: f64 = 0.04;

/// ...and by more than this many times what the plane misses the surface by, at three of four pixels.
const PROTRUSION_PER_RESIDUAL: f64 = 2.0;

/// Whether the prediction with an id lies in front of the segment that has most of its place in `shown`: most of its
/// pixels in front of the plane that continues that segment's surface around it. Not if there is no such segment, or too
/// little depth to tell.
pub(super) fn lies_in_front(id: SegmentId, seen: &SegmentMap, shown: &SegmentMap, depth: &CowImage<'_, f32>) -> bool {
    let Some(crop) = Crop::around(id, seen) else { return false };
    let is_own = |index: usize| seen[crop.pixel(index)] == id;
    let mut explained_by: BTreeMap<SegmentId, usize> = BTreeMap::new();
    for shown in (0..crop.area()).filter(|index| is_own(*index)).map(|index| shown[crop.pixel(index)]) {
        if shown != id && shown != 0 {
            *explained_by.entry(shown).or_default() += 1;
        }
    }
    let Some((segment, _)) = explained_by.into_iter().rev().max_by_key(|(_, area)| *area) else { return false };
    let steps = distance_transform(crop.size, is_own);
    let is_around = |index: usize| (1..=MAX_DISTANCE).contains(&steps[index]) && shown[crop.pixel(index)] == segment;
    let points = |is_wanted: &dyn Fn(usize) -> bool| -> Vec<DVec3> {
        let pixels = (0..crop.area()).filter(|index| is_wanted(*index)).map(|index| crop.pixel(index));
        pixels.filter(|pixel| depth[*pixel] > 0.0).map(|pixel| image_point(pixel, depth)).collect()
    };
    let (inside, around) = (points(&is_own), points(&is_around));
    if around.len().min(inside.len()) < MIN_AREA {
        return false;
    }
    let Some(plane) = fitted_plane(&around) else { return false };
    let in_front = |point: &DVec3| 1.0 - plane.dot(at(point)) / point.z;
    let protrusion = quantile(inside.iter().map(in_front).collect(), 0.5);
    let residual = quantile(around.iter().map(|point| in_front(point).abs()).collect(), 0.75);
    protrusion > MIN_PROTRUSION.max(PROTRUSION_PER_RESIDUAL * residual)
}

/// The part of an image that a prediction and the surface around it take up.
struct Crop {
    left: usize,
    top: usize,
    /// Width and height.
    size: (usize, usize),
}

impl Crop {
    /// None if no pixel has the id.
    fn around(id: SegmentId, seen: &SegmentMap) -> Option<Self> {
        let (width, height) = seen.size();
        let rows = || (0..height).filter(|row| seen.row(*row).contains(&id));
        let (first, last) = (rows().next()?, rows().next_back()?);
        let (mut leftmost, mut rightmost) = (width - 1, 0);
        for row in rows() {
            let is_own = |pixel: &SegmentId| *pixel == id;
            leftmost = leftmost.min(seen.row(row).iter().position(is_own)?);
            rightmost = rightmost.max(seen.row(row).iter().rposition(is_own)?);
        }
        let around = MAX_DISTANCE as usize;
        let (left, top) = (leftmost.saturating_sub(around), first.saturating_sub(around));
        let (right, bottom) = ((rightmost + around).min(width - 1), (last + around).min(height - 1));
        Some(Self { left, top, size: (right + 1 - left, bottom + 1 - top) })
    }

    fn area(&self) -> usize {
        self.size.0 * self.size.1
    }

    /// Column and row in the image of the crop's pixel number `index`.
    fn pixel(&self, index: usize) -> (usize, usize) {
        (self.left + index % self.size.0, self.top + index / self.size.0)
    }
}

/// Column and row relative to the image's centre, in half widths, and inverse depth, 1/metres. Planes in space are planes
/// in these, too.
fn image_point(pixel: (usize, usize), depth: &CowImage<'_, f32>) -> DVec3 {
    let (half_width, half_height) = (0.5 * depth.width() as f64, 0.5 * depth.height() as f64);
    let inverse = 1.0 / f64::from(depth[pixel]);
    DVec3::new((pixel.0 as f64 - half_width) / half_width, (pixel.1 as f64 - half_height) / half_width, inverse)
}

/// What a plane's factors are multiplied with at a point.
fn at(point: &DVec3) -> DVec3 {
    DVec3::new(point.x, point.y, 1.0)
}

/// The plane `inverse depth = plane · (x, y, 1)` with the least absolute residuals, by reweighted least squares. None if
/// the points lie on a line.
fn fitted_plane(points: &[DVec3]) -> Option<DVec3> {
    let mut plane: Option<DVec3> = None;
    for _ in 0..FITS {
        let (mut squares, mut products) = (DMat3::ZERO, DVec3::ZERO);
        for point in points {
            let residual = plane.map_or(0.0, |plane| (1.0 - plane.dot(at(point)) / point.z).abs());
            let weight = 1.0 / residual.max(MIN_RESIDUAL);
            let place = at(point);
            squares += weight * DMat3::from_cols(place * place.x, place * place.y, place);
            products += weight * point.z * place;
        }
        if squares.determinant() <= 1e-9 * squares.z_axis.z.powi(3) {
            return None;
        }
        plane = Some(squares.inverse() * products);
    }
    plane
}

/// The value that the fraction `rank` of the values do not exceed.
fn quantile(mut values: Vec<f64>, rank: f64) -> f64 {
    let place = (rank * (values.len() - 1) as f64) as usize;
    *values.select_nth_unstable_by(place, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;
    use splatseg_geometry::Image;

    const SIZE: (usize, usize) = (64, 48);
    const THING: SegmentId = 7;

    /// Whether a thing, 20 × 16 pixels in the middle, lies in front of segment 1. `depth` is what the frame measures, given
    /// whether a pixel is the thing's.
    fn stands_out(depth: impl Fn(usize, usize, bool) -> f32) -> bool {
        let is_thing = |column: usize, row: usize| (22..42).contains(&column) && (16..32).contains(&row);
        let seen = SegmentMap::from_fn(SIZE.0, SIZE.1, |column, row| if is_thing(column, row) { THING } else { 1 });
        let shown = SegmentMap::filled(SIZE.0, SIZE.1, 1);
        let depth = Image::from_fn(SIZE.0, SIZE.1, |column, row| depth(column, row, is_thing(column, row)));
        lies_in_front(THING, &seen, &shown, &depth)
    }

    /// The depth of a floor that goes back to the left.
    fn floor(column: usize, row: usize) -> f32 {
        1.0 / (0.3 + 0.004 * column as f32 + 0.008 * row as f32)
    }

    #[test]
    fn a_thing_in_front_of_a_wall_or_on_a_floor_stands_out() {
        assert!(stands_out(|_, _, is_thing| if is_thing { 1.9 } else { 2.0 }));
        assert!(stands_out(|column, row, is_thing| floor(column, row) * if is_thing { 0.95 } else { 1.0 }));
        assert!(!stands_out(|_, _, is_thing| if is_thing { 1.94 } else { 2.0 }), "3 %");
        // An upright thing: its depth is that of the floor under it.
        assert!(stands_out(|column, row, is_thing| floor(column, if is_thing { 32 } else { row })));
    }

    #[test]
    fn a_patch_a_hole_and_a_face_of_a_box_do_not() {
        assert!(!stands_out(|column, row, _| floor(column, row)), "a patch of the same surface");
        assert!(!stands_out(|_, _, is_thing| if is_thing { 2.5 } else { 2.0 }), "a hole");
        let edge = |column: usize, _: usize, _: bool| if column < 42 { 2.0 } else { 2.0 + 0.02 * (column - 41) as f32 };
        assert!(!stands_out(edge), "the surface ends beside it");
        let corner = |_: usize, row: usize, _: bool| 2.0 + 0.02 * row.saturating_sub(15) as f32;
        assert!(!stands_out(corner), "a face that recedes");
    }

    #[test]
    fn around_it_the_surface_must_be_a_plane() {
        // Steps of a stair as high as the thing.
        assert!(!stands_out(|_, row, is_thing| if is_thing || row % 4 < 2 { 1.9 } else { 2.0 }));
    }

    #[test]
    fn without_depth_or_a_segment_nothing_is_told() {
        assert!(!stands_out(|_, _, is_thing| if is_thing { 0.0 } else { 2.0 }));
        assert!(!stands_out(|_, _, is_thing| if is_thing { 1.5 } else { 0.0 }));
        assert!(
            !stands_out(|column, _, is_thing| match column {
                _ if is_thing => 1.5,
                20 => 2.0,
                _ => 0.0,
            }),
            "a line"
        );
        let (seen, depth) = (SegmentMap::filled(8, 8, THING), Image::filled(8, 8, 1.0));
        for shown in [0, THING] {
            assert!(!lies_in_front(THING, &seen, &SegmentMap::filled(8, 8, shown), &depth));
        }
    }

    #[test]
    fn a_few_wrong_pixels_do_not_matter() {
        let noisy = |column: usize, row: usize, depth: f32| match (column * 7 + row * 13) % 10 {
            0 => 0.7,
            1 => 0.0,
            2 => 3.5,
            _ => depth,
        };
        assert!(stands_out(|column, row, is_thing| noisy(column, row, if is_thing { 1.8 } else { 2.0 })));
        assert!(!stands_out(|column, row, is_thing| noisy(column, row, if is_thing { 1.99 } else { 2.0 })));
    }
}
