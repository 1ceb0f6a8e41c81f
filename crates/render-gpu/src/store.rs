//! What Gaussians on a device remember of segments: the one thing in which the kinds of memory differ.

use crate::GpuError;
use crate::device::{Buffer, GpuDevice};
use crate::gaussians::DeviceGaussians;
use crate::view::GpuView;
use splatseg_geometry::{SegmentId, SegmentMap};
use splatseg_memory::{MemoryError, Recall, SplatContentView};

/// A view, and what a store has read off it.
#[derive(Debug)]
pub(crate) struct Rendered<R> {
    pub view: GpuView,
    pub read: R,
}

/// A frame that is taken in.
#[derive(Debug)]
pub(crate) struct Lesson<'a> {
    pub device: &'a GpuDevice,
    pub gaussians: &'a DeviceGaussians,
    /// What it shows, see [`DeviceStore::target`].
    pub target: &'a Buffer,
    /// The report of the frame, see `kernels/forget.rs`.
    pub report: &'a Buffer,
}

/// The counterpart of [`SegmentStore`](splatseg_memory::SegmentStore). Errors are those of the device.
pub(crate) trait DeviceStore: std::fmt::Debug + Send + Sync + 'static {
    /// What it reads off a view for the rest of the frame.
    type Read: std::fmt::Debug + Send + Sync + 'static;

    /// All that Gaussians remember, read to be saved.
    type Copy: std::fmt::Debug + Default + Send + Sync + 'static;

    /// Whether learning depends on how many Gaussians have grown.
    const LEARNS_BY_COUNT: bool;

    /// Blends the view: writes its images and surfaces.
    fn expect(&self, device: &GpuDevice, map: &DeviceGaussians, view: &GpuView) -> Result<Self::Read, GpuError>;

    /// What the frame shows once memory and predictions are brought together.
    fn fuse(
        &self,
        device: &GpuDevice,
        rendered: &Rendered<Self::Read>,
        recall: &Recall<'_>,
        seen: &SegmentMap,
    ) -> Result<SegmentMap, GpuError>;

    /// What is to be learnt from a frame, as [`Self::grow`] and [`Self::learn`] take it.
    fn target(
        &self,
        device: &GpuDevice,
        view: &GpuView,
        recall: &Recall<'_>,
        seen: &SegmentMap,
    ) -> Result<Buffer, GpuError>;

    /// Writes what the Gaussians know that have grown at `pixels`; the map does not count them yet.
    fn grow(&self, lesson: &Lesson<'_>, pixels: &Buffer);

    /// Learns, and counts the Gaussians that did in the report; returns the number of pixels that they learnt from.
    fn learn(&self, lesson: &Lesson<'_>, rendered: &Rendered<Self::Read>) -> Result<usize, GpuError>;

    /// Makes some Gaussians surer of a segment than of all others together.
    fn favour(
        &self,
        _device: &GpuDevice,
        _map: &DeviceGaussians,
        _chosen: &[u32],
        _id: SegmentId,
    ) -> Result<(), GpuError> {
        Ok(())
    }

    /// Marks in the report how the Gaussians that are kept hold each of the `ids`, which increase, unless that takes too
    /// long; returns whether.
    fn mark_holds(
        &self,
        _device: &GpuDevice,
        _map: &DeviceGaussians,
        _keep: &Buffer,
        _ids: &[SegmentId],
        _report: &Buffer,
    ) -> Result<bool, GpuError> {
        Ok(false)
    }

    /// Prepares for a segment id that was never used before.
    fn new_segment(&mut self, device: &GpuDevice, id: SegmentId) -> Result<(), MemoryError>;

    /// Numbers that each Gaussian holds for segments.
    fn numbers_per_gaussian(&self) -> usize;

    /// Reads all that Gaussians remember.
    fn read(&self, device: &GpuDevice, map: &DeviceGaussians) -> Result<Self::Copy, GpuError>;

    /// The segment that each Gaussian shows by itself, 0 for none.
    fn segment_ids(&self, device: &GpuDevice, map: &DeviceGaussians) -> Result<Vec<SegmentId>, GpuError>;

    /// The share of each of these of all that the Gaussian was seen as; `None` if no second opinion is kept.
    fn segment_shares(&self, _copy: &Self::Copy) -> Option<Vec<f32>> {
        None
    }

    /// The copy, to be saved.
    fn content<'a>(&'a self, copy: &'a Self::Copy) -> SplatContentView<'a>;
}
