//! The integration tests of this crate, in one program: it is linked once.

mod lost_camera;
mod method_preset;
mod names;
mod registered_parts;
