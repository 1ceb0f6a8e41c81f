//! Depth in TIFF, NumPy, OpenEXR and PFM files.
#![no_main]

use libfuzzer_sys::fuzz_target;
use splatseg_fuzz::{Place, read_scene, scenes};
use std::cell::OnceCell;

thread_local!(static PLACE: OnceCell<Place> = const { OnceCell::new() });

fuzz_target!(|input: &[u8]| Place::with_input(&PLACE, scenes::depth_files, input, |folder| {
    for name in scenes::DEPTH_FILES {
        read_scene(folder.join(name.split_once('.').map_or(name, |(stem, _)| stem)));
    }
}));
