//! The integration tests of this crate, in one program: it is linked once.

mod corrections;
mod images;
mod page;
mod without_depth;
