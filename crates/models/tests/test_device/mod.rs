//! The device that the networks of tests run on: what `SPLATSEG_TEST_DEVICE` names, or the CPU.

use burn::tensor::Device;
use splatseg_models::device::{DeviceError, DeviceName};
use splatseg_settings::Choice;
use std::sync::OnceLock;

/// The device. Tests that have no reference data do not get here where it is missing, see [`missing`].
pub fn device() -> Device {
    opened().clone().unwrap()
}

/// Why the device cannot be used, if it cannot.
pub fn missing() -> Option<String> {
    opened().as_ref().err().map(ToString::to_string)
}

fn opened() -> &'static Result<Device, DeviceError> {
    static DEVICE: OnceLock<Result<Device, DeviceError>> = OnceLock::new();
    DEVICE.get_or_init(|| match std::env::var("SPLATSEG_TEST_DEVICE") {
        Ok(name) => DeviceName::from_name(&name).expect("SPLATSEG_TEST_DEVICE names a device").open(),
        Err(_) => DeviceName::Cpu.open(),
    })
}
