//! The kernels: each file is one stage, named as its counterpart on the CPU.

// A launch takes its buffers one by one, and the macro makes a public module of every kernel.
#![allow(missing_docs, clippy::too_many_arguments)]

pub(crate) mod active;
pub(crate) mod bin;
pub(crate) mod blend;
pub(crate) mod borders;
pub(crate) mod camera;
pub(crate) mod decode;
pub(crate) mod descend;
pub(crate) mod entries;
pub(crate) mod exp;
pub(crate) mod expect;
pub(crate) mod forget;
pub(crate) mod fuse;
pub(crate) mod grow;
pub(crate) mod project;
pub(crate) mod scan;
pub(crate) mod sight;
pub(crate) mod sort;
pub(crate) mod tile;
pub(crate) mod vote;
