//! Depth in TIFF, NumPy, OpenEXR and PFM files.
#![no_main]

use libfuzzer_sys::fuzz_target;
use splatseg_fuzz::{Place, read_changed_scene, scenes};
use std::cell::OnceCell;

thread_local!(static PLACE: OnceCell<Place> = const { OnceCell::new() });

fuzz_target!(|input: &[u8]| {
    let stem = |name: &'static str| name.split_once('.').map_or(name, |(stem, _)| stem);
    read_changed_scene(&PLACE, scenes::depth_files, &scenes::DEPTH_FILES.map(stem), input);
});
