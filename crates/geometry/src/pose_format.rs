//! How poses are stated by the programs that recorded them.

use crate::Pose;
use glam::{DMat3, DMat4, DQuat, DVec3};

/// Axes of the camera's coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum CameraAxes {
    /// x right, y down, z forward: those of this project, OpenCV, and optical frames in ROS.
    #[default]
    Optical,
    /// x right, y up, z backward: OpenGL, ARKit, Blender and most NeRF programs.
    OpenGl,
    /// x forward, y left, z up: bodies of robots in ROS, and cameras in Gazebo.
    Forward,
    /// x forward, y right, z down: bodies of aircraft.
    ForwardDown,
}

impl CameraAxes {
    /// All axes, the usual ones first.
    pub const ALL: [Self; 4] = [Self::Optical, Self::OpenGl, Self::Forward, Self::ForwardDown];

    /// Rotation from optical axes to these.
    pub fn from_optical(self) -> DMat3 {
        // Columns: where right, down and forward are in these axes.
        match self {
            Self::Optical => DMat3::IDENTITY,
            Self::OpenGl => DMat3::from_cols(DVec3::X, -DVec3::Y, -DVec3::Z),
            Self::Forward => DMat3::from_cols(-DVec3::Y, -DVec3::Z, DVec3::X),
            Self::ForwardDown => DMat3::from_cols(DVec3::Y, DVec3::Z, DVec3::X),
        }
    }
}

/// How poses are stated: what has to be done to them to get [`Pose`]s of this project, camera-to-world with optical axes
/// in metres. The default changes nothing.
///
/// Deviations can be combined. They are undone in the order of the fields.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseFormat {
    /// The rotation was read from a quaternion `x y z w`, but its numbers are in the order `w x y z`.
    pub w_first: bool,
    /// Length of the unit of positions, metres.
    pub scale: f64,
    /// The poses are world-to-camera transforms.
    pub is_inverse: bool,
    /// The axes of the camera whose poses are stated.
    pub axes: CameraAxes,
}

impl Default for PoseFormat {
    fn default() -> Self {
        Self { w_first: false, scale: 1.0, is_inverse: false, axes: CameraAxes::Optical }
    }
}

impl PoseFormat {
    /// True if poses are as in this project.
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }

    /// Name of the combination of [`Self::is_inverse`] and [`Self::axes`], as in the setting `dataset.pose_convention`.
    pub fn convention(&self) -> &'static str {
        match (self.axes, self.is_inverse) {
            (CameraAxes::Optical, false) => "camera-to-world",
            (CameraAxes::Optical, true) => "world-to-camera",
            (CameraAxes::OpenGl, false) => "opengl",
            (CameraAxes::OpenGl, true) => "opengl-world-to-camera",
            (CameraAxes::Forward, false) => "x-forward",
            (CameraAxes::Forward, true) => "x-forward-world-to-camera",
            (CameraAxes::ForwardDown, false) => "x-forward-z-down",
            (CameraAxes::ForwardDown, true) => "x-forward-z-down-world-to-camera",
        }
    }

    /// The pose that a stated one means.
    #[must_use]
    pub fn pose(&self, stated: &Pose) -> Pose {
        if self.is_default() {
            return *stated;
        }
        let rotation = if self.w_first { reordered(stated, |[x, y, z, w]| [y, z, w, x]) } else { stated.rotation() };
        let pose = rigid(rotation, stated.translation() * self.scale);
        let pose = if self.is_inverse { pose.inverse() } else { pose };
        rigid(pose.rotation() * self.axes.from_optical(), pose.translation())
    }

    /// How a pose is stated, the inverse of [`Self::pose`].
    #[must_use]
    pub fn stated(&self, pose: &Pose) -> Pose {
        if self.is_default() {
            return *pose;
        }
        let of_axes = rigid(pose.rotation() * self.axes.from_optical().transpose(), pose.translation());
        let directed = if self.is_inverse { of_axes.inverse() } else { of_axes };
        let scaled = rigid(directed.rotation(), directed.translation() / self.scale);
        let rotation = if self.w_first { reordered(&scaled, |[x, y, z, w]| [w, x, y, z]) } else { scaled.rotation() };
        rigid(rotation, scaled.translation())
    }
}

