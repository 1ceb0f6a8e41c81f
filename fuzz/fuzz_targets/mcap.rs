//! Recordings of ROS 2 messages in MCAP files.
#![no_main]

use libfuzzer_sys::fuzz_target;
use splatseg_fuzz::{Place, read_scene, scenes};
use std::cell::OnceCell;

thread_local!(static PLACE: OnceCell<Place> = const { OnceCell::new() });

fuzz_target!(|input: &[u8]| Place::with_input(&PLACE, scenes::mcap, input, |folder| {
    read_scene(folder);
}));
