//! Transfers between the host and another device. All transfers of the networks go through here and are counted.

use crate::device::is_cpu;
use crate::device_error::root_cause;
use burn::tensor::{Device, Tensor, TensorData, Transaction};
use std::cell::Cell;

thread_local! {
    static SO_FAR: Cell<Transfers> = const { Cell::new(Transfers::NONE) };
}

/// Counts of transfers between the host and a device other than the CPU.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Transfers {
    /// Number of transfers to the device. The host does not wait for them.
    pub uploads: usize,
    /// Bytes uploaded.
    pub uploaded_bytes: usize,
    /// Number of round trips: the host waits until the device has computed and sent the requested values.
    pub downloads: usize,
    /// Bytes downloaded.
    pub downloaded_bytes: usize,
}

impl Transfers {
    const NONE: Self = Self { uploads: 0, uploaded_bytes: 0, downloads: 0, downloaded_bytes: 0 };

    /// Returns the transfers of all networks on the calling thread so far.
    pub fn so_far() -> Self {
        SO_FAR.get()
    }

    /// Returns the transfers since `earlier`.
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

/// Creates a tensor on a device from row-major elements.
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

/// Reads the elements of tensors on one device, in one round trip.
///
/// # Errors
/// The device's message if the transfer or an earlier computation failed.
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