/// The rotation of a pose, with the numbers of its quaternion in another order. The quaternion's sign does not matter.
fn reordered(pose: &Pose, order: impl Fn([f64; 4]) -> [f64; 4]) -> DMat3 {
    let quaternion = DQuat::from_mat3(&pose.rotation()).to_array();
    DMat3::from_quat(DQuat::from_array(order(quaternion)).normalize())
}

/// A pose from a rotation that is known to be valid. A scale can move a position out of range; then it is as far away as
/// a pose can be, which readers refuse.
fn rigid(rotation: DMat3, translation: DVec3) -> Pose {
    let farthest = DVec3::splat(Pose::MAX_DISTANCE);
    let translation = translation.clamp(-farthest, farthest);
    Pose::from_matrix(DMat4::from_mat3_translation(rotation, translation)).unwrap_or(Pose::IDENTITY)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::EulerRot;

    fn pose() -> Pose {
        let turn = DQuat::from_euler(EulerRot::XYZ, 0.4, -1.2, 2.0);
        Pose::from_quaternion(DVec3::new(1.0, -2.0, 3.0), turn).unwrap()
    }

    fn all() -> impl Iterator<Item = PoseFormat> {
        CameraAxes::ALL.into_iter().flat_map(|axes| {
            [(false, false), (false, true), (true, false), (true, true)].into_iter().flat_map(
                move |(w_first, is_inverse)| [1.0, 0.01].map(|scale| PoseFormat { w_first, scale, is_inverse, axes }),
            )
        })
    }

    #[test]
    fn every_format_is_read_as_it_is_stated() {
        for format in all() {
            let again = format.pose(&format.stated(&pose()));
            assert!(again.to_matrix().abs_diff_eq(pose().to_matrix(), 1e-12), "{format:?}");
        }
        assert_eq!(PoseFormat::default().pose(&pose()), pose());
    }

    #[test]
    fn axes_are_where_programs_have_them() {
        // A camera at the origin that looks along the world's x axis, with z up.
        let upright = DMat3::from_cols(-DVec3::Y, -DVec3::Z, DVec3::X);
        let camera = rigid(upright, DVec3::ZERO);
        let stated = |axes| PoseFormat { axes, ..PoseFormat::default() }.stated(&camera).rotation();
        assert!(stated(CameraAxes::Forward).abs_diff_eq(DMat3::IDENTITY, 1e-12), "a robot's body");
        let up_in_world = stated(CameraAxes::OpenGl) * DVec3::Y;
        assert!(up_in_world.abs_diff_eq(DVec3::Z, 1e-12), "y is up");
        assert!((stated(CameraAxes::ForwardDown) * DVec3::Z).abs_diff_eq(-DVec3::Z, 1e-12), "z is down");
    }

    #[test]
    fn a_quaternion_with_w_first_is_read_as_such() {
        let turn = DQuat::from_rotation_x(0.3);
        let [x, y, z, w] = turn.to_array();
        let misread = Pose::from_quaternion(DVec3::ZERO, DQuat::from_array([w, x, y, z])).unwrap();
        let format = PoseFormat { w_first: true, ..PoseFormat::default() };
        assert!(format.pose(&misread).rotation().abs_diff_eq(DMat3::from_quat(turn), 1e-12));
    }

    #[test]
    fn centimetres_are_metres_after_the_scale() {
        let format = PoseFormat { scale: 0.01, ..PoseFormat::default() };
        let metres = format.pose(&Pose::from_translation(DVec3::new(120.0, 0.0, -30.0)));
        assert!(metres.translation().abs_diff_eq(DVec3::new(1.2, 0.0, -0.3), 1e-12));
    }

    #[test]
    fn a_position_out_of_range_stays_far_away() {
        let format = PoseFormat { scale: 1e300, ..PoseFormat::default() };
        assert_eq!(format.pose(&pose()).translation().abs(), DVec3::splat(Pose::MAX_DISTANCE));
    }
}
