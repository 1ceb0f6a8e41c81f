//! A GPU, its buffers, and a count of what goes there and back.

use crate::GpuError;
use crate::kernels::forget::fill;
use cubecl::device::WgpuDeviceKind;
use cubecl::prelude::*;
use cubecl::server::Handle;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// What went to a device and back since it was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Transfers {
    /// Buffers sent.
    pub uploads: u64,
    /// Bytes of those.
    pub uploaded_bytes: u64,
    /// Times that something was read; the program waits for the device each time.
    pub downloads: u64,
    /// Bytes of those.
    pub downloaded_bytes: u64,
}

#[derive(Debug, Default)]
struct TransferCounters {
    uploads: AtomicU64,
    uploaded_bytes: AtomicU64,
    downloads: AtomicU64,
    downloaded_bytes: AtomicU64,
}

/// A GPU that can take over maps; copies are the same device.
#[derive(Clone)]
pub struct GpuDevice {
    pub(crate) client: Client,
    counters: Arc<TransferCounters>,
    /// Largest buffer, bytes.
    limit: u64,
}

impl std::fmt::Debug for GpuDevice {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("GpuDevice").field("transfers", &self.transfers()).finish_non_exhaustive()
    }
}

/// 32-bit values on a device.
#[derive(Clone)]
pub(crate) struct Buffer {
    handle: Handle,
    len: usize,
}

impl std::fmt::Debug for Buffer {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "Buffer[{}]", self.len)
    }
}

impl Buffer {
    /// Number of values.
    pub fn len(&self) -> usize {
        self.len
    }

    /// The buffer as an argument of a kernel.
    pub fn arg(&self) -> BufferArg {
        // SAFETY: `len` values of 4 bytes are what was allocated, and all element types of the kernels have 4 bytes.
        #[allow(unsafe_code)]
        let arg = unsafe { BufferArg::from_raw_parts(self.handle.clone(), self.len) };
        arg
    }
}

impl GpuDevice {
    /// The best Vulkan device of the machine; on Apple's machines that of Metal.
    ///
    /// # Errors
    /// [`GpuError::NoDevice`] if there is none.
    pub fn open() -> Result<Self, GpuError> {
        let no_device = |reason: String| GpuError::NoDevice { reason };
        let kind = WgpuDeviceKind::default();
        let device = match cfg!(target_vendor = "apple") {
            true => cubecl::Device::wgpu(kind),
            false => cubecl::Device::vulkan(kind),
        };
        let device = device.map_err(|error| no_device(error.to_string()))?;
        let client = device.client();
        let limit = client.properties().memory.max_page_size;
        Ok(Self { client, counters: Arc::default(), limit })
    }

    /// What went to the device and back so far.
    pub fn transfers(&self) -> Transfers {
        let read = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        Transfers {
            uploads: read(&self.counters.uploads),
            uploaded_bytes: read(&self.counters.uploaded_bytes),
            downloads: read(&self.counters.downloads),
            downloaded_bytes: read(&self.counters.downloaded_bytes),
        }
    }

    /// The same device with a count of its own.
    #[must_use]
    pub fn fresh_counters(&self) -> Self {
        Self { counters: Arc::default(), ..self.clone() }
    }

    /// Room for `len` values of any content, at least one; `what` names it in errors.
    pub(crate) fn empty(&self, len: usize, what: &'static str) -> Result<Buffer, GpuError> {
        let len = len.max(1);
        let bytes = 4 * len as u64;
        if bytes > self.limit {
            return Err(GpuError::TooLarge { what, bytes, limit: self.limit });
        }
        Ok(Buffer { handle: self.client.empty(4 * len), len })
    }

    /// `len` zeros.
    pub(crate) fn zeros(&self, len: usize, what: &'static str) -> Result<Buffer, GpuError> {
        self.filled(len, 0, what)
    }

    /// `len` times the same value.
    pub(crate) fn filled(&self, len: usize, value: u32, what: &'static str) -> Result<Buffer, GpuError> {
        let buffer = self.empty(len, what)?;
        let (cubes, threads) = threads(buffer.len());
        fill::launch(&self.client, cubes, threads, buffer.arg(), value, buffer.len() as u32);
        Ok(buffer)
    }

    /// Sends values.
    pub(crate) fn upload<T: bytemuck::NoUninit>(&self, values: &[T], what: &'static str) -> Result<Buffer, GpuError> {
        let bytes: &[u8] = bytemuck::cast_slice(values);
        if bytes.len() as u64 > self.limit {
            return Err(GpuError::TooLarge { what, bytes: bytes.len() as u64, limit: self.limit });
        }
        if bytes.is_empty() {
            return self.empty(0, what);
        }
        self.counters.uploads.fetch_add(1, Ordering::Relaxed);
        self.counters.uploaded_bytes.fetch_add(bytes.len() as u64, Ordering::Relaxed);
        Ok(Buffer { handle: self.client.create_from_slice(bytes), len: bytes.len() / 4 })
    }

    /// Reads buffers in one go.
    pub(crate) fn download<const N: usize>(&self, buffers: [&Buffer; N]) -> Result<[Vec<u32>; N], GpuError> {
        let handles = buffers.iter().map(|buffer| buffer.handle.clone()).collect();
        let failed = |reason: String| GpuError::Failed { reason };
        let found = self.client.read(handles).map_err(|error| failed(format!("{error:?}")))?;
        let mut read: [Vec<u32>; N] = std::array::from_fn(|_| Vec::new());
        for ((values, bytes), buffer) in read.iter_mut().zip(&found).zip(buffers) {
            *values = bytemuck::pod_collect_to_vec(&bytes[..]);
            if values.len() < buffer.len {
                return Err(failed(format!("{} values came back of {}", values.len(), buffer.len)));
            }
            values.truncate(buffer.len);
            self.counters.downloaded_bytes.fetch_add(4 * buffer.len as u64, Ordering::Relaxed);
        }
        self.counters.downloads.fetch_add(1, Ordering::Relaxed);
        Ok(read)
    }
}

/// Most cubes along one axis.
const MAX_CUBES: usize = 65_535;

/// So many cubes. There may be some more: kernels check their place.
pub(crate) fn cubes(count: usize) -> CubeCount {
    let count = count.max(1);
    let rows = count.div_ceil(MAX_CUBES);
    CubeCount::Static(count.div_ceil(rows) as u32, rows as u32, 1)
}

/// Threads of a cube.
pub(crate) fn cube_dim() -> CubeDim {
    CubeDim::new_1d(256)
}

/// Cubes for one thread per item.
pub(crate) fn threads(items: usize) -> (CubeCount, CubeDim) {
    (cubes(items.div_ceil(256)), cube_dim())
}
