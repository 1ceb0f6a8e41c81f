//! Saving and loading of memories, and invalid files.

mod damage;
mod export;
mod layout;
mod round_trips;
mod sample;
mod values;
