//! Pickles in archives that are whole.
#![no_main]

use libfuzzer_sys::fuzz_target;
use splatseg_fuzz::{Place, files, read_checkpoint};
use std::cell::OnceCell;

thread_local!(static PLACE: OnceCell<Place> = const { OnceCell::new() });

fuzz_target!(|pickle: &[u8]| {
    let archive = files::torch_file(pickle);
    let input = [&[0], &archive[..]].concat();
    let template = |folder: &std::path::Path| std::fs::write(folder.join("file.pt"), []).expect("a temporary file");
    Place::with_input(&PLACE, template, &input, |folder| read_checkpoint(&folder.join("file.pt"), input.len()));
});
