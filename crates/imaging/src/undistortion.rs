//! Undistortion of images: redrawn as a pinhole camera at the same place would see them.

use glam::{DVec2, dvec2};
use splatseg_geometry::{CowImage, Distortion, Image, Intrinsics, Pose};

/// A view is widened by at most this share of an image's side at each end.
const MAX_WIDENING: f64 = 0.5;
/// Nearest distance that is needed of an image that is warped to another camera, metres.
const NEAREST_M: f64 = 0.1;
/// Pixels around what is needed, for the pixels that are spread out when depth is warped.
const NEEDED_MARGIN: f64 = 2.0;
/// Directions with a smaller forward component than this (of a unit vector) are not bounded.
const MIN_FORWARD: f64 = 0.05;
/// Number of places along each side of an image at which its view is measured.
const BORDER_PLACES: usize = 64;

/// Map from each pixel of an undistorted image to its position in the distorted image.
#[derive(Clone, Debug)]
pub struct UndistortionMap {
    /// Size of the undistorted image.
    width: usize,
    height: usize,
    /// Size of the distorted image.
    source: (usize, usize),
    /// `[height, width]`, the `(column, row)` in the distorted image; `None` outside it.
    sources: Vec<Option<[f32; 2]>>,
}

impl UndistortionMap {
    /// Memory used by the map per pixel.
    pub const BYTES_PER_PIXEL: u64 = size_of::<Option<[f32; 2]>>() as u64;

    /// Computes the map from the image of a camera with a lens to that of the pinhole camera `target` at the same place. Both
    /// intrinsics must be [valid](Intrinsics::validated).
    pub fn new((camera, distortion): (&Intrinsics, &Distortion), target: &Intrinsics) -> Self {
        let Intrinsics { width, height, .. } = *target;
        let ((focal, center), (target_focal, target_center)) = (optics(camera), optics(target));
        let end = |camera: &Intrinsics| dvec2(camera.width as f64, camera.height as f64) - 1.0;
        let (last, target_last) = (end(camera), end(target));
        let farthest = ((target_last - target_center).abs().max(target_center.abs()) / target_focal).length();
        let usable_squared = distortion.usable_radius(farthest).powi(2);
        let source = |column: usize, row: usize| {
            let point = (dvec2(column as f64, row as f64) - target_center) / target_focal;
            let pixel = distortion.distort(point) * focal + center;
            let inside = pixel.cmpge(dvec2(-0.5, -0.5)).all() && pixel.cmple(last + 0.5).all();
            let usable = point.length_squared() <= usable_squared;
            (inside && usable).then(|| pixel.as_vec2().to_array())
        };
        let sources = (0..height).flat_map(|row| (0..width).map(move |column| (column, row)));
        let sources = sources.map(|(column, row)| source(column, row)).collect();
        Self { width, height, source: (camera.width, camera.height), sources }
    }

    /// Returns the `(width, height)` of the images it applies to, pixels.
    pub fn source_size(&self) -> (usize, usize) {
        self.source
    }

    /// Returns the position, `(column, row)`, of an undistorted pixel in the distorted image; `None` outside it.
    pub fn source(&self, column: usize, row: usize) -> Option<[f32; 2]> {
        if column >= self.width {
            return None;
        }
        self.sources.get(row.checked_mul(self.width)?.checked_add(column)?).copied().flatten()
    }

    /// Returns the share of the undistorted pixels, 0 to 1, that the lens does not show.
    pub fn unseen_share(&self) -> f64 {
        let count = self.sources.iter().filter(|source| source.is_none()).count();
        count as f64 / self.sources.len().max(1) as f64
    }

