//! The integration tests of this crate, in one program: it is linked once.

mod affinities;
mod codebook;
mod continuing;
mod correction;
mod depth_completion;
mod joining;
mod own_store;
mod ply;
mod rules;
mod rules_document;
