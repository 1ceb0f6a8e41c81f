//! The integration tests of this crate, in one program: it is linked once.

mod http;
mod protocol;
mod support;
mod tools;
mod writing;
