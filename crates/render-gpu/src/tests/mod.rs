//! Each stage beside what the CPU does.

mod stages;
mod views;

use crate::{GpuDevice, GpuError};
use std::sync::OnceLock;

/// The device of the tests; without one, they say that they are skipped.
fn device() -> Option<GpuDevice> {
    static DEVICE: OnceLock<Result<GpuDevice, GpuError>> = OnceLock::new();
    match DEVICE.get_or_init(GpuDevice::open) {
        Ok(device) => Some(device.clone()),
        Err(error) => {
            // Not `println!`, whose output the test runner hides when a test passes.
            let test = std::thread::current().name().unwrap_or("a test of the GPU").to_owned();
            let line = format!("\nskipped: {test}: {error}\n");
            let _ = std::io::Write::write_all(&mut std::io::stderr(), line.as_bytes());
            None
        }
    }
}

/// Numbers that look random: a linear congruential generator.
fn noise(seed: u32) -> impl Iterator<Item = u32> {
    let mut state = seed.wrapping_mul(747_796_405).wrapping_add(1);
    std::iter::repeat_with(move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        state >> 8
    })
}
