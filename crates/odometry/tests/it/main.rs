//! The integration tests of this crate, in one program: it is linked once.

mod corrected_path;
mod input_checks;
mod loops;
mod movers;
mod old_map;
mod places;
mod places_again;
mod poses;
mod relocaliser;
mod scene;
mod synthetic;
