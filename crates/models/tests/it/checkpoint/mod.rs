//! Reading checkpoints: published ones, small ones created here, and hostile ones.

mod files;
mod golden;
mod hostile;
mod mutations;
mod pickler;
mod reading;
