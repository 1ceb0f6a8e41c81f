//! `splatseg devices`: lists what networks can run on, and tries it out.
//!
//! A driver that is broken can end the process that uses it. So another process tries a device first ([`check`]).

use super::Failure;
use super::bench::processor;
use clap::Args;
use splatseg_models::device::{DeviceError, DeviceName};
use splatseg_settings::Choice;
use std::ffi::OsString;
use std::process::{Command, Stdio};

/// What the process that tries a device writes before the device's name.
const USABLE: &str = "usable: ";
/// What it writes before what is wrong with it.
const UNUSABLE: &str = "unusable: ";

#[derive(Debug, Args)]
#[command(after_long_help = "A device is chosen with --device NAME. docs/GPU.md has what each needs.")]
pub struct DevicesArguments {
    /// Try one device in this process
    #[arg(long, value_name = "NAME", hide = true)]
    pub probe: Option<String>,
}

/// Lists the devices, each with what it is or what it lacks.
pub fn devices(arguments: &DevicesArguments, program: &[OsString]) -> Result<(), Failure> {
    if let Some(name) = &arguments.probe {
        return probe(name);
    }
    for device in DeviceName::ALL.iter().copied() {
        let state = match device {
            DeviceName::Cpu => processor().unwrap_or_else(|| std::env::consts::ARCH.to_owned()),
            _ if !device.is_built() => format!("not part of this program: build it with --features {}", device.name()),
            _ => tried(device, program).unwrap_or_else(|reason| format!("cannot be used: {reason}")),
        };
        say!("{:<7} {state}", device.name());
    }
    Ok(())
}

/// Checks devices before a run uses them.
pub fn check(devices: impl Iterator<Item = DeviceName>, program: &[OsString]) -> Result<(), Failure> {
    let mut checked = vec![DeviceName::Cpu];
    for device in devices.filter(|device| device.is_built()) {
        if !checked.contains(&device) {
            let unusable = |message| Failure::input(DeviceError::Unusable { name: device.name(), message });
            tried(device, program).map_err(unusable)?;
            checked.push(device);
        }
    }
    Ok(())
}

/// Tries a device in this process and says what came of it.
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

/// The name of a device that another process could use, or what is wrong with it.
fn tried(device: DeviceName, program: &[OsString]) -> Result<String, String> {
    let Some((executable, arguments)) = program.split_first() else {
        return device.adapter().map(Option::unwrap_or_default).map_err(|error| error.to_string());
    };
    let mut process = Command::new(executable);
    process.args(arguments).args(["devices", "--probe", device.name()]).stdin(Stdio::null()).stderr(Stdio::null());
    let output = process.output().map_err(|error| format!("no process could be started to try it: {error}"))?;
    let text = String::from_utf8_lossy(&output.stdout);
    // Drivers may write lines of their own.
    let found = |start: &str| text.lines().find_map(|line| line.strip_prefix(start)).map(str::to_owned);
    match (found(USABLE), found(UNUSABLE)) {
        (Some(adapter), _) if output.status.success() => Ok(adapter),
        (_, Some(reason)) => Err(reason),
        _ => Err(format!("its driver crashed when it was tried ({})", output.status)),
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    /// What is said of a device if another process runs this script to try it.
    fn said(script: &str) -> Result<String, String> {
        tried(DeviceName::Gpu, &["sh", "-c", script].map(OsString::from))
    }

    #[test]
    fn a_process_that_crashes_a_driver_takes_nobody_along() {
        assert_eq!(said("echo 'driver 1.2'; echo 'usable: A card'"), Ok("A card".to_owned()));
        assert_eq!(said("echo 'unusable: no memory'"), Err("no memory".to_owned()));
        let crashed = said("kill -SEGV $$").unwrap_err();
        assert!(crashed.starts_with("its driver crashed when it was tried (signal: 11"), "{crashed}");
        let late = said("echo 'usable: A card'; kill -SEGV $$").unwrap_err();
        assert!(late.starts_with("its driver crashed"), "{late}");
        assert!(tried(DeviceName::Gpu, &[OsString::from("/nowhere")]).unwrap_err().contains("no process"));
    }
}
