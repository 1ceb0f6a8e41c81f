//! The integration tests of this crate, in one program: it is linked once.

mod affinity;
mod crops;
mod graph;
mod masks;
