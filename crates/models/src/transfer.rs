//! Transfers between the host and another device. All that networks move goes through here, and is counted.

use crate::device::is_cpu;
use burn::tensor::{Device, Tensor, TensorData, Transaction};
use splatseg_input::display_bytes;
use std::cell::Cell;

thread_local! {
    static SO_FAR: Cell<Transfers> = const { Cell::new(Transfers::NONE) };
}

/// How much networks have moved between the host and another device than the CPU.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Transfers {
    /// Transfers to the device. The host does not wait for them.
    pub uploads: usize,
    /// Bytes that they moved.
    pub uploaded_bytes: usize,
    /// Round trips: the host waits until the device has computed and sent what was asked for.
    pub downloads: usize,
    /// Bytes that they moved.
    pub downloaded_bytes: usize,
}

impl Transfers {
    const NONE: Self = Self { uploads: 0, uploaded_bytes: 0, downloads: 0, downloaded_bytes: 0 };

    /// Those of the calling thread so far, of all its networks.
    pub fn so_far() -> Self {
        SO_FAR.get()
    }

    /// Those since `earlier`.
    #[must_use]
    pub fn since(self, earlier: Self) -> Self {
        Self {
            uploads: self.uploads - earlier.uploads,
            uploaded_bytes: self.uploaded_bytes - earlier.uploaded_bytes,
            downloads: self.downloads - earlier.downloads,
            downloaded_bytes: self.downloaded_bytes - earlier.downloaded_bytes,
        }
    }
}

/// A tensor of row-major elements on a device.
pub fn upload<const D: usize>(values: Vec<f32>, shape: [usize; D], device: &Device) -> Tensor<D> {
    if !is_cpu(device) {
        let so_far = SO_FAR.get();
        SO_FAR.set(Transfers {
            uploads: so_far.uploads + 1,
            uploaded_bytes: so_far.uploaded_bytes + size_of_val(values.as_slice()),
            ..so_far
        });
    }
    Tensor::from_data(TensorData::new(values, shape), device)
}

/// The elements of tensors of one device, in one round trip.
///
/// # Errors
/// What the device says, if it failed at this or at anything that it was told to compute before.
pub fn download(tensors: Vec<Tensor<1>>) -> Result<Vec<Vec<f32>>, String> {
    let Some(first) = tensors.first() else { return Ok(Vec::new()) };
    let is_cpu = is_cpu(&first.device());
    let transaction = tensors.into_iter().fold(Transaction::default(), Transaction::register);
    let data = transaction.try_execute().map_err(|error| root_cause(&error.to_string()))?;
    let values = data.into_iter().map(|data| data.try_into_vec::<f32>().map_err(|error| format!("{error:?}")));
    let values = values.collect::<Result<Vec<_>, _>>()?;
    if !is_cpu {
        let so_far = SO_FAR.get();
        let bytes: usize = values.iter().map(|values| size_of_val(values.as_slice())).sum();
        SO_FAR.set(Transfers {
            downloads: so_far.downloads + 1,
            downloaded_bytes: so_far.downloaded_bytes + bytes,
            ..so_far
        });
    }
    Ok(values)
}

/// What is behind a device's error, in one line: the last of its causes, without the chain of everything that it kept
/// from being computed.
pub(crate) fn root_cause(message: &str) -> String {
    const NO_ROOM: &str = "can't allocate buffer of size: ";
    let size =
        message.split(NO_ROOM).nth(1).map(|rest| rest.chars().take_while(char::is_ascii_digit).collect::<String>());
    if let Some(bytes) = size.and_then(|digits| digits.parse::<u64>().ok()) {
        return format!("it has no room for a buffer of {}", display_bytes(bytes));
    }
    let last = message.rsplit("Caused by:").next().unwrap_or(message);
    let lines =
        last.lines().map(str::trim).take_while(|line| !line.starts_with("Asked at") && !line.contains("backtrace"));
    lines.filter(|line| !line.is_empty()).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What Burn 0.22 says where a buffer is too large for the device.
    const CHAIN: &str = "An error happened during execution\nCaused by:\n  Several failures at once\nCaused by:\n  The \
        bytes were never written\n  skipped `KernelBinop`\nCaused by:\n  An IO error happened\nCaused by:\n  can't \
        allocate buffer of size: 176160768\nNo backtrace available\nAsked at:\nNo backtrace available";

    #[test]
    fn of_a_chain_of_causes_the_last_is_told() {
        assert_eq!(root_cause(CHAIN), "it has no room for a buffer of 176 MB");
        let lost = CHAIN.replace("can't allocate buffer of size: 176160768", "Parent device is lost");
        assert_eq!(root_cause(&lost), "Parent device is lost");
        assert_eq!(root_cause("no adapter\n"), "no adapter");
    }
}
