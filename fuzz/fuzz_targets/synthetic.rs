//! Descriptions of synthetic scenes.
#![no_main]

use libfuzzer_sys::fuzz_target;
use splatseg_dataset::{SyntheticScene, SyntheticSettings};
use splatseg_fuzz as _; // its limit on memory

fuzz_target!(|text: &str| {
    if let Ok(settings) = text.parse::<SyntheticSettings>() {
        let _ = SyntheticScene::new(settings);
    }
});
