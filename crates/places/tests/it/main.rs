//! The integration tests of this crate, in one program: it is linked once.

mod no_floor;
mod ramp;
mod room_names;
mod seen_tour;
mod tour;
