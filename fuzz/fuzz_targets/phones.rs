//! Recordings of phones, and nerfstudio's list.
#![no_main]

use libfuzzer_sys::fuzz_target;
use splatseg_fuzz::{Place, read_scene, scenes};
use std::cell::OnceCell;

thread_local!(static PLACE: OnceCell<Place> = const { OnceCell::new() });

fuzz_target!(|input: &[u8]| Place::with_input(&PLACE, scenes::phones, input, |folder| {
    for name in scenes::PHONES {
        read_scene(folder.join(name));
    }
}));
