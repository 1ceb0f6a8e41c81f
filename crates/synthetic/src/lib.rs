//! Furnished rooms, tours of several rooms, and corridors, ray-cast on demand, with exact depth, poses and instance ids.
//!
//! A [`SyntheticScene`] is arranged by its [`SyntheticSettings`], which can be written as one text:
//!
//! ```
//! use splatseg_synthetic::SyntheticScene;
//! let scene = SyntheticScene::new("synthetic:frames=4,width=64,height=48".parse()?)?;
//! let (color, depth) = scene.images(0);
//! assert_eq!((color.size(), depth.size()), ((64, 48), (64, 48)));
//! assert!(scene.segments(0).areas().len() > 6);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod change;
mod corridor;
mod error;
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
pub use error::SyntheticError;
pub use layout::Layout;
pub use motion::{Motion, Mover};
pub use noise::Noise;
pub use settings::{CameraMotion, SyntheticSettings};
pub use speed::{Speed, SpeedError};
pub use thing::{Thing, ThingKind};

use glam::DVec3;
use noise::{Sample, color_bytes, kinect_measurements};
use rays::Caster;
use scenery::Scenery;
use splatseg_geometry::{Image, Intrinsics, LocalPose, Pose, SegmentId, SegmentMap};

/// Focal length in image widths, for a Kinect's field of view of 58 degrees.
const FOCAL_WIDTHS: f32 = 0.9;

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
    stated_intrinsics: Option<Intrinsics>,
}

impl SyntheticScene {
    /// Memory for rendering a frame, bytes per pixel: two copies of the ray samples, and the frame.
    pub const RENDERING_BYTES_PER_PIXEL: u64 = 2 * size_of::<Sample>() as u64 + 16;

    /// Furnishes the room.
    ///
    /// # Errors
    /// [`SyntheticError`] names a setting that is out of range, including more moving things than there are things on
    /// which nothing else stands.
    pub fn new(settings: SyntheticSettings) -> Result<Self, SyntheticError> {
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
        let SyntheticSettings { seed, objects, layout, .. } = settings;
        let scenery = match layout {
            Layout::Room => room::furnished(seed, objects, settings.visit.map_or(0, |_| objects / 5)),
            Layout::Tour(rooms) => tour::furnished(seed, rooms, objects),
            Layout::Corridor(doors) => corridor::furnished(seed, doors),
        };
        let (name, movers) = (settings.to_string(), Vec::new());
        let changes = Vec::new();
        let mut scene = Self { name, settings, scenery, movers, changes, intrinsics, stated_intrinsics: None };
        scene.apply_changes()?;
        scene.movers = scene.choose_movers()?;
        Ok(scene)
    }

    /// Changes the stated intrinsics, not those that frames are rendered with.
    #[must_use]
    pub fn with_stated_intrinsics(self, intrinsics: Intrinsics) -> Self {
        Self { stated_intrinsics: Some(intrinsics), ..self }
    }

    /// Returns the settings as text.
    pub fn name(&self) -> &str {
        &self.name
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
    fn apply_changes(&mut self) -> Result<(), SyntheticError> {
        let Some(visit) = self.settings.visit else { return Ok(()) };
        let too_few = || SyntheticError {
            text: self.name.clone(),
            field: "visit".to_owned(),
            found: visit.name().to_owned(),
            expected: "enough clearly visible things to change: choose more objects or another seed".to_owned(),
        };
        self.changes = change::choose(&self.scenery, &self.intrinsics, self.settings.seed).ok_or_else(too_few)?;
        self.scenery = change::visited(&self.scenery, &self.changes, visit);
        Ok(())
    }

    fn choose_movers(&self) -> Result<Vec<Mover>, SyntheticError> {
        let too_many = || SyntheticError {
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

    /// Returns the intrinsics that every frame is rendered with.
    pub fn intrinsics(&self) -> Intrinsics {
        self.intrinsics
    }

    /// Returns the intrinsics that are stated instead; see [`Self::with_stated_intrinsics`].
    pub fn stated_intrinsics(&self) -> Option<Intrinsics> {
        self.stated_intrinsics
    }

    /// Returns the camera's pose, camera to world, in a frame.
    pub fn pose(&self, frame: usize) -> Pose {
        self.camera_pose(frame).at(DVec3::ZERO)
    }

    /// Renders a frame: its colours, and its depth in metres, 0 where none is measured. The last frame of the settings is
    /// not a limit.
    pub fn images(&self, frame: usize) -> (Image<[u8; 3]>, Image<f32>) {
        let exact = self.cast_rays(frame);
        let (width, height) = exact.size();
        let measured: Vec<([u8; 3], f32)> = match self.settings.noise {
            Noise::None => exact.pixels().iter().map(|sample| (color_bytes(sample.color), sample.depth)).collect(),
            Noise::Kinect => kinect_measurements(&exact, self.settings.seed, frame),
        };
        let color = Image::from_fn(width, height, |column, row| measured[row * width + column].0);
        let depth = Image::from_fn(width, height, |column, row| measured[row * width + column].1);
        (color, depth)
    }

    /// Renders the true instance ids of a frame.
    pub fn segments(&self, frame: usize) -> SegmentMap {
        self.cast_rays(frame).map(|sample| sample.id)
    }

    fn camera_pose(&self, frame: usize) -> LocalPose {
        match self.settings.camera {
            CameraMotion::Walk => self.scenery.walk.pose(self.settings.speed.time_at(frame)),
            CameraMotion::Static => self.scenery.walk.pose(0.0),
        }
    }

    /// Casts a ray through the centre of every pixel of a frame, without noise.
    fn cast_rays(&self, frame: usize) -> Image<Sample> {
        let scenery = self.scenery.at(frame, &self.movers);
        Caster { scenery: &scenery, intrinsics: self.intrinsics, pose: self.camera_pose(frame) }.image()
    }
}
