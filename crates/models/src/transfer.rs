//! Transfers between the host and another device. All that networks move goes through here, and is counted.

use crate::device::is_cpu;
use burn::tensor::{Device, Tensor, TensorData, Transaction};
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
pub(crate) fn upload<const D: usize>(values: Vec<f32>, shape: [usize; D], device: &Device) -> Tensor<D> {
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
pub(crate) fn download(tensors: Vec<Tensor<1>>) -> Result<Vec<Vec<f32>>, String> {
    let Some(first) = tensors.first() else { return Ok(Vec::new()) };
    let is_cpu = is_cpu(&first.device());
    let transaction = tensors.into_iter().fold(Transaction::default(), Transaction::register);
    let data = transaction.try_execute().map_err(|error| one_line(&error.to_string()))?;
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

/// A driver's message without line breaks.
pub(crate) fn one_line(message: &str) -> String {
    let lines: Vec<&str> = message.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
    lines.join(" ")
}
