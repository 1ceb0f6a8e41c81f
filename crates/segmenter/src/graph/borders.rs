//! Statistics of patches and of the borders between them. All are sums, so they are added when patches are merged.

use super::color::{Lab, difference};
use super::edges::Fold;
use super::patches::Patches;
use super::settings::GraphSettings;
use super::surface::Surface;
use glam::DVec3;
use splatseg_geometry::Image;
use std::collections::BTreeMap;

/// Distance from a border at which the colours and depths of its two sides are compared, pixels. Closer values are
/// blurred by smoothing.
const NEAR_PROBE: usize = 2;

/// Distance from a border at which normals are compared, pixels. A plane fitted closer to a crease uses points from
/// both sides.
const FAR_PROBE: usize = 6;

/// Sums over the pixels of a region.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Region {
    /// Number of pixels.
    pub area: f64,
    /// Length of its outline within the image, pixel sides.
    pub outline: f64,
    color: DVec3,
    plane: PlaneMoments,
}

/// Sums over the pixel sides between two regions.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Border {
    /// Number of pixel sides.
    pub length: f64,
    /// Number of pixel sides with a known surface on both sides.
    pub known: f64,
    /// Number of pixel sides with a step in depth. Small steps count fractionally.
    pub stepped: f64,
    /// Sum of concave turns, radians.
    pub concave: f64,
    /// Sum of convex turns, radians.
    pub convex: f64,
    /// Sum of colour differences, ΔE.
    pub color: f64,
}

/// Regions and their borders.
pub(super) struct Regions {
    /// All regions. Those merged into another stay in the list.
    pub regions: Vec<Region>,
    /// For each region, its borders by the neighbour's number.
    pub borders: Vec<BTreeMap<u32, Border>>,
}

impl Regions {
    /// Makes every patch a region.
    pub fn from_patches(patches: &Patches, lab: &Image<Lab>, surface: &Surface, settings: &GraphSettings) -> Self {
        let (width, height) = lab.size();
        let mut regions = vec![Region::default(); patches.count];
        let mut borders: Vec<BTreeMap<u32, Border>> = vec![BTreeMap::new(); patches.count];
        let probes = Probes { patches, lab, surface, settings };
        for row in 0..height {
            for column in 0..width {
                let label = patches.labels[row * width + column];
                regions[label as usize].add_pixel(lab[(column, row)], surface, (column, row));
                for (right, down) in [(1, 0), (0, 1)] {
                    let near = (column + right, row + down);
                    if near.0 >= width || near.1 >= height {
                        continue;
                    }
                    let near_label = patches.labels[near.1 * width + near.0];
                    if near_label != label {
                        let side = probes.compare((column, row), near);
                        borders[label.min(near_label) as usize].entry(label.max(near_label)).or_default().add(&side);
                        regions[label as usize].outline += 1.0;
                        regions[near_label as usize].outline += 1.0;
                    }
                }
            }
        }
        for first in 0..borders.len() {
            for (second, border) in borders[first].clone().range(first as u32 + 1..) {
                borders[*second as usize].insert(first as u32, *border);
            }
        }
        Self { regions, borders }
    }
}

impl Region {
    fn add_pixel(&mut self, lab: Lab, surface: &Surface, (column, row): (usize, usize)) {
        self.area += 1.0;
        self.color += DVec3::from(lab.map(f64::from));
        let facet = surface.facets[(column, row)];
        if facet.measured {
            let ray = surface.ray(column, row);
            self.plane.add_point(ray.as_dvec3(), f64::from(facet.plane.dot(ray)));
        }
    }

    /// Adds another region. `shared` is the length of the common border.
    pub fn add(&mut self, other: &Self, shared: f64) {
        self.area += other.area;
        self.outline += other.outline - 2.0 * shared;
        self.color += other.color;
        self.plane.add(&other.plane);
    }

    /// Distance of the mean colours of two regions, ΔE.
    pub fn color_difference(&self, other: &Self, lightness: f32) -> f64 {
        let mean = |region: &Self| (region.color / region.area).as_vec3().to_array();
        f64::from(difference(mean(self), mean(other), lightness))
    }

    /// Deviation of two regions from a common plane, 1/m of inverse depth: root of the additional squared error of one
    /// plane for both over a plane for each, per point of the smaller region. `None` if any of the planes is
    /// undetermined.
    pub fn off_plane(&self, other: &Self) -> Option<f64> {
        let mut union = self.plane;
        union.add(&other.plane);
        let least = self.plane.count.min(other.plane.count);
        let more = union.squared_error()? - self.plane.squared_error()? - other.plane.squared_error()?;
        Some((more / least).max(0.0).sqrt())
    }
}

impl Border {
    /// Adds the sides of another border.
    pub fn add(&mut self, other: &Self) {
        self.length += other.length;
        self.known += other.known;
        self.stepped += other.stepped;
        self.concave += other.concave;
        self.convex += other.convex;
        self.color += other.color;
    }
}

/// The images in which the two sides of a border are compared.
struct Probes<'a> {
    patches: &'a Patches,
    lab: &'a Image<Lab>,
    surface: &'a Surface,
    settings: &'a GraphSettings,
}

