//! Why there is no plan or no route.

use glam::DVec2;
use splatseg_geometry::SegmentId;
use thiserror::Error;

/// Why no plan can be made of a map.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum PlanError {
    /// A setting is out of range.
    #[error("{name}: found {found}, expected {least} to {most}")]
    Setting {
        /// Its name.
        name: &'static str,
        /// Its value.
        found: f64,
        /// The smallest value.
        least: f64,
        /// The largest value.
        most: f64,
    },
    /// The map was saved without keyframes, by a program that had none, or by an early version.
    #[error("the map has no keyframes with depth, so it does not tell where space is free")]
    NoKeyframes,
    /// No keyframe shows a floor.
    #[error("no floor was found: no keyframe shows a horizontal surface of half a square metre below everything else")]
    NoFloor,
    /// The grid would take more than the memory limit.
    #[error("the plan of {width} x {height} cells takes more than the memory limit: choose larger cells")]
    TooLarge {
        /// Cells along x.
        width: usize,
        /// Cells along y.
        height: usize,
    },
}

/// Why there is no route.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum RouteError {
    /// The radius of the robot is out of range.
    #[error("radius: found {0}, expected 0 to 5 m")]
    Radius(f64),
    /// There is no free place for the robot at the start or at the end.
    #[error("({:.2}, {:.2}) m is not free for a radius of {radius} m, nor is a place within {within} m", place.x, place.y)]
    NotFree {
        /// The place, in the plan's coordinates.
        place: DVec2,
        /// Radius of the robot, metres.
        radius: f64,
        /// How far away a free place was looked for, metres.
        within: f64,
    },
    /// The free space of start and end is not connected.
    #[error("no known free way leads from ({:.2}, {:.2}) to ({:.2}, {:.2}) m for a radius of {radius} m", from.x, from.y, to.x, to.y)]
    NoWay {
        /// Start, in the plan's coordinates.
        from: DVec2,
        /// End, in the plan's coordinates.
        to: DVec2,
        /// Radius of the robot, metres.
        radius: f64,
    },
    /// The map has no such object, or it has no place.
    #[error("object {0}: it has no place in the plan")]
    NoObject(SegmentId),
    /// No place near an object is free.
    #[error("object {id}: no free place for a radius of {radius} m within {within} m of it faces it")]
    NoApproach {
        /// The object.
        id: SegmentId,
        /// Radius of the robot, metres.
        radius: f64,
        /// How far from the object places were looked for, metres.
        within: f64,
    },
}
