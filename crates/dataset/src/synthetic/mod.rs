//! A furnished room that is ray-cast on demand, with exact depth, poses and instance ids.

mod noise;
mod room;
mod settings;
mod solids;
mod texture;

pub use noise::Noise;
pub use settings::SyntheticSettings;
pub(crate) use settings::{LAYOUT, looks_like};

use crate::{DatasetError, Scene};
use glam::Vec2;
use noise::{Sample, as_kinect_sees, color_bytes};
use rayon::prelude::*;
use room::{Room, brightness};
use solids::Ray;
use splatseg_geometry::{Image, Intrinsics, Pose, RgbdFrame, SegmentMap};

/// Focal length in image widths: a field of view of 58 degrees, a Kinect's.
const FOCAL_WIDTHS: f32 = 0.9;

/// A room with textured boxes, spheres and cylinders through which a camera walks in rounds, so that things leave the
/// image and come back. Frames are rendered when they are read, the same ones for the same settings.
///
/// Floor, ceiling and walls have ids 1 to 6, the things ids from 7. World coordinates have z up and their origin in
/// the middle of the floor.
#[derive(Debug)]
pub struct SyntheticScene {
    name: String,
    settings: SyntheticSettings,
    room: Room,
    intrinsics: Intrinsics,
}

impl SyntheticScene {
    /// Furnishes the room.
    ///
    /// # Errors
    /// [`DatasetError::Synthetic`] names a setting that is out of range.
    pub fn new(settings: SyntheticSettings) -> Result<Self, DatasetError> {
        settings.validate()?;
        let (width, height) = (settings.width, settings.height);
        let focal = FOCAL_WIDTHS * width as f32;
        let intrinsics = Intrinsics {
            fx: focal,
            fy: focal,
            cx: (width as f32 - 1.0) / 2.0,
            cy: (height as f32 - 1.0) / 2.0,
            width,
            height,
        };
        let room = Room::furnished(settings.seed, settings.objects);
        Ok(Self { name: settings.to_string(), settings, room, intrinsics })
    }

    /// The settings it was made with.
    pub fn settings(&self) -> &SyntheticSettings {
        &self.settings
    }

    fn check_index(&self, index: usize) -> Result<(), DatasetError> {
        if index < self.settings.frames {
            return Ok(());
        }
        Err(DatasetError::NoSuchFrame { scene: self.name.clone(), index, count: self.settings.frames })
    }

    /// What the ray through the middle of every pixel sees, exactly.
    fn cast_rays(&self, pose: &Pose) -> Image<Sample> {
        let (width, height) = (self.intrinsics.width, self.intrinsics.height);
        let sample_at = |index: usize| self.sample(pose, Vec2::new((index % width) as f32, (index / width) as f32));
        // Whole rows to a task: single pixels are too little work.
        let samples: Vec<Sample> = (0..width * height).into_par_iter().with_min_len(width).map(sample_at).collect();
        let mut samples = samples.into_iter();
        Image::from_fn(width, height, |_, _| samples.next().unwrap_or_default())
    }

    fn sample(&self, pose: &Pose, pixel: Vec2) -> Sample {
        // With depth 1 the ray's direction has z = 1 in the camera, so that distance along it is z-depth.
        let direction = pose.rotation() * self.intrinsics.unproject(pixel, 1.0);
        let ray = Ray { origin: pose.translation(), direction };
        let Some((solid, hit)) = self.room.first_hit(ray) else { return Sample::default() };
        let lit = brightness(ray.origin + hit.t * direction, hit.normal);
        Sample {
            id: solid.id,
            depth: hit.t,
            color: solid.texture.color_at(hit.point_local) * lit,
            cosine: -hit.normal.dot(direction.normalize()),
        }
    }
}

impl Scene for SyntheticScene {
    fn name(&self) -> &str {
        &self.name
    }

    fn frame_count(&self) -> usize {
        self.settings.frames
    }

    fn frame_name(&self, index: usize) -> String {
        if index < self.settings.frames { format!("frame-{index:06}") } else { String::new() }
    }

    fn read_frame(&self, index: usize) -> Result<RgbdFrame, DatasetError> {
        self.check_index(index)?;
        let pose = self.room.camera_pose(index);
        let exact = self.cast_rays(&pose);
        let (width, height) = exact.size();
        let measured: Vec<([u8; 3], f32)> = match self.settings.noise {
            Noise::None => exact.pixels().iter().map(|sample| (color_bytes(sample.color), sample.depth)).collect(),
            Noise::Kinect => as_kinect_sees(&exact, self.settings.seed, index),
        };
        let color = Image::from_fn(width, height, |column, row| measured[row * width + column].0);
        let depth = Image::from_fn(width, height, |column, row| measured[row * width + column].1);
        let name = self.frame_name(index);
        RgbdFrame::new(name.clone(), color, depth, self.intrinsics, pose)
            .map_err(|source| DatasetError::Frame { name, source })
    }

    fn has_ground_truth(&self) -> bool {
        true
    }

    fn read_ground_truth(&self, index: usize) -> Result<Option<SegmentMap>, DatasetError> {
        self.check_index(index)?;
        Ok(Some(self.cast_rays(&self.room.camera_pose(index)).map(|sample| sample.id)))
    }
}
