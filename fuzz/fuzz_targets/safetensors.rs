//! `.safetensors` files.
#![no_main]

use libfuzzer_sys::fuzz_target;
use splatseg_fuzz::{Place, read_checkpoint};
use std::cell::OnceCell;
use std::path::Path;

thread_local!(static PLACE: OnceCell<Place> = const { OnceCell::new() });

fn template(folder: &Path) {
    std::fs::write(folder.join("file.safetensors"), []).expect("a temporary file");
}

fuzz_target!(|bytes: &[u8]| {
    let input = [&[0], bytes].concat();
    Place::with_input(&PLACE, template, &input, |folder| {
        read_checkpoint(&folder.join("file.safetensors"), input.len());
    });
});