    /// Undistorts colour, `[height, width]`, by bilinear interpolation. Black outside the lens's view. `None` if the image
    /// does not have the [source's size](Self::source_size).
    pub fn color(&self, image: &CowImage<'_, [u8; 3]>) -> Option<Image<[u8; 3]>> {
        (image.size() == self.source).then(|| {
            self.draw(|[x, y]| {
                let (left, x) = split(x, self.source.0);
                let (top, y) = split(y, self.source.1);
                let (right, bottom) = ((left + 1).min(self.source.0 - 1), (top + 1).min(self.source.1 - 1));
                let corners = [(left, top), (right, top), (left, bottom), (right, bottom)].map(|at| image[at]);
                let weights = [(1.0 - x) * (1.0 - y), x * (1.0 - y), (1.0 - x) * y, x * y];
                [0, 1, 2].map(|channel| {
                    let sum: f32 =
                        corners.iter().zip(weights).map(|(pixel, weight)| f32::from(pixel[channel]) * weight).sum();
                    sum.round() as u8
                })
            })
        })
    }

    /// Undistorts depth (z, metres, 0 if missing), `[height, width]`, by taking the nearest measurement, never a
    /// mixture. `None` if the image does not have the [source's size](Self::source_size).
    pub fn depth(&self, image: &CowImage<'_, f32>) -> Option<Image<f32>> {
        let nearest = |at: f32, len: usize| (at.round().max(0.0) as usize).min(len - 1);
        (image.size() == self.source)
            .then(|| self.draw(|[x, y]| image[(nearest(x, self.source.0), nearest(y, self.source.1))]))
    }

    fn draw<T: Clone + Default>(&self, pixel: impl Fn([f32; 2]) -> T) -> Image<T> {
        let mut sources = self.sources.iter();
        Image::from_fn(self.width, self.height, |_, _| {
            sources.next().copied().flatten().map_or_else(T::default, &pixel)
        })
    }
}

/// Returns the focal lengths and the principal point of a camera.
fn optics(camera: &Intrinsics) -> (DVec2, DVec2) {
    (dvec2(camera.fx.into(), camera.fy.into()), dvec2(camera.cx.into(), camera.cy.into()))
}

/// Returns a pinhole camera with the focal lengths of a distorted one that sees all of its image, as far as twice its size
/// suffices, and as far as the cameras to which it is warped see it.
pub fn whole_view(camera: &Intrinsics, distortion: &Distortion, seen_by: &SeenBy) -> Intrinsics {
    let (focal, center) = optics(camera);
    let last = dvec2(camera.width as f64, camera.height as f64) - 1.0;
    let room = (last + 1.0) * MAX_WIDENING;
    let (mut low, mut high) = (DVec2::ZERO, last);
    for pixel in border(last) {
        // Nothing is seen where the lens shows nothing.
        if let Some(point) = distortion.undistort((pixel - center) / focal) {
            let seen = (point * focal + center).clamp(-room, last + room);
            (low, high) = (low.min(seen), high.max(seen));
        }
    }
    if let Some((needed_low, needed_high)) = seen_by.bounds() {
        let (first, end) = (needed_low * focal + center - NEEDED_MARGIN, needed_high * focal + center + NEEDED_MARGIN);
        // Cameras that see nothing in common keep one pixel.
        low = low.max(first).min(high);
        high = high.min(end).max(low);
    }
    let (low, high) = (low.floor(), high.ceil());
    let (size, center) = (high - low + 1.0, center - low);
    Intrinsics { cx: center.x as f32, cy: center.y as f32, width: size.x as usize, height: size.y as usize, ..*camera }
}

/// Returns places along the border of an image whose last pixel is `last`.
fn border(last: DVec2) -> impl Iterator<Item = DVec2> {
    (0..=BORDER_PLACES).flat_map(move |place| {
        let along = last * (place as f64 / BORDER_PLACES as f64);
        [dvec2(along.x, 0.0), dvec2(along.x, last.y), dvec2(0.0, along.y), dvec2(last.x, along.y)]
    })
}

/// The cameras to which an image is warped after it was undistorted: what they do not see needs not be drawn.
#[derive(Clone, Debug)]
pub struct SeenBy {
    /// Their intrinsics.
    pub cameras: Vec<Intrinsics>,
    /// From the coordinates of the undistorted camera to theirs.
    pub from_undistorted: Pose,
}

