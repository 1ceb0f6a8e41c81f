//! Scenes of axis-aligned boxes, and exact views of them. Metres; x right, y down, z forward.

use glam::{DVec3, Mat4, Vec3};
use splatseg_geometry::{Image, Intrinsics, Pose, RgbdFrame, SegmentId, SegmentMap};

/// Size of a usual view, pixels.
pub const SIZE: (usize, usize) = (96, 72);

/// Ids of the surfaces common to several scenes.
pub const WALL: SegmentId = 1;
pub const TABLE: SegmentId = 2;

/// A box with an id.
#[derive(Clone, Copy, Debug)]
pub struct Solid {
    pub id: SegmentId,
    pub min: Vec3,
    pub max: Vec3,
}

impl Solid {
    pub fn new(id: SegmentId, center: [f32; 3], size: [f32; 3]) -> Self {
        let (center, half) = (Vec3::from(center), 0.5 * Vec3::from(size));
        Self { id, min: center - half, max: center + half }
    }

    pub fn moved(self, by: Vec3) -> Self {
        Self { min: self.min + by, max: self.max + by, ..self }
    }

    /// True if a point lies in the box or at most `slack` outside it.
    pub fn contains(&self, point: Vec3, slack: f32) -> bool {
        let slack = Vec3::splat(slack);
        point.cmpge(self.min - slack).all() && point.cmple(self.max + slack).all()
    }

    /// Distance at which a ray from outside enters, in units of the length of `direction`.
    fn entry(&self, origin: Vec3, direction: Vec3) -> Option<f32> {
        let (one, other) = ((self.min - origin) / direction, (self.max - origin) / direction);
        let (enter, leave) = (one.min(other).max_element(), one.max(other).min_element());
        (enter > 0.0 && enter <= leave).then_some(enter)
    }
}

/// Boxes without a background.
#[derive(Clone, Debug)]
pub struct Scene(pub Vec<Solid>);

impl Scene {
    /// A wall 3 m in front of the origin and nothing else.
    pub fn wall() -> Self {
        Self(vec![Solid::new(WALL, [0.0, 0.0, 3.25], [40.0, 40.0, 0.5])])
    }

    /// The wall with a table in front that fills the lower part of the view from the origin.
    pub fn table() -> Self {
        Self::wall().with(Solid::new(TABLE, [0.0, 0.85, 2.0], [40.0, 0.5, 2.0]))
    }

    /// The table with two boxes on it, 3 and 4.
    pub fn boxes() -> Self {
        let left = Solid::new(3, [-0.5, 0.3, 2.0], [0.5, 0.6, 0.4]);
        Self::table().with(left).with(Solid::new(4, [0.5, 0.4, 1.8], [0.4, 0.4, 0.4]))
    }

    /// A closed room of 4 by 4 m around the origin, with a box beside each wall. Ids 1 to 10.
    pub fn room() -> Self {
        let mut solids =
            vec![Solid::new(5, [0.0, 1.25, 0.0], [5.0, 0.5, 5.0]), Solid::new(6, [0.0, -1.25, 0.0], [5.0, 0.5, 5.0])];
        for (index, (x, z)) in [(0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0)].into_iter().enumerate() {
            let wall = [0.5 + 4.5 * f32::abs(z), 3.0, 0.5 + 4.5 * f32::abs(x)];
            solids.push(Solid::new(index as u32 + 1, [2.25 * x, 0.0, 2.25 * z], wall));
            solids.push(Solid::new(index as u32 + 7, [1.6 * x, 0.5, 1.6 * z], [0.4, 1.0, 0.4]));
        }
        Self(solids)
    }

    pub fn with(mut self, solid: Solid) -> Self {
        self.0.push(solid);
        self
    }

    pub fn solid(&self, id: SegmentId) -> &Solid {
        self.0.iter().find(|solid| solid.id == id).unwrap()
    }

    pub fn without(mut self, id: SegmentId) -> Self {
        self.0.retain(|solid| solid.id != id);
        self
    }

    /// Renders the view of a camera at the origin.
    pub fn seen_from_origin(&self) -> Shot {
        self.seen_from(Pose::IDENTITY)
    }

    pub fn seen_from(&self, pose: Pose) -> Shot {
        self.seen_at_size(pose, SIZE)
    }

    /// Renders the view of a camera with the usual field of view on `width` × `height` pixels.
    pub fn seen_at_size(&self, pose: Pose, (width, height): (usize, usize)) -> Shot {
        let local = pose.relative_to(DVec3::ZERO);
        let focal = 80.0 * width as f32 / SIZE.0 as f32;
        let (cx, cy) = (0.5 * (width as f32 - 1.0), 0.5 * (height as f32 - 1.0));
        let intrinsics = Intrinsics { fx: focal, fy: focal, cx, cy, width, height };
        let hits = Image::from_fn(width, height, |column, row| {
            let direction = Vec3::new((column as f32 - cx) / focal, (row as f32 - cy) / focal, 1.0);
            let direction = local.rotation() * direction;
            let entry = |solid: &Solid| Some((solid.entry(local.translation(), direction)?, solid.id));
            let nearest = self.0.iter().filter_map(entry).min_by(|one, other| one.0.total_cmp(&other.0));
            nearest.unwrap_or((0.0, 0))
        });
        Shot { depth: hits.map(|hit| hit.0), truth: hits.map(|hit| hit.1), intrinsics, pose }
    }
}

/// A view of a scene, which may be changed before it is learnt.
#[derive(Clone, Debug)]
pub struct Shot {
    pub depth: Image<f32>,
    /// True ids of the pixels.
    pub truth: SegmentMap,
    pub intrinsics: Intrinsics,
    pub pose: Pose,
}

impl Shot {
    pub fn frame(&self) -> RgbdFrame<'static> {
        let color = self.truth.map(|id| [(id * 40) as u8, 100, 200]);
        RgbdFrame::new("0", color, self.depth.clone(), self.intrinsics, self.pose).unwrap()
    }

    pub fn with_pose(self, pose: Pose) -> Self {
        Self { pose, ..self }
    }
}

/// A camera at `position`, turned to the right by `degrees`.
pub fn pose(position: [f32; 3], degrees: f32) -> Pose {
    let turned = Mat4::from_rotation_y(degrees.to_radians());
    Pose::from_matrix((Mat4::from_translation(Vec3::from(position)) * turned).as_dmat4()).unwrap()
}
