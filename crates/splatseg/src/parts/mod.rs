//! The parts that settings can choose: methods, segmenters and trackers. Each file has the names, the settings and the
//! construction of its kind, so that a new part is added in one place.

pub(crate) mod methods;
pub(crate) mod segmenters;
pub(crate) mod trackers;

pub use methods::{MethodName, MethodSettings};
pub use segmenters::{SegmenterName, SegmenterSettings};
pub use trackers::{TrackerName, TrackerSettings};
