//! Frames, scenes and files that the tests of several crates share. Everything here panics where a test should fail.
//!
//! - [`camera`], [`grey_frame`] and [`wall`]: frames of one colour.
//! - [`room`], [`truth`] and [`recording`]: the synthetic room.
//! - [`demo_clip`] and [`copy_demo_clip`]: the clip of `splatseg demo`, a scene on disk.
//! - [`file_names`] and [`file_contents`]: what a test has written.
//! - [`true_cells`], [`ExactPlan`] and [`PlanErrors`]: the exact free space of a synthetic scene, or of a rendered room with
//!   its [`TrueSurfaces`].
//! - [`without_chunks`]: an MCAP file without its chunks.
//! - [`shared`], [`shared_folder`] and [`skipped`]: data that not everybody has, and tests that are skipped without.
//!
//! Only integration tests, examples and benchmarks may use this crate. It depends on `splatseg-dataset`; in that crate's
//! unit tests, as in those of the crates below it, the types would be others.

mod demo_clip;
mod files;
mod grey_frames;
mod mcap_files;
mod rooms;
mod shared_data;
mod true_plan;
mod true_surfaces;

pub use demo_clip::{copy_demo_clip, demo_clip};
pub use files::{file_contents, file_names};
pub use grey_frames::{camera, grey_frame, wall};
pub use mcap_files::without_chunks;
pub use rooms::{recording, room, truth};
pub use shared_data::{shared, shared_folder, skipped};
pub use true_plan::{ExactPlan, PlanErrors, TrueCell, true_cells};
pub use true_surfaces::TrueSurfaces;
