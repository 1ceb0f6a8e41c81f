//! Settings: TOML files, and `KEY=VALUE`.
#![no_main]

use libfuzzer_sys::fuzz_target;
use splatseg::settings::SettingsLayers;
use splatseg_fuzz::Place;
use std::cell::OnceCell;
use std::path::Path;

thread_local!(static PLACE: OnceCell<Place> = const { OnceCell::new() });

fn template(folder: &Path) {
    std::fs::write(folder.join("settings.toml"), []).expect("a temporary file");
}

fuzz_target!(|text: &str| {
    let input = [&[0], text.as_bytes()].concat();
    Place::with_input(&PLACE, template, &input, |folder| {
        let mut layers = SettingsLayers::default();
        if layers.add_file(&folder.join("settings.toml")).is_ok() {
            let _ = layers.resolve();
        }
        let mut layers = SettingsLayers::default();
        if layers.add_assignment(text).is_ok() {
            let _ = layers.resolve();
        }
    });
});
