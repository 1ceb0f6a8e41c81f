//! The integration tests of this crate, in one program: it is linked once.

mod endless_wall;
mod exact_masks;
mod fastsam;
mod fastsam_splat;
mod fastspam;
mod late_things;
mod many_things;
mod moving_things;
mod replaced_things;
mod reprompting;
mod sam2_tracker;
mod taken_away;
mod track_errors;
mod watched;
