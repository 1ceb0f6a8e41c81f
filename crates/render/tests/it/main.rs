//! The integration tests of this crate, in one program: it is linked once.

mod brute_force;
mod chosen_pixels;
mod golden;
mod limits;
mod properties;
