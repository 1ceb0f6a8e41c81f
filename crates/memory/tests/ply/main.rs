//! Memories to files and back, and files that are none.

mod damage;
mod export;
mod layout;
mod round_trips;
mod sample;
mod values;
