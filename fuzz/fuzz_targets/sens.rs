//! ScanNet's `.sens`.
#![no_main]

use libfuzzer_sys::fuzz_target;
use splatseg_fuzz::{Place, read_scene, scenes};
use std::cell::OnceCell;

thread_local!(static PLACE: OnceCell<Place> = const { OnceCell::new() });

fuzz_target!(|input: &[u8]| Place::with_input(&PLACE, scenes::sens, input, |folder| {
    for name in ["a/packed.sens", "b/raw.sens", "c/png.sens"] {
        read_scene(folder.join(name));
    }
}));
