//! Compares the places of frames with their true ones.

use serde::Serialize;
use splatseg::odometry::Relocaliser;
use splatseg_geometry::Pose;

/// A frame is in the first group with a keyframe within this distance of its true pose: metres and degrees.
const NEARBY: [(f64, f64); 2] = [(0.3, 20.0), (0.5, 30.0)];

/// A pose is right if it differs from the true one by at most this, metres and degrees.
const RIGHT: (f64, f64) = (0.05, 5.0);

/// Counts of the frames that the map was seen from about equally near to. Its keys are part of the interface.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Group {
    /// A keyframe is within this distance of the true pose, metres; null in the group of all other frames.
    within_m: Option<f64>,
    /// It is turned by at most this, degrees.
    within_deg: Option<f64>,
    frames: usize,
    found: usize,
    /// Found within 5 cm and 5 degrees of the true pose.
    right: usize,
    /// Found elsewhere.
    wrong: usize,
}

/// Difference of a pose from the true one.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct PoseError {
    distance_m: f64,
    angle_deg: f64,
}

/// The frames by how near the map was seen from.
#[derive(Clone, Debug)]
pub struct Comparison {
    groups: [Group; NEARBY.len() + 1],
}

impl Default for Comparison {
    fn default() -> Self {
        let group = |index: usize| {
            let nearby = NEARBY.get(index);
            Group { within_m: nearby.map(|it| it.0), within_deg: nearby.map(|it| it.1), ..Group::default() }
        };
        Self { groups: std::array::from_fn(group) }
    }
}

impl Comparison {
    /// Adds a frame. Returns the error of its pose if it was found.
    pub fn add(&mut self, map: &Relocaliser, truth: &Pose, found: Option<&Pose>) -> Option<PoseError> {
        let group = NEARBY.iter().position(|(metres, degrees)| map.has_keyframe_within(truth, *metres, *degrees));
        let group = &mut self.groups[group.unwrap_or(NEARBY.len())];
        group.frames += 1;
        let error = PoseError::between(truth, found?);
        let is_right = error.distance_m <= RIGHT.0 && error.angle_deg <= RIGHT.1;
        group.found += 1;
        group.right += usize::from(is_right);
        group.wrong += usize::from(!is_right);
        Some(error)
    }

    /// The counts as a table.
    pub fn lines(&self) -> Vec<String> {
        let mut lines = vec![format!("{:<30}{:>8}{:>8}{:>8}{:>8}", "keyframe", "frames", "found", "right", "wrong")];
        lines.extend(self.groups.iter().map(|group| {
            let Group { frames, found, right, wrong, .. } = group;
            let name = match (group.within_m, group.within_deg) {
                (Some(metres), Some(degrees)) => format!("within {:.0} cm and {degrees:.0}°", 100.0 * metres),
                _ => "farther away".to_owned(),
            };
            format!("{name:<30}{frames:>8}{found:>8}{right:>8}{wrong:>8}")
        }));
        lines.push(format!("right: within {:.0} cm and {:.0}° of the scene's pose", 100.0 * RIGHT.0, RIGHT.1));
        lines
    }

    /// The groups, the nearest first.
    pub fn into_groups(self) -> Vec<Group> {
        self.groups.to_vec()
    }
}

impl PoseError {
    fn between(truth: &Pose, found: &Pose) -> Self {
        let difference = truth.inverse() * *found;
        let turn = glam::DQuat::from_mat3(&difference.rotation());
        // Unlike the arc cosine, the arc tangent is accurate for small angles.
        let angle_deg = (2.0 * turn.xyz().length().atan2(turn.w.abs())).to_degrees();
        Self { distance_m: difference.translation().length(), angle_deg }
    }
}
