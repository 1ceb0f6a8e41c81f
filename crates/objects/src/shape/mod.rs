//! The shape of an object in the world, from the Gaussians that show it.
//!
//! `patches.rs` treats Gaussians as patches of surface, `disputed.rs` and `stray.rs` leave out those that do not belong
//! to the object, and `oriented_box.rs` and `surface_area.rs` measure the rest.

mod disputed;
mod oriented_box;
mod patch_grid;
mod patches;
mod plane;
mod stray;
mod surface_area;

use glam::{DVec3, Quat, Vec3};
use oriented_box::oriented_box;
use patches::{Patch, patches_by_object};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use splatseg_geometry::{MapView, SegmentId};
use std::collections::BTreeMap;
use stray::without_stray;
use surface_area::surface_area;

/// The shortest side of a box, metres: depth cameras do not measure thinner things.
const THINNEST: f64 = 0.001;
/// Tolerance for patches to count as inside a box, metres.
const EDGE: f32 = 0.005;

/// Position and size of an object, as far as it was seen. World coordinates, metres.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ObjectShape {
    /// Mean of the seen surface. It is biased towards the side that the camera saw; the centre of the box is
    /// [`OrientedBox::center`].
    pub centroid: DVec3,
    /// The box along the world's axes.
    pub axis_aligned_box: AxisAlignedBox,
    /// The tightest box of any orientation.
    pub oriented_box: OrientedBox,
    /// Area of the seen surface, square metres.
    pub area_m2: f32,
    /// Mean sRGB colour of that surface.
    pub color: [u8; 3],
    /// Number of Gaussians of the object, without those whose distance is not known: sky, or a dark window.
    pub points: usize,
    /// Number of these Gaussians excluded from all values above, because they were seen almost as often as something
    /// else or lie apart from the rest.
    pub stray_points: usize,
    /// Number of the others that continue a measured surface where depth is missing, as on a screen.
    #[serde(default)]
    pub completed_points: usize,
}

/// A box along the world's axes, metres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AxisAlignedBox {
    /// Minimum x, y and z.
    pub min: DVec3,
    /// Maximum x, y and z.
    pub max: DVec3,
}

/// A box of any orientation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct OrientedBox {
    /// Its centre, world coordinates, metres.
    pub center: DVec3,
    /// Full side lengths along its own axes, metres.
    pub size: Vec3,
    /// World from box: rotates box coordinates into the world. Quaternion x, y, z, w with w ≥ 0.
    pub rotation: Quat,
}

/// The surfaces of all objects with Gaussians in a map, measured once for all that needs them: the list of objects, their
/// relations and their footprints.
#[derive(Clone, Debug, Default)]
pub struct ObjectSurfaces {
    shapes: BTreeMap<SegmentId, ObjectShape>,
    /// The points of each surface, without stray ones: metres, relative to the map's origin.
    points: BTreeMap<SegmentId, Vec<Vec3>>,
}

impl ObjectSurfaces {
    /// Measures the objects of a map.
    pub fn of(map: &MapView<'_>) -> Self {
        let objects: Vec<(SegmentId, Vec<Patch>)> = patches_by_object(map).into_iter().collect();
        let measured: Vec<(SegmentId, ObjectShape, Vec<Vec3>)> = objects
            .into_par_iter()
            .map(|(id, patches)| {
                let kept = without_stray(&patches);
                let points = kept.iter().map(|patch| patch.mean).collect();
                (id, shape_of(&kept, patches.len(), map.origin), points)
            })
            .collect();
        let mut surfaces = Self::default();
        for (id, shape, points) in measured {
            surfaces.shapes.insert(id, shape);
            surfaces.points.insert(id, points);
        }
        surfaces
    }

    /// The shape of each object.
    pub fn shapes(&self) -> &BTreeMap<SegmentId, ObjectShape> {
        &self.shapes
    }

    pub(crate) fn points(&self) -> &BTreeMap<SegmentId, Vec<Vec3>> {
        &self.points
    }
}

/// The shapes of all objects with Gaussians in the map.
pub fn object_shapes(map: &MapView<'_>) -> BTreeMap<SegmentId, ObjectShape> {
    ObjectSurfaces::of(map).shapes
}

