//! What networks run on.

use burn::backend::Flex;
use burn::tensor::{Device, Tensor};
use splatseg_settings::choices;
use thiserror::Error;

choices! {
    /// A kind of device. The CPU is always there; the others are Cargo features of the same name.
    pub enum DeviceName, default Cpu {
        /// The processor.
        Cpu = "cpu",
        /// Any GPU, through wgpu: Vulkan, Metal or DirectX 12, whichever its driver has. Shaders are WGSL.
        Gpu = "gpu",
        /// A GPU by NVIDIA.
        Cuda = "cuda",
        /// Any GPU with a Vulkan driver. Shaders are SPIR-V, which can be faster.
        Vulkan = "vulkan",
        /// A GPU by Apple.
        Metal = "metal",
    }
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
    /// Whether the program was built with support for the device. Its driver may still be missing.
    pub fn is_built(self) -> bool {
        match self {
            Self::Cpu => true,
            Self::Gpu => cfg!(feature = "gpu"),
            Self::Cuda => cfg!(feature = "cuda"),
            Self::Vulkan => cfg!(feature = "vulkan"),
            Self::Metal => cfg!(feature = "metal"),
        }
    }

    /// The device, tried out.
    ///
    /// # Errors
    /// [`DeviceError`] if the program was built without it, or its driver is missing.
    pub fn open(self) -> Result<Device, DeviceError> {
        match self {
            Self::Cpu => Ok(Device::flex()),
            #[cfg(feature = "gpu")]
            Self::Gpu => tried(self, || Device::wgpu(burn::tensor::DeviceKind::DefaultDevice)),
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

/// A device that has added two numbers: burn starts drivers when they are first used.
#[cfg(any(feature = "gpu", feature = "cuda", feature = "vulkan", feature = "metal"))]
fn tried(name: DeviceName, open: impl FnOnce() -> Device) -> Result<Device, DeviceError> {
    use burn::tensor::Tensor;
    let outcome = panics_told(|| {
        let device = open();
        let sum = Tensor::<1>::from_data([1.0, 2.0], &device).sum();
        sum.try_into_data().map(|_| device).map_err(|error| format!("{error:?}"))
    });
    outcome.map_err(|message| {
        // One line, whatever the driver says.
        let message = message.lines().next().filter(|line| !line.is_empty()).unwrap_or("no driver").to_owned();
        DeviceError::Unusable { name: name.name(), message }
    })
}

/// What `work` returns, or the message of the first panic of any thread while it runs, which is not printed. Without a
/// driver a thread of burn's panics, and then the one that waits for it, without a reason.
#[cfg(any(test, feature = "gpu", feature = "cuda", feature = "vulkan", feature = "metal"))]
fn panics_told<T>(work: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
    use std::sync::{Arc, Mutex, PoisonError};
    let first = Arc::new(Mutex::new(None));
    let seen = Arc::clone(&first);
    let hook = take_hook();
    set_hook(Box::new(move |panic| {
        let message = panic.payload_as_str().unwrap_or_default().to_owned();
        seen.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(message);
    }));
    let outcome = catch_unwind(AssertUnwindSafe(work));
    set_hook(hook);
    outcome.unwrap_or_else(|_| Err(first.lock().unwrap_or_else(PoisonError::into_inner).take().unwrap_or_default()))
}

/// Whether tensors on a device are computed on the CPU, by what this crate has of its own.
pub(crate) fn is_cpu(device: &Device) -> bool {
    Tensor::<1>::empty([1], device).try_into_primitive::<Flex>().is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_processor_is_always_there_and_missing_devices_are_told() {
        assert!(DeviceName::Cpu.is_built() && DeviceName::Cpu.open().is_ok());
        assert_eq!(DeviceName::Cuda.is_built(), cfg!(feature = "cuda"));
        #[cfg(not(feature = "cuda"))]
        assert_eq!(
            DeviceName::Cuda.open().unwrap_err().to_string(),
            "the device cuda is not part of this program: build it with --features cuda"
        );
    }

    #[test]
    fn of_several_panics_the_first_is_told() {
        let waiting: Result<(), String> = panics_told(|| {
            let service = std::thread::spawn(|| panic!("no adapter"));
            service.join().unwrap();
            Ok(())
        });
        assert_eq!(waiting, Err("no adapter".to_owned()));
        assert_eq!(panics_told(|| Ok(3)), Ok(3));
    }
}
