//! PyTorch checkpoints, as files.
#![no_main]

use libfuzzer_sys::fuzz_target;
use splatseg_fuzz::{Place, files, read_checkpoint};
use std::cell::OnceCell;
use std::path::Path;

thread_local!(static PLACE: OnceCell<Place> = const { OnceCell::new() });

fn template(folder: &Path) {
    std::fs::write(folder.join("file.pt"), files::torch_file(&files::module_pickle())).expect("a temporary file");
}

fuzz_target!(|input: &[u8]| Place::with_input(&PLACE, template, input, |folder| {
    read_checkpoint(&folder.join("file.pt"), input.len());
}));
