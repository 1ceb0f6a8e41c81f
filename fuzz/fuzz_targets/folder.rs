//! Plain folders: camera with a lens, poses, images.
#![no_main]

use libfuzzer_sys::fuzz_target;
use splatseg_fuzz::{Place, read_changed_scene, scenes};
use std::cell::OnceCell;

thread_local!(static PLACE: OnceCell<Place> = const { OnceCell::new() });

fuzz_target!(|input: &[u8]| read_changed_scene(&PLACE, scenes::folder, &["tum", "matrices"], input));
