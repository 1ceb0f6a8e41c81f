//! The objects of a video: when each was seen, how large, and how sure its id is.

mod sightings;

pub use sightings::{BoundingBox, ObjectLog, ObjectRecord, ObjectSighting};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
