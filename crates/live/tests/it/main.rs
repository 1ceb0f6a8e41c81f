//! The integration tests of this crate, in one program: it is linked once.

#[cfg(unix)]
mod full_disk;
mod lag;
mod messages;
mod session;
mod support;
