//! The coordinates of a plan: x and y along the floor, z up.

use crate::floor::Floor;
use glam::{DMat3, DMat4, DQuat, DVec2, DVec3};
use splatseg_geometry::{Pose, PoseError};

/// Where a plan lies in the world. If z points up in the world, both have the same coordinates. Otherwise the world is
/// turned by the smallest rotation that makes up z, and moved along z so that the floor is at 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlanFrame {
    plan_from_world: Pose,
    floor_height: f64,
}

impl PlanFrame {
    pub(crate) fn of_floor(floor: &Floor) -> Result<Self, PoseError> {
        let up = floor.up;
        if up == DVec3::Z {
            return Ok(Self { plan_from_world: Pose::IDENTITY, floor_height: floor.height });
        }
        let rotation = DMat3::from_quat(DQuat::from_rotation_arc(up, DVec3::Z));
        let matrix = DMat4::from_mat3_translation(rotation, DVec3::Z * -floor.height);
        Ok(Self { plan_from_world: Pose::from_matrix(matrix)?, floor_height: 0.0 })
    }

    /// The transform from world coordinates to the plan's.
    pub fn plan_from_world(&self) -> Pose {
        self.plan_from_world
    }

    /// z of the floor in the plan's coordinates, metres. Single rooms may have others: see `floor_heights`.
    pub fn floor_height(&self) -> f64 {
        self.floor_height
    }

    /// True if the plan has the world's coordinates.
    pub fn is_world(&self) -> bool {
        self.plan_from_world == Pose::IDENTITY
    }

    /// The place of a point of the world, metres, on the plan.
    pub fn to_plan(&self, point_world: DVec3) -> DVec2 {
        let [x, y, _] = self.point_to_plan(point_world).to_array();
        DVec2::new(x, y)
    }

    /// A point of the world, metres, in the plan's coordinates.
    pub fn point_to_plan(&self, point_world: DVec3) -> DVec3 {
        self.plan_from_world.rotation() * point_world + self.plan_from_world.translation()
    }

    /// A place on the floor, in world coordinates, metres.
    pub fn to_world(&self, place: DVec2) -> DVec3 {
        let world_from_plan = self.plan_from_world.inverse();
        world_from_plan.rotation() * place.extend(self.floor_height) + world_from_plan.translation()
    }
}
