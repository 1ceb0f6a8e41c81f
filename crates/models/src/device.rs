//! Devices that networks run on.

#[cfg(not(feature = "networks"))]
pub use crate::without_networks::Device;
/// An open device, where networks keep their tensors.
#[cfg(feature = "networks")]
pub use burn::tensor::Device;

use splatseg_settings::choices;
use thiserror::Error;

/// True if the program was built with networks that need a [`Device`]: the feature `networks`.
pub const HAS_NETWORKS: bool = cfg!(feature = "networks");

choices! {
    /// A kind of device. The CPU is always available; the others are Cargo features of the same name.
    pub enum DeviceName, default Cpu {
        /// The CPU.
        Cpu = "cpu",
        /// Any GPU, through wgpu: Vulkan, Metal or DirectX 12, depending on the driver.
        Gpu = "gpu",
        /// An NVIDIA GPU.
        Cuda = "cuda",
        /// Any GPU with a Vulkan driver, with shaders in SPIR-V.
        Vulkan = "vulkan",
        /// An Apple GPU.
        Metal = "metal",
    }
}

/// Errors opening a device.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum DeviceError {
    /// The program was built without networks.
    #[error(
        "this build of splatseg has neither FastSAM nor SAM 2, EdgeTAM or EfficientTAM: build it with --features \
         networks, e.g. cargo install --path crates/splatseg-cli --features networks,ros2,mcp \
         --profile dist"
    )]
    NoNetworks,
    /// The program was built without this device.
    #[error("this program was built without the device {0}: build it with --features {0}")]
    NotBuilt(&'static str),
    /// No device of this kind has a driver.
    #[error("the device {0} cannot be used: no adapter found. Is its driver installed? See docs/GPU.md")]
    NoAdapter(&'static str),
    /// The driver or the device itself failed.
    #[error("the device {name} cannot be used: {message}")]
    Unusable {
        /// Name of the device.
        name: &'static str,
        /// Message from the driver.
        message: String,
    },
}

impl DeviceName {
    /// True if the program was built with support for the device. Its driver may still be missing.
    pub fn is_built(self) -> bool {
        match self {
            Self::Cpu => true,
            Self::Gpu => cfg!(feature = "gpu"),
            Self::Cuda => cfg!(feature = "cuda"),
            Self::Vulkan => cfg!(feature = "vulkan"),
            Self::Metal => cfg!(feature = "metal"),
        }
    }

    /// Opens and tests the device. Of several adapters, chooses the one that the driver recommends for speed, or the
    /// one named by `CUBECL_WGPU_DEFAULT_DEVICE`, e.g. `IntegratedGpu(0)`.
    ///
    /// # Errors
    /// [`DeviceError`] if the program was built without networks or without the device, its driver is missing, or it
    /// fails the test.
    pub fn open(self) -> Result<Device, DeviceError> {
        match self {
            #[cfg(feature = "networks")]
            Self::Cpu => Ok(Device::flex()),
            #[cfg(not(feature = "networks"))]
            Self::Cpu => Err(DeviceError::NoNetworks),
            #[cfg(feature = "gpu")]
            Self::Gpu => gpu::open(self, burn::tensor::DeviceType::Wgpu, Device::wgpu),
            #[cfg(feature = "cuda")]
            Self::Cuda => gpu::open_tested(self, || Device::cuda(0)),
            #[cfg(feature = "vulkan")]
            Self::Vulkan => gpu::open(self, burn::tensor::DeviceType::Vulkan, Device::vulkan),
            #[cfg(feature = "metal")]
            Self::Metal => gpu::open(self, burn::tensor::DeviceType::Metal, Device::metal),
            #[allow(unreachable_patterns)] // Reached if a feature is off.
            other => Err(DeviceError::NotBuilt(other.name())),
        }
    }

    /// Opens and tests the device and returns the adapter's name; `None` for a device without a name, such as the CPU.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn adapter(self) -> Result<Option<String>, DeviceError> {
        let opened = self.open();
        #[cfg(any(feature = "gpu", feature = "cuda", feature = "vulkan", feature = "metal"))]
        return opened.map(|device| device.identity().map(|identity| identity.name));
        #[cfg(not(any(feature = "gpu", feature = "cuda", feature = "vulkan", feature = "metal")))]
        return opened.map(|_| None);
    }
}

/// Opens devices whose drivers may be missing.
#[cfg(any(feature = "gpu", feature = "cuda", feature = "vulkan", feature = "metal"))]
mod gpu {
    use super::{DeviceError, DeviceName, catch_panic_message, root_cause};
    use burn::tensor::{Device, Tensor};

