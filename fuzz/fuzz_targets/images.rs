//! Colour images and id images.
#![no_main]

use libfuzzer_sys::fuzz_target;
use splatseg_dataset::{read_color_image, read_segments_png};
use splatseg_fuzz::{Place, scenes};
use std::cell::OnceCell;

thread_local!(static PLACE: OnceCell<Place> = const { OnceCell::new() });

fuzz_target!(|input: &[u8]| Place::with_input(&PLACE, scenes::images, input, |folder| {
    for name in ["labels.png", "panoptic.png", "depth.png", "color.png", "color.jpg"] {
        let path = folder.join(name);
        let _ = read_color_image(&path);
        let _ = read_segments_png(&path);
    }
}));
