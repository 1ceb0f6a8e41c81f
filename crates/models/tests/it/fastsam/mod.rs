//! Compares FastSAM with Ultralytics 8.4 (reference data in `../shared/golden`).

mod golden;
mod manifest;
mod network;
mod postprocessing;
mod prediction;
mod preprocessing;
mod rooms;
