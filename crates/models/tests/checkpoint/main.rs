//! Reading checkpoints: those of others, small ones made here, and hostile ones.

mod files;
mod golden;
mod hostile;
mod mutations;
mod pickler;
mod reading;
