//! What networks run on.

use burn::backend::Flex;
use burn::tensor::{Device, Tensor};
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// A kind of device. The CPU is always there; the others are Cargo features of the same name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DeviceName {
    /// The processor.
    #[default]
    Cpu,
    /// A GPU by NVIDIA.
    Cuda,
    /// Any GPU with a Vulkan driver.
    Vulkan,
    /// A GPU by Apple.
    Metal,
}

/// Why a device cannot be used.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum DeviceError {
    /// The program was built without it.
    #[error("the device {0} is not part of this program: build it with --features {0}")]
    NotBuilt(&'static str),
    /// The driver or the device itself is missing.
    #[error("the device {name} cannot be used: {message}")]
    Unusable {
        /// Its name.
        name: &'static str,
        /// What the driver said.
        message: String,
    },
}

impl DeviceName {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Cpu, Self::Cuda, Self::Vulkan, Self::Metal];

    /// The name on the command line and in settings.
    pub fn name(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::Cuda => "cuda",
            Self::Vulkan => "vulkan",
            Self::Metal => "metal",
        }
    }

    /// The device, tried out.
    ///
    /// # Errors
    /// [`DeviceError`] if the program was built without it, or its driver is missing.
    pub fn open(self) -> Result<Device, DeviceError> {
        match self {
            Self::Cpu => Ok(Device::flex()),
            #[cfg(feature = "cuda")]
            Self::Cuda => tried(self, || Device::cuda(0)),
            #[cfg(feature = "vulkan")]
            Self::Vulkan => tried(self, || Device::vulkan(burn::tensor::DeviceKind::DefaultDevice)),
            #[cfg(feature = "metal")]
            Self::Metal => tried(self, || Device::metal(burn::tensor::DeviceKind::DefaultDevice)),
            #[allow(unreachable_patterns)] // Reached where a feature is off.
            other => Err(DeviceError::NotBuilt(other.name())),
        }
    }
}

/// A device that has added two numbers. Burn starts drivers when they are first used, and panics where there are none.
#[cfg(any(feature = "cuda", feature = "vulkan", feature = "metal"))]
fn tried(name: DeviceName, open: impl FnOnce() -> Device + std::panic::UnwindSafe) -> Result<Device, DeviceError> {
    use burn::tensor::Tensor;
    let hook = std::panic::take_hook();
    // The panic becomes an error with the same text: it need not be told twice.
    std::panic::set_hook(Box::new(|_| {}));
    let outcome = std::panic::catch_unwind(|| {
        let device = open();
        let sum = Tensor::<1>::from_data([1.0, 2.0], &device).sum();
        sum.try_into_data().map(|_| device).map_err(|error| format!("{error:?}"))
    });
    std::panic::set_hook(hook);
    let message = match outcome {
        Ok(Ok(device)) => return Ok(device),
        Ok(Err(message)) => message,
        Err(panic) => {
            let text = panic.downcast_ref::<String>().cloned();
            text.or_else(|| panic.downcast_ref::<&str>().map(|text| (*text).to_owned())).unwrap_or_default()
        }
    };
    // One line, whatever the driver says.
    let message = message.lines().next().filter(|line| !line.is_empty()).unwrap_or("no driver").to_owned();
    Err(DeviceError::Unusable { name: name.name(), message })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_processor_is_always_there_and_missing_devices_are_told() {
        assert!(DeviceName::Cpu.open().is_ok());
        #[cfg(not(feature = "cuda"))]
        assert_eq!(
            DeviceName::Cuda.open().unwrap_err().to_string(),
            "the device cuda is not part of this program: build it with --features cuda"
        );
    }
}

/// Whether tensors on a device are computed on the CPU, by what this crate has of its own.
pub(crate) fn is_cpu(device: &Device) -> bool {
    Tensor::<1>::empty([1], device).try_into_primitive::<Flex>().is_ok()
}
