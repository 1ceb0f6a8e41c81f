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
            println!("skipped: {error}");
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
