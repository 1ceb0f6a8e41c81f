//! The integration tests of this crate, in one program: it is linked once.

mod by_size;
mod golden;
mod instances;
mod properties;
mod reference;
mod rules;
mod single_frames;
mod trajectories;
mod videos;
