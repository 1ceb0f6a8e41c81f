//! A frame reduced to a grid of samples.

use crate::MemorySettings;
use glam::Vec2;
use splatseg_geometry::{Intrinsics, LocalPose, RgbdFrame};

/// Maximum number of samples per row and column.
pub(super) const MAX_SIDE: usize = 80;

/// Frames can be compared if they share more than this fraction of the samples.
const MIN_SHARED: f32 = 0.1;

/// Maximum difference of equal colours in each channel.
const MAX_COLOR_DIFFERENCE: u8 = 24;

/// Depth and colour of a frame on a regular grid.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Sketch {
    /// Intrinsics of the whole frame.
    pub intrinsics: Intrinsics,
    pub map_from_camera: LocalPose,
    /// z-depth in metres, 0 where missing, at every `stride`-th pixel of every `stride`-th row.
    pub depth: Vec<f32>,
    /// sRGB, at the same pixels.
    pub color: Vec<[u8; 3]>,
}

/// Spacing of the samples, pixels.
pub(super) fn stride(intrinsics: &Intrinsics) -> usize {
    intrinsics.width.max(intrinsics.height).div_ceil(MAX_SIDE).max(1)
}

/// Number of samples in a row, and number of rows.
pub(super) fn grid(intrinsics: &Intrinsics) -> (usize, usize) {
    let stride = stride(intrinsics);
    (intrinsics.width.div_ceil(stride), intrinsics.height.div_ceil(stride))
}

impl Sketch {
    /// Creates the sketch of a frame taken at a pose in map coordinates.
    pub fn new(frame: &RgbdFrame<'_>, map_from_camera: &LocalPose) -> Self {
        let intrinsics = *frame.intrinsics();
        let stride = stride(&intrinsics);
        let pixels = || {
            let rows = (0..frame.height()).step_by(stride);
            rows.flat_map(|row| (0..frame.width()).step_by(stride).map(move |column| (column, row)))
        };
        Self {
            intrinsics,
            map_from_camera: *map_from_camera,
            depth: pixels().map(|pixel| frame.depth()[pixel]).collect(),
            color: pixels().map(|pixel| frame.color()[pixel]).collect(),
        }
    }

    /// Returns the share of the samples in view with the same depth and colour in `frame`, assuming its camera is at
    /// `pose`; `None` if too few are in view.
    pub fn agreement(&self, frame: &RgbdFrame<'_>, pose: &LocalPose, settings: &MemorySettings) -> Option<f32> {
        self.share(frame, pose, settings, |sample, pixel| is_same_color(self.color[sample], frame.color()[pixel]))
    }

    /// As [`Self::agreement`], comparing only depth.
    pub fn depth_agreement(&self, frame: &RgbdFrame<'_>, pose: &LocalPose, settings: &MemorySettings) -> Option<f32> {
        self.share(frame, pose, settings, |_, _| true)
    }

    fn share(
        &self,
        frame: &RgbdFrame<'_>,
        pose: &LocalPose,
        settings: &MemorySettings,
        is_same: impl Fn(usize, (usize, usize)) -> bool,
    ) -> Option<f32> {
        let camera_from_old = pose.inverse() * self.map_from_camera;
        let (stride, (columns, _)) = (stride(&self.intrinsics), grid(&self.intrinsics));
        let (mut shared, mut same) = (0usize, 0usize);
        for (sample, depth) in self.depth.iter().enumerate().filter(|(_, depth)| **depth > 0.0) {
            let at = Vec2::new((sample % columns * stride) as f32, (sample / columns * stride) as f32);
            let point = camera_from_old.to_world(self.intrinsics.unproject(at, *depth));
            let Some(pixel) = pixel_of(frame.intrinsics(), point) else { continue };
            let observed = frame.depth()[pixel];
            if observed > 0.0 {
                shared += 1;
                let is_near = (observed - point.z).abs() <= settings.tolerance_at(point.z);
                same += usize::from(is_near && is_same(sample, pixel));
            }
        }
        (shared as f32 > MIN_SHARED * self.depth.len() as f32).then(|| same as f32 / shared as f32)
    }

    /// Returns the pixel of the sketched frame that shows the same surface as `frame` at `pixel`, if there is one. If
    /// the camera did not move, a pixel without depth in both frames is the same surface.
    pub fn same_surface(
        &self,
        frame: &RgbdFrame<'_>,
        pixel: (usize, usize),
        old_from_camera: &LocalPose,
        settings: &MemorySettings,
    ) -> Option<(usize, usize)> {
        let depth = frame.depth()[pixel];
        if depth == 0.0 {
            let is_still = *old_from_camera == LocalPose::IDENTITY && self.intrinsics == *frame.intrinsics();
            return (is_still && self.depths_around(pixel).all(|old| old == 0.0)).then_some(pixel);
        }
        let at = Vec2::new(pixel.0 as f32, pixel.1 as f32);
        let point = old_from_camera.to_world(frame.intrinsics().unproject(at, depth));
        let old = pixel_of(&self.intrinsics, point)?;
        let margin = settings.tolerance_at(point.z);
        let is_near = |depth: f32| depth > 0.0 && (depth - point.z).abs() <= margin;
        self.depths_around(old).any(is_near).then_some(old)
    }

    /// Depths of the samples around a pixel.
    fn depths_around(&self, (column, row): (usize, usize)) -> impl Iterator<Item = f32> {
        let (stride, (columns, rows)) = (stride(&self.intrinsics), grid(&self.intrinsics));
        let (left, top) = (column / stride, row / stride);
        let corners = [(left, top), (left + 1, top), (left, top + 1), (left + 1, top + 1)];
        let inside = corners.into_iter().filter(move |(column, row)| *column < columns && *row < rows);
        inside.map(move |(column, row)| self.depth[row * columns + column])
    }
}

/// Returns the pixel that contains a point in camera coordinates.
fn pixel_of(intrinsics: &Intrinsics, point: glam::Vec3) -> Option<(usize, usize)> {
    let pixel = intrinsics.project(point)?.round();
    let is_inside =
        pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x < intrinsics.width as f32 && pixel.y < intrinsics.height as f32;
    is_inside.then_some((pixel.x as usize, pixel.y as usize))
}

fn is_same_color(one: [u8; 3], other: [u8; 3]) -> bool {
    one.iter().zip(other).all(|(one, other)| one.abs_diff(other) <= MAX_COLOR_DIFFERENCE)
}
