//! Stand-ins for the networks in a program without the feature `networks`: the types and functions that other crates
//! use, so that these need no conditions of their own.
//!
//! No value of them exists. Each contains a [`Device`], and [`DeviceName::open`](crate::device::DeviceName::open)
//! returns [`DeviceError::NoNetworks`](crate::device::DeviceError::NoNetworks).

pub mod completeness;
pub mod fastsam;
pub mod sam2;

/// A device, of which there is none in a program without networks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Device(Never);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Never {}

impl Device {
    /// Stands for code that is never reached, since there is no device.
    fn unreachable(self) -> ! {
        match self.0 {}
    }
}

#[cfg(test)]
mod tests {
    use crate::device::{DeviceError, DeviceName, HAS_NETWORKS};

    #[test]
    fn no_device_opens_without_networks() {
        assert!(!HAS_NETWORKS);
        assert_eq!(DeviceName::Cpu.open(), Err(DeviceError::NoNetworks));
        assert_eq!(DeviceName::Gpu.adapter(), Err(DeviceError::NotBuilt("gpu")));
    }
}
