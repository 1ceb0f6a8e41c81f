//! Free space, routes and rooms of a saved map, from the depth of its keyframes.
//!
//! [`FloorPlan`] is the entry: it finds the floor, tells which cells are free, and answers for routes and rooms.

mod approach;
mod clearance;
mod columns;
mod depth_points;
mod error;
mod floor;
mod floor_heights;
mod floor_plan;
mod floor_seen;
mod footprints;
mod free_path;
mod grid;
mod known_rooms;
pub mod map_server;
mod occupancy;
mod outline;
mod picture;
mod plan_file;
mod plan_frame;
mod room_kinds;
mod room_naming;
mod rooms;
mod route;
mod settings;

pub use approach::ApproachPoint;
pub use error::{PlanError, RouteError};
pub use floor_plan::FloorPlan;
pub use footprints::Footprint;
pub use grid::{Cell, GridShape, OccupancyGrid};
pub use known_rooms::KnownRooms;
pub use picture::PlanPicture;
pub use plan_file::{Areas, FrameData, PlanFile, PlannedObject};
pub use plan_frame::PlanFrame;
pub use rooms::{Door, Room};
pub use route::Route;
pub use settings::PlanSettings;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