impl SeenBy {
    /// Returns the lowest and highest coordinates, at a depth of 1, of what the cameras see from [`NEAREST_M`] on; `None` if
    /// some of it is beside or behind the undistorted camera.
    fn bounds(&self) -> Option<(DVec2, DVec2)> {
        let to_undistorted = self.from_undistorted.inverse();
        let (turn, shift) = (to_undistorted.rotation(), to_undistorted.translation());
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for camera in &self.cameras {
            let (focal, center) = optics(camera);
            let last = dvec2(camera.width as f64, camera.height as f64) - 1.0;
            for pixel in border(last + 1.0) {
                let ray = ((pixel - 0.5 - center) / focal).extend(1.0);
                // Far away and near; between, it moves along a line.
                for point in [turn * ray, turn * (ray * NEAREST_M) + shift] {
                    if point.z < MIN_FORWARD * point.length() {
                        return None;
                    }
                    let seen = point.truncate() / point.z;
                    (low, high) = (low.min(seen), high.max(seen));
                }
            }
        }
        low.is_finite().then_some((low, high)).filter(|(_, high)| high.is_finite())
    }
}

/// Splits a position inside the image into the pixel at or before it and the remainder, 0 to 1. Positions are clamped
/// to the edge.
fn split(at: f32, len: usize) -> (usize, f32) {
    let at = at.clamp(0.0, (len - 1) as f32);
    let before = at.floor();
    (before as usize, at - before)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DVec3, dvec3};

    /// A camera that sees as much as the wide mode of an Azure Kinect, beside a colour camera of 90 degrees.
    #[test]
    fn what_is_warped_is_drawn_as_far_as_it_is_seen() {
        let depth = Intrinsics { fx: 504.0, fy: 504.0, cx: 511.5, cy: 511.5, width: 1024, height: 1024 };
        let color = Intrinsics { fx: 980.0, fy: 980.0, cx: 1023.5, cy: 767.5, width: 2048, height: 1536 };
        let lens = Distortion::from_coefficients("equidistant", &[0.01, 0.0, 0.0, 0.0]).unwrap();
        let color_from_depth = Pose::from_translation(dvec3(-0.032, -0.002, 0.004));
        let view = |cameras: Vec<Intrinsics>, from_undistorted: Pose| {
            whole_view(&depth, &lens, &SeenBy { cameras, from_undistorted })
        };
        let (whole, seen) = (view(Vec::new(), color_from_depth), view(vec![color], color_from_depth));
        let pixels = |camera: &Intrinsics| camera.width * camera.height;
        assert!(2 * pixels(&seen) < pixels(&whole), "{seen:?} {whole:?}");
        for z in [NEAREST_M, 1.0, 1e6] {
            for (column, row) in [(0.0, 0.0), (2047.0, 0.0), (0.0, 1535.0), (2047.0, 1535.0), (1000.0, 0.0)] {
                let ray = dvec3((column - 1023.5) / 980.0, (row - 767.5) / 980.0, 1.0);
                let point: DVec3 = ray * z - color_from_depth.translation();
                let (focal, center) = optics(&seen);
                let pixel = point.truncate() / point.z * focal + center;
                let end = dvec2(seen.width as f64, seen.height as f64) - 1.0;
                assert!(pixel.cmpge(DVec2::ZERO).all() && pixel.cmple(end).all(), "{pixel} of {seen:?}");
            }
        }
        // What looks the other way sees nothing that could be left out, and the view stays valid.
        let back = Pose::from_quaternion(DVec3::ZERO, glam::DQuat::from_rotation_y(std::f64::consts::PI)).unwrap();
        assert_eq!(view(vec![color], back), whole);
        let aside = Pose::from_translation(dvec3(1e3, 0.0, 0.0));
        assert!(view(vec![Intrinsics { width: 2, height: 2, ..color }], aside).validated().is_ok());
    }
}
