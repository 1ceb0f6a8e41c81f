//! The integration tests of this crate, in one program: it is linked once.

mod checkpoint;
mod clip;
mod completeness;
mod depth_anything;
mod edgetam;
mod efficienttam;
mod fastsam;
mod formula_video;
mod sam2;
mod sam2_formula;
mod sam2_full;
mod sam2_golden;
mod sam2_resting;
