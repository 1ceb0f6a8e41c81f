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
        /// Any GPU, through wgpu: Vulkan, Metal or DirectX 12, whichever its driver has.
        Gpu = "gpu",
        /// A GPU by NVIDIA.
        Cuda = "cuda",
        /// Any GPU with a Vulkan driver, with shaders in SPIR-V.
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
    /// No device of the kind has a driver.
    #[error("the device {0} cannot be used: no adapter was found, is its driver installed? See docs/GPU.md")]
    NoAdapter(&'static str),
    /// The driver or the device itself failed.
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

    /// The device, tried out. Of several adapters it is the one that the driver recommends for speed, or the one that
    /// `CUBECL_WGPU_DEFAULT_DEVICE` names, e.g. `IntegratedGpu(0)`.
    ///
    /// # Errors
    /// [`DeviceError`] if the program was built without it, or its driver is missing.
    pub fn open(self) -> Result<Device, DeviceError> {
        match self {
            Self::Cpu => Ok(Device::flex()),
            #[cfg(feature = "gpu")]
            Self::Gpu => gpu::open(self, burn::tensor::DeviceType::Wgpu, Device::wgpu),
            #[cfg(feature = "cuda")]
            Self::Cuda => gpu::tried(self, || Device::cuda(0)),
            #[cfg(feature = "vulkan")]
            Self::Vulkan => gpu::open(self, burn::tensor::DeviceType::Vulkan, Device::vulkan),
            #[cfg(feature = "metal")]
            Self::Metal => gpu::open(self, burn::tensor::DeviceType::Metal, Device::metal),
            #[allow(unreachable_patterns)] // Reached where a feature is off.
            other => Err(DeviceError::NotBuilt(other.name())),
        }
    }

    /// What the device calls itself, after it was tried out; `None` if it has no name, as the CPU here.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn adapter(self) -> Result<Option<String>, DeviceError> {
        let device = self.open()?;
        #[cfg(any(feature = "gpu", feature = "cuda", feature = "vulkan", feature = "metal"))]
        return Ok(device.identity().map(|identity| identity.name));
        #[cfg(not(any(feature = "gpu", feature = "cuda", feature = "vulkan", feature = "metal")))]
        return Ok(None.filter(|_| is_cpu(&device)));
    }
}

/// Opening what may be missing.
#[cfg(any(feature = "gpu", feature = "cuda", feature = "vulkan", feature = "metal"))]
mod gpu {
    use super::{DeviceError, DeviceName, panics_told};
    use burn::tensor::{Device, Tensor};

    /// The default adapter of a graphics interface, if it has any, tried out.
    #[cfg(any(feature = "gpu", feature = "vulkan", feature = "metal"))]
    pub fn open(
        name: DeviceName,
        kind: burn::tensor::DeviceType,
        open: impl FnOnce(burn::tensor::DeviceKind) -> Device,
    ) -> Result<Device, DeviceError> {
        let adapters = panics_told(|| Ok(Device::enumerate(kind).into_vec().len()));
        match adapters {
            Ok(0) => Err(DeviceError::NoAdapter(name.name())),
            _ => tried(name, || open(burn::tensor::DeviceKind::DefaultDevice)),
        }
    }

    /// A device that has added two numbers: burn starts drivers when they are first used.
    pub fn tried(name: DeviceName, open: impl FnOnce() -> Device) -> Result<Device, DeviceError> {
        let outcome = panics_told(|| {
            let device = open();
            let sum = Tensor::<1>::from_data([1.0, 2.0], &device).sum().try_into_data();
            let sum = sum.map_err(|error| error.to_string())?.try_into_vec::<f32>();
            match sum {
                Ok(sum) if sum == [3.0] => Ok(device),
                other => Err(format!("it says that 1 + 2 is {other:?}")),
            }
        });
        outcome.map_err(|message| {
            let message = crate::transfer::root_cause(&message);
            let message = if message.is_empty() { "its driver gave no reason".to_owned() } else { message };
            DeviceError::Unusable { name: name.name(), message }
        })
    }
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
        assert_eq!(DeviceName::Cpu.adapter(), Ok(None));
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