    /// Opens and tests the default adapter of a graphics interface, if there is one.
    #[cfg(any(feature = "gpu", feature = "vulkan", feature = "metal"))]
    pub fn open(
        name: DeviceName,
        kind: burn::tensor::DeviceType,
        open: impl FnOnce(burn::tensor::DeviceKind) -> Device,
    ) -> Result<Device, DeviceError> {
        let adapters = catch_panic_message(|| Ok(Device::enumerate(kind).into_vec().len()));
        match adapters {
            Ok(0) => Err(DeviceError::NoAdapter(name.name())),
            _ => open_tested(name, || open(burn::tensor::DeviceKind::DefaultDevice)),
        }
    }

    /// Opens a device and tests it by adding two numbers: Burn starts drivers on first use.
    pub fn open_tested(name: DeviceName, open: impl FnOnce() -> Device) -> Result<Device, DeviceError> {
        let outcome = catch_panic_message(|| {
            let device = open();
            let sum = Tensor::<1>::from_data([1.0, 2.0], &device).sum().try_into_data();
            let sum = sum.map_err(|error| error.to_string())?.try_into_vec::<f32>();
            match sum {
                Ok(sum) if sum == [3.0] => Ok(device),
                other => Err(format!("self-test failed: 1 + 2 = {other:?}")),
            }
        });
        outcome.map_err(|message| {
            let message = root_cause(&message);
            let message = if message.is_empty() { "the driver gave no reason".to_owned() } else { message };
            DeviceError::Unusable { name: name.name(), message }
        })
    }
}

/// Runs `work`. If it panics, returns the message of the first panic of any thread meanwhile; panics are not printed.
/// Without a driver, a thread of Burn panics first, and then the thread that waits for it, which gives no reason.
#[cfg(any(test, feature = "gpu", feature = "cuda", feature = "vulkan", feature = "metal"))]
fn catch_panic_message<T>(work: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
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

/// True if tensors on the device are computed on the CPU, where this crate uses its own kernels.
#[cfg(feature = "networks")]
pub(crate) fn is_cpu(device: &Device) -> bool {
    burn::tensor::Tensor::<1>::empty([1], device).try_into_primitive::<burn::backend::Flex>().is_ok()
}

/// Extracts the root cause of a device's error, on one line, without the chain of computations that it made fail.
#[cfg(feature = "networks")]
pub(crate) fn root_cause(message: &str) -> String {
    const NO_ROOM: &str = "can't allocate buffer of size: ";
    let size =
        message.split(NO_ROOM).nth(1).map(|rest| rest.chars().take_while(char::is_ascii_digit).collect::<String>());
    if let Some(bytes) = size.and_then(|digits| digits.parse::<u64>().ok()) {
        return format!("not enough memory for a buffer of {}", splatseg_files::display_bytes(bytes));
    }
    let last = message.rsplit("Caused by:").next().unwrap_or(message);
    let lines =
        last.lines().map(str::trim).take_while(|line| !line.starts_with("Asked at") && !line.contains("backtrace"));
    lines.filter(|line| !line.is_empty()).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(feature = "networks")]
    #[test]
    fn the_cpu_is_always_available_and_missing_devices_are_errors() {
        assert!(DeviceName::Cpu.is_built() && DeviceName::Cpu.open().is_ok());
        assert_eq!(DeviceName::Cpu.adapter(), Ok(None));
        assert_eq!(DeviceName::Cuda.is_built(), cfg!(feature = "cuda"));
        #[cfg(not(feature = "cuda"))]
        assert_eq!(
            DeviceName::Cuda.open().unwrap_err().to_string(),
            "this program was built without the device cuda: build it with --features cuda"
        );
    }

    #[test]
    fn the_first_of_several_panics_is_reported() {
        let waiting: Result<(), String> = catch_panic_message(|| {
            let service = std::thread::spawn(|| panic!("no adapter"));
            service.join().unwrap();
            Ok(())
        });
        assert_eq!(waiting, Err("no adapter".to_owned()));
        assert_eq!(catch_panic_message(|| Ok(3)), Ok(3));
    }

    /// The message of Burn 0.22 for a buffer that is too large for the device.
    #[cfg(feature = "networks")]
    const CHAIN: &str = "An error happened during execution\nCaused by:\n  Several failures at once\nCaused by:\n  The \
        bytes were never written\n  skipped `KernelBinop`\nCaused by:\n  An IO error happened\nCaused by:\n  can't \
        allocate buffer of size: 176160768\nNo backtrace available\nAsked at:\nNo backtrace available";

    #[cfg(feature = "networks")]
    #[test]
    fn the_root_cause_is_the_last_of_the_chain() {
        assert_eq!(root_cause(CHAIN), "not enough memory for a buffer of 176 MB");
        let lost = CHAIN.replace("can't allocate buffer of size: 176160768", "Parent device is lost");
        assert_eq!(root_cause(&lost), "Parent device is lost");
        assert_eq!(root_cause("no adapter\n"), "no adapter");
    }
}
