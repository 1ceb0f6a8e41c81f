//! The integration tests of this crate, in one program: it is linked once.

mod id_images;
mod trajectories;