/// The shape of an object of at least one patch: of those that are `kept` of `patches`, relative to `origin`.
fn shape_of(kept: &[Patch], patches: usize, origin: DVec3) -> ObjectShape {
    let (mut center, mut color, mut area) = (DVec3::ZERO, [0.0; 3], 0.0);
    for patch in kept {
        let weight = f64::from(patch.area());
        center += weight * patch.mean.as_dvec3();
        color.iter_mut().zip(patch.color).for_each(|(sum, channel)| *sum += weight * f64::from(channel));
        area += weight;
    }
    let oriented = oriented_box(kept);
    let aligned = axis_aligned_box(kept, &oriented);
    let smallest = kept.iter().map(|patch| patch.side).fold(0.0, f32::max).into();
    let middle = 0.5 * (aligned.min + aligned.max);
    let half = 0.5 * not_empty(aligned.max - aligned.min, smallest);
    let aligned = AxisAlignedBox { min: middle - half, max: middle + half };
    ObjectShape {
        centroid: rounded(center / area + origin),
        axis_aligned_box: AxisAlignedBox { min: rounded(aligned.min + origin), max: rounded(aligned.max + origin) },
        oriented_box: OrientedBox {
            center: rounded(oriented.center + origin),
            size: rounded(not_empty(oriented.size.as_dvec3(), smallest)).as_vec3(),
            ..oriented
        },
        area_m2: surface_area(kept),
        color: color.map(|sum| (sum / area).round() as u8),
        points: patches,
        stray_points: patches - kept.len(),
        completed_points: kept.iter().filter(|patch| patch.is_completed).count(),
    }
}

/// The sides of a box of at least one patch, metres. Boxes are measured between the centres of patches. If even the
/// longest side is shorter than a patch, whose side is `patch`, all sides have its length.
fn not_empty(sides: DVec3, patch: f64) -> DVec3 {
    if sides.max_element() < patch { DVec3::splat(patch) } else { sides.max(DVec3::splat(THINNEST)) }
}

/// Rounds to a tenth of a millimetre; further digits are noise.
fn rounded(metres: DVec3) -> DVec3 {
    // Adding 0 makes -0 positive.
    (metres * 1e4).round() / 1e4 + 0.0
}

/// The box along the world's axes around the patches inside the oriented box. Quantiles along the world's axes would
/// cut the corners of a rotated object.
fn axis_aligned_box(patches: &[Patch], oriented: &OrientedBox) -> AxisAlignedBox {
    let box_from_world = oriented.rotation.inverse();
    let (center, half) = (oriented.center.as_vec3(), 0.5 * oriented.size + EDGE);
    let is_inside = |point: Vec3| (box_from_world * (point - center)).abs().cmple(half).all();
    let (mut min, mut max) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for patch in patches.iter().filter(|patch| is_inside(patch.mean)) {
        (min, max) = (min.min(patch.mean), max.max(patch.mean));
    }
    // No patch is inside if each of a few is far from the others along some axis.
    if min.cmple(max).all() {
        AxisAlignedBox { min: min.as_dvec3(), max: max.as_dvec3() }
    } else {
        AxisAlignedBox { min: oriented.center, max: oriented.center }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_box_is_empty() {
        let at = |x: f32| Patch::seen(Vec3::new(x, 2.0, 3.0), 0.02);
        let point = shape_of(&[at(1.0)], 1, DVec3::ZERO);
        assert_eq!(point.oriented_box.size, Vec3::splat(0.02));
        let sides = point.axis_aligned_box.max - point.axis_aligned_box.min;
        assert!(sides.abs_diff_eq(DVec3::splat(0.02), 1e-9), "{sides}");
        assert_eq!((point.centroid, point.oriented_box.center), (DVec3::new(1.0, 2.0, 3.0), DVec3::new(1.0, 2.0, 3.0)));
        // A row of patches is as long as they are, and not infinitely thin.
        let row: Vec<Patch> = (0..20).map(|place| at(0.01 * place as f32)).collect();
        let row = shape_of(&without_stray(&row), row.len(), DVec3::ZERO).oriented_box.size;
        assert!(row.max_element() > 0.15 && row.min_element() >= 0.001, "{row}");
    }
}
