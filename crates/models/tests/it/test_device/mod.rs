//! The device on which tests run networks: the one named by `SPLATSEG_TEST_DEVICE`, or the CPU.

use burn::tensor::Device;
use splatseg_models::device::{DeviceError, DeviceName};
use splatseg_settings::Choice;
use std::sync::OnceLock;

/// Opens the device. Tests that need reference data are skipped before this call if the device is missing; see
/// [`missing`].
pub fn device() -> Device {
    opened().clone().unwrap()
}

/// Returns the reason if the device cannot be used.
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