impl Probes<'_> {
    /// Measures one pixel side of a border, between `pixel` and `near`, its right or lower neighbour.
    fn compare(&self, pixel: (usize, usize), near: (usize, usize)) -> Border {
        let step = ((near.0 - pixel.0) as isize, (near.1 - pixel.1) as isize);
        let back = (-step.0, -step.1);
        let ends = [self.inside(pixel, back, NEAR_PROBE), self.inside(near, step, NEAR_PROBE)];
        let far_ends =
            [self.inside(ends[0], back, FAR_PROBE - NEAR_PROBE), self.inside(ends[1], step, FAR_PROBE - NEAR_PROBE)];
        let color = difference(self.lab[ends[0]], self.lab[ends[1]], self.settings.lightness);
        let mut border = Border { length: 1.0, color: f64::from(color), ..Border::default() };
        if let (Some(fold), Some(far_fold)) = (self.fold(ends), self.fold(far_ends)) {
            border.known = 1.0;
            border.stepped = f64::from(((fold.step / self.settings.surface.noise - 1.0) / 4.0).clamp(0.0, 1.0));
            border.concave = f64::from(far_fold.concave);
            border.convex = f64::from(far_fold.convex);
        }
        border
    }

    fn fold(&self, ends: [(usize, usize); 2]) -> Option<Fold> {
        Fold::between(ends.map(|end| self.surface.facets[end]), ends.map(|(column, row)| self.surface.ray(column, row)))
    }

    /// The last pixel of the same patch within `reach` steps.
    fn inside(&self, pixel: (usize, usize), step: (isize, isize), reach: usize) -> (usize, usize) {
        let (width, height) = self.lab.size();
        let label = self.patches.labels[pixel.1 * width + pixel.0];
        let mut end = pixel;
        for _ in 0..reach {
            match (end.0.checked_add_signed(step.0), end.1.checked_add_signed(step.1)) {
                (Some(column), Some(row))
                    if column < width && row < height && self.patches.labels[row * width + column] == label =>
                {
                    end = (column, row);
                }
                _ => break,
            }
        }
        end
    }
}

/// Sums over points with inverse depth w along rays (x, y, 1), for the least-squares plane w = a x + b y + c.
#[derive(Clone, Copy, Debug, Default)]
struct PlaneMoments {
    count: f64,
    /// Σ (x, y, w).
    sum: DVec3,
    /// Σ (x², y², w²).
    squares: DVec3,
    /// Σ (x y, x w, y w).
    products: DVec3,
}

impl PlaneMoments {
    fn add_point(&mut self, ray: DVec3, inverse_depth: f64) {
        let (x, y, w) = (ray.x, ray.y, inverse_depth);
        self.count += 1.0;
        self.sum += DVec3::new(x, y, w);
        self.squares += DVec3::new(x * x, y * y, w * w);
        self.products += DVec3::new(x * y, x * w, y * w);
    }

    fn add(&mut self, other: &Self) {
        self.count += other.count;
        self.sum += other.sum;
        self.squares += other.squares;
        self.products += other.products;
    }

    /// Summed squared error of the least-squares plane. `None` for too few points or points on a line.
    fn squared_error(&self) -> Option<f64> {
        if self.count < 6.0 {
            return None;
        }
        // Centred on the mean, since the raw sums nearly cancel far from the optical axis.
        let DVec3 { x, y, z: w } = self.sum;
        let [xx, yy, ww] = (self.squares - self.sum * self.sum / self.count).to_array();
        let [xy, xw, yw] = (self.products - DVec3::new(x * y, x * w, y * w) / self.count).to_array();
        let determinant = xx * yy - xy * xy;
        (determinant > 1e-4 * (xx + yy) * (xx + yy))
            .then(|| (ww - (xw * xw * yy - 2.0 * xw * yw * xy + yw * yw * xx) / determinant).max(0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn region(plane: DVec3, columns: std::ops::Range<i32>) -> Region {
        let mut region = Region { area: 1.0, ..Region::default() };
        for column in columns {
            for row in 0..10 {
                let ray = DVec3::new(f64::from(column) * 0.01, f64::from(row) * 0.01, 1.0);
                region.plane.add_point(ray, plane.dot(ray));
            }
        }
        region
    }

    #[test]
    fn parts_of_one_plane_fit_and_a_shifted_part_is_off_by_its_shift() {
        let wall = DVec3::new(0.1, -0.2, 0.5);
        let large = region(wall, 0..200);
        assert!(large.off_plane(&region(wall, 90..100)).unwrap() < 1e-5);
        let shifted = region(wall + DVec3::new(0.0, 0.0, 0.02), 90..100);
        let off = large.off_plane(&shifted).unwrap();
        assert!((off - 0.02).abs() < 1e-3, "{off}");
        assert_eq!(large.off_plane(&shifted), shifted.off_plane(&large));
    }

    #[test]
    fn too_few_or_collinear_points_give_none() {
        let wall = region(DVec3::Z, 0..20);
        assert_eq!(wall.off_plane(&Region::default()), None);
        assert_eq!(wall.off_plane(&region(DVec3::Z, 3..4)), None);
    }
}
