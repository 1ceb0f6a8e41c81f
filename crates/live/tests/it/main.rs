//! The integration tests of this crate, in one program: it is linked once.

mod lag;
mod messages;
mod session;
mod support;
