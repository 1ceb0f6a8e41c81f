//! Furnished rooms and a corridor, ray-cast on demand, with exact depth, poses and instance ids.

mod change;
mod corridor;
mod free_space;
mod furniture;
mod layout;
mod motion;
mod movers;
mod noise;
mod rays;
mod room;
mod scenery;
mod settings;
mod solids;
mod speed;
mod surfaces;
mod texture;
mod thing;
mod tour;
mod visibility;
mod walk;

pub use change::{ChangeKind, TrueChange, Visit};
pub use layout::Layout;
pub use motion::{Motion, Mover};
pub use noise::Noise;
pub use settings::{CameraMotion, SyntheticSettings};
pub(crate) use settings::{LAYOUT, looks_like};
pub use speed::{Speed, SpeedError};
pub use thing::{Thing, ThingKind};

use crate::files::MemoryRequirement;
use crate::own_camera::{OwnCamera, camera_place};
use crate::scene::{FramePart, FrameParts};
use crate::{DatasetError, Format, RecordedFrame, Scene};
use glam::DVec3;
use noise::{Sample, color_bytes, kinect_measurements};
use rays::Caster;
use scenery::Scenery;
use splatseg_geometry::{Image, Intrinsics, LocalPose, SegmentId, SegmentMap};
use std::path::{Path, PathBuf};

/// Focal length in image widths, for a Kinect's field of view of 58 degrees.
const FOCAL_WIDTHS: f32 = 0.9;

/// Memory for rendering a frame, bytes per pixel: two copies of the ray samples, and the frame.
const RENDERING_BYTES_PER_PIXEL: u64 = 2 * size_of::<Sample>() as u64 + 16;

/// A room with textured boxes, spheres and cylinders, or another [`Layout`]. The camera walks through it in a circle, so
/// that objects leave the view and return. Frames are rendered when they are read, and equal settings give equal frames. With
/// [`SyntheticSettings::moving`] some things slide, vanish or appear, consistently in colour, depth and ids. With
/// [`SyntheticSettings::speed`] frames are closer together, as in a video.
///
/// Floor, ceiling and walls have ids 1 to 6, the things ids from 7. In a tour, each room has its own floor, ceiling and
/// four walls: ids 1 to 24 if there are four rooms, with the things from 25. In a corridor, the ends have ids 5 and 6,
/// and each door has three from 7 on: the leaf with its handle, the frame, the sign. World coordinates have z up and
/// their origin at the centre of the floor.
#[derive(Debug)]
pub struct SyntheticScene {
    name: String,
    settings: SyntheticSettings,
    scenery: Scenery,
    movers: Vec<Mover>,
    changes: Vec<TrueChange>,
    intrinsics: Intrinsics,
    own_camera: Option<OwnCamera>,
}

impl SyntheticScene {
    /// Furnishes the room.
    ///
    /// # Errors
    /// [`DatasetError::MemoryLimit`] if its frames are too large; [`DatasetError::Synthetic`] names a setting that is
    /// out of range, including more moving things than there are things on which nothing else stands.
    pub fn new(settings: SyntheticSettings) -> Result<Self, DatasetError> {
        settings.validate()?;
        let (width, height) = (settings.width, settings.height);
        let remedy = "choose a smaller width and height, or raise --memory-limit";
        let requirement = MemoryRequirement {
            what: "frame",
            size: (width, height),
            bytes_per_pixel: RENDERING_BYTES_PER_PIXEL,
            remedy,
        };
        requirement.check(Path::new(&settings.to_string()))?;
        let focal = FOCAL_WIDTHS * width as f32;
        let intrinsics = Intrinsics {
            fx: focal,
            fy: focal,
            cx: (width as f32 - 1.0) / 2.0,
            cy: (height as f32 - 1.0) / 2.0,
            width,
            height,
        };
        let SyntheticSettings { seed, objects, layout, .. } = settings;
        let scenery = match layout {
            Layout::Room => room::furnished(seed, objects, settings.visit.map_or(0, |_| objects / 5)),
            Layout::Tour(rooms) => tour::furnished(seed, rooms, objects),
            Layout::Corridor(doors) => corridor::furnished(seed, doors),
        };
        let (name, movers) = (settings.to_string(), Vec::new());
        let mut scene = Self { name, settings, scenery, movers, changes: Vec::new(), intrinsics, own_camera: None };
        scene.apply_changes()?;
        scene.movers = scene.choose_movers()?;
        Ok(scene)
    }

    /// Changes the stated intrinsics, not those that frames are rendered with.
    pub(crate) fn with_camera(self, own_camera: Option<OwnCamera>) -> Self {
        Self { own_camera, ..self }
    }

    /// Returns the things in the scene, by increasing id, without walls, floors, ceilings and doors.
    pub fn things(&self) -> Vec<Thing> {
        self.scenery.things().map(Thing::from).collect()
    }

    /// Returns the thing that a thing stands on; `None` if it stands on the floor.
    pub fn carrier(&self, id: SegmentId) -> Option<SegmentId> {
        self.scenery.carriers.get(&id).copied()
    }

