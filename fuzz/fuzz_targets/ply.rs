//! Saved memories.
#![no_main]

use libfuzzer_sys::fuzz_target;
use splatseg_fuzz::{Place, sample};
use splatseg_memory::{MemoryKind, SplatFile};
use std::cell::OnceCell;
use std::path::Path;

thread_local!(static PLACE: OnceCell<Place> = const { OnceCell::new() });

fn template(folder: &Path) {
    for (name, kind) in [("a.ply", MemoryKind::Evidence), ("b.ply", MemoryKind::Features)] {
        std::fs::write(folder.join(name), sample::saved(&sample::sample(kind, 3))).expect("a temporary file");
    }
}

fuzz_target!(|input: &[u8]| {
    // The second half of the choices has its checksum made right, or hardly any mutant would get past it.
    let repaired = match input {
        [choice, bytes @ ..] if *choice >= 128 && bytes.len() > 4 => {
            [&[*choice], &sample::with_checksum(bytes.to_vec())[..]].concat()
        }
        _ => input.to_vec(),
    };
    Place::with_input(&PLACE, template, &repaired, |folder| {
        for name in ["a.ply", "b.ply"] {
            let _ = SplatFile::load(folder.join(name));
        }
    });
});
