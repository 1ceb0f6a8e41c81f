//! The plan of a map as ROS 2 messages.

use super::PLAN;
use super::frame_messages::number;
use glam::DQuat;
use splatseg_places::FloorPlan;
use splatseg_ros::{
    Header, MapMetaData, OccupancyGrid, Point, PoseMessage, Quaternion, TfMessage, Time, Transform, TransformStamped,
    Vector3,
};
use std::io;

/// The grid of a plan as Nav2 reads it, in a frame with z up: `world` if z points up there, else [`PLAN`], for which
/// [`plan_transform`] has the message. The height of its origin is that of the floor.
///
/// # Errors
/// If a size does not fit into 32 bits.
pub fn occupancy_grid(stamp: Time, plan: &FloorPlan, world: &str) -> io::Result<OccupancyGrid> {
    let frame_id = if plan.frame().is_world() { world } else { PLAN }.to_owned();
    let shape = &plan.grid().shape;
    let position = Point { x: shape.origin.x, y: shape.origin.y, z: plan.frame().floor_height() };
    let orientation = Quaternion { w: 1.0, ..Quaternion::default() };
    let info = MapMetaData {
        map_load_time: stamp,
        resolution: shape.resolution as f32,
        width: number(shape.width)?,
        height: number(shape.height)?,
        origin: PoseMessage { position, orientation },
    };
    Ok(OccupancyGrid { header: Header { stamp, frame_id }, info, data: plan.grid().ros_values() })
}

/// The static transform of the frame [`PLAN`] in `world`; `None` if the grid is in the world's frame itself.
pub fn plan_transform(stamp: Time, plan: &FloorPlan, world: &str) -> Option<TfMessage> {
    if plan.frame().is_world() {
        return None;
    }
    let world_from_plan = plan.frame().plan_from_world().inverse();
    let turn = DQuat::from_mat3(&world_from_plan.rotation()).normalize();
    let [x, y, z] = world_from_plan.translation().to_array();
    let transform = Transform {
        translation: Vector3 { x, y, z },
        rotation: Quaternion { x: turn.x, y: turn.y, z: turn.z, w: turn.w },
    };
    let header = Header { stamp, frame_id: world.to_owned() };
    Some(TfMessage { transforms: vec![TransformStamped { header, child_frame_id: PLAN.to_owned(), transform }] })
}