    /// Returns the groups of twins: things of equal shape, size and texture, two or more in each group, by increasing id.
    /// A [`Layout::Room`] has none, apart from things that are equal by chance.
    pub fn twins(&self) -> &[Vec<SegmentId>] {
        &self.scenery.twins
    }

    /// Returns the number of frames in which the camera passes every place once: a round, or the length of a corridor.
    pub fn frames_per_round(&self) -> usize {
        self.settings.speed.frames_for(self.scenery.walk.frames())
    }

    /// Returns the things that move, vanish or appear, and how. The kinds alternate: slide, vanish, appear, slide, and
    /// so on. If nothing has room to slide, a thing vanishes instead. A smaller [`SyntheticSettings::moving`] gives a
    /// prefix of the same movers.
    pub fn movers(&self) -> &[Mover] {
        &self.movers
    }

    /// Returns the differences between the scene before and after, by increasing id: three things are gone, two new and
    /// two moved to another place on the floor. Among the gone and the moved is one of several twins each. They are the
    /// same for both visits, whatever the frames, the speed and the noise. Every changed thing covers at least 430 pixels
    /// of 320 × 240 in a twelfth of the frames of a round, and its place is in view of the other visit too. Empty
    /// without [`SyntheticSettings::visit`].
    pub fn changes(&self) -> &[TrueChange] {
        &self.changes
    }

    /// Changes the scene into that of the visit.
    fn apply_changes(&mut self) -> Result<(), DatasetError> {
        let Some(visit) = self.settings.visit else { return Ok(()) };
        let too_few = || DatasetError::Synthetic {
            text: self.name.clone(),
            field: "visit".to_owned(),
            found: visit.name().to_owned(),
            expected: "enough clearly visible things to change: choose more objects or another seed".to_owned(),
        };
        self.changes = change::choose(&self.scenery, &self.intrinsics, self.settings.seed).ok_or_else(too_few)?;
        self.scenery = change::visited(&self.scenery, &self.changes, visit);
        Ok(())
    }

    fn choose_movers(&self) -> Result<Vec<Mover>, DatasetError> {
        let too_many = || DatasetError::Synthetic {
            text: self.name.clone(),
            field: "moving".to_owned(),
            found: self.settings.moving.to_string(),
            expected: format!(
                "at most {}, the number of things on which nothing else stands",
                self.scenery.unloaded_things().count()
            ),
        };
        let pose_at = |frame| self.camera_pose(frame);
        movers::choose(&self.scenery, &self.intrinsics, &self.settings, pose_at).ok_or_else(too_many)
    }

    /// Returns the settings of the scene.
    pub fn settings(&self) -> &SyntheticSettings {
        &self.settings
    }

    fn camera_pose(&self, frame: usize) -> LocalPose {
        match self.settings.camera {
            CameraMotion::Walk => self.scenery.walk.pose(self.settings.speed.time_at(frame)),
            CameraMotion::Static => self.scenery.walk.pose(0.0),
        }
    }

    fn check_index(&self, index: usize) -> Result<(), DatasetError> {
        if index < self.settings.frames {
            return Ok(());
        }
        Err(DatasetError::NoSuchFrame { scene: self.name.clone(), index, count: self.settings.frames })
    }

    /// Casts a ray through the centre of every pixel of a frame, without noise.
    fn cast_rays(&self, frame: usize) -> Image<Sample> {
        let scenery = self.scenery.at(frame, &self.movers);
        Caster { scenery: &scenery, intrinsics: self.intrinsics, pose: self.camera_pose(frame) }.image()
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

    fn read_recorded(&self, index: usize) -> Result<RecordedFrame, DatasetError> {
        self.check_index(index)?;
        let exact = self.cast_rays(index);
        let (width, height) = exact.size();
        let measured: Vec<([u8; 3], f32)> = match self.settings.noise {
            Noise::None => exact.pixels().iter().map(|sample| (color_bytes(sample.color), sample.depth)).collect(),
            Noise::Kinect => kinect_measurements(&exact, self.settings.seed, index),
        };
        let color = Image::from_fn(width, height, |column, row| measured[row * width + column].0);
        let depth = Image::from_fn(width, height, |column, row| measured[row * width + column].1);
        let intrinsics = self.own_camera.map_or(self.intrinsics, |camera| camera.intrinsics(exact.size()));
        let name = self.frame_name(index);
        let world_from_camera = self.camera_pose(index).at(DVec3::ZERO);
        FrameParts { name, timestamp: None, color, depth, intrinsics, world_from_camera: Some(world_from_camera) }
            .into_frame()
    }

    fn world_up(&self) -> Option<DVec3> {
        Some(DVec3::Z)
    }

    fn has_ground_truth(&self) -> bool {
        true
    }

    fn read_ground_truth(&self, index: usize) -> Result<Option<SegmentMap>, DatasetError> {
        self.check_index(index)?;
        Ok(Some(self.cast_rays(index).map(|sample| sample.id)))
    }

    fn format(&self) -> Option<Format> {
        Some(Format::Synthetic)
    }

    fn file_of(&self, index: usize, part: FramePart) -> PathBuf {
        let place = PathBuf::from(format!("{}: frame {}", self.name, self.frame_name(index)));
        if part == FramePart::Intrinsics { camera_place(self.own_camera.as_ref(), &place) } else { place }
    }
}
