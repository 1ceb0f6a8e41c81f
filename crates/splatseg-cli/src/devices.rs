//! `splatseg devices`: lists the devices that networks can run on, and tests each one.
//!
//! A broken driver can crash the process that uses it. So a device is first tested in another process ([`check`]).

use super::Failure;
use super::bench::processor;
use clap::Args;
use splatseg_models::device::{DeviceError, DeviceName};
use splatseg_settings::Choice;
use std::ffi::OsString;
use std::process::{Command, Stdio};

/// Prefix of the device's name in the output of the test process.
const USABLE: &str = "usable: ";
/// Prefix of the error message in the output of the test process.
const UNUSABLE: &str = "unusable: ";

#[derive(Debug, Args)]
#[command(after_long_help = "Choose a device with --device NAME. docs/GPU.md lists the requirements of each.")]
pub struct DevicesArguments {
    /// Test one device in this process
    #[arg(long, value_name = "NAME", hide = true)]
    pub probe: Option<String>,
}

/// Lists the devices, each with its name or the reason why it cannot be used.
pub fn devices(arguments: &DevicesArguments, program: &[OsString]) -> Result<(), Failure> {
    if let Some(name) = &arguments.probe {
        return probe(name);
    }
    for device in DeviceName::ALL.iter().copied() {
        let state = match device {
            DeviceName::Cpu => processor().unwrap_or_else(|| std::env::consts::ARCH.to_owned()),
            _ if !device.is_built() => format!("not built in: build splatseg with --features {}", device.name()),
            _ => test_device(device, program).unwrap_or_else(|reason| format!("cannot be used: {reason}")),
        };
        say!("{:<7} {state}", device.name());
    }
    Ok(())
}

/// Checks the device before a run uses it.
pub fn check(device: Option<DeviceName>, program: &[OsString]) -> Result<(), Failure> {
    match device.filter(|device| *device != DeviceName::Cpu && device.is_built()) {
        Some(device) => {
            let unusable = |message| Failure::input(DeviceError::Unusable { name: device.name(), message });
            test_device(device, program).map(drop).map_err(unusable)
        }
        None => Ok(()),
    }
}

/// Tests a device in this process and prints the result.
fn probe(name: &str) -> Result<(), Failure> {
    let device = DeviceName::from_name(name).ok_or_else(|| Failure::input(format!("there is no device {name}")))?;
    match device.adapter() {
        Ok(adapter) => say!("{USABLE}{}", adapter.unwrap_or_default()),
        Err(DeviceError::Unusable { message, .. }) => say!("{UNUSABLE}{message}"),
        Err(DeviceError::NoAdapter(_)) => {
            say!("{UNUSABLE}no adapter was found, is its driver installed? See docs/GPU.md");
        }
        Err(error) => say!("{UNUSABLE}{error}"),
    }
    Ok(())
}

/// Tests a device in another process. Returns its name, or the reason why it cannot be used.
fn test_device(device: DeviceName, program: &[OsString]) -> Result<String, String> {
    let Some((executable, arguments)) = program.split_first() else {
        return device.adapter().map(Option::unwrap_or_default).map_err(|error| error.to_string());
    };
    let mut process = Command::new(executable);
    process.args(arguments).args(["devices", "--probe", device.name()]).stdin(Stdio::null()).stderr(Stdio::null());
    let output = process.output().map_err(|error| format!("no process could be started to test it: {error}"))?;
    let text = String::from_utf8_lossy(&output.stdout);
    // Drivers may write lines of their own.
    let found = |start: &str| text.lines().find_map(|line| line.strip_prefix(start)).map(str::to_owned);
    match (found(USABLE), found(UNUSABLE)) {
        (Some(adapter), _) if output.status.success() => Ok(adapter),
        (_, Some(reason)) => Err(reason),
        _ => Err(format!("its driver crashed in a test ({})", output.status)),
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    /// Tests a device with this script as the other process.
    fn test_device_with(script: &str) -> Result<String, String> {
        test_device(DeviceName::Gpu, &["sh", "-c", script].map(OsString::from))
    }

    #[test]
    fn a_driver_crash_in_the_test_process_is_reported() {
        assert_eq!(test_device_with("echo 'driver 1.2'; echo 'usable: A card'"), Ok("A card".to_owned()));
        assert_eq!(test_device_with("echo 'unusable: no memory'"), Err("no memory".to_owned()));
        let crashed = test_device_with("kill -SEGV $$").unwrap_err();
        assert!(crashed.starts_with("its driver crashed in a test (signal: 11"), "{crashed}");
        let late = test_device_with("echo 'usable: A card'; kill -SEGV $$").unwrap_err();
        assert!(late.starts_with("its driver crashed"), "{late}");
        assert!(test_device(DeviceName::Gpu, &[OsString::from("/nowhere")]).unwrap_err().contains("no process"));
    }
}
