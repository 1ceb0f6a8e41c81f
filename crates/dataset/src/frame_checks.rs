//! Steps for every frame before it is used: checks of its size and plausibility, and framing.

use crate::depth_scale::DepthUnitCheck;
use crate::files::MemoryRequirement;
use crate::plausibility::{Plausibility, check_intrinsics};
use crate::stamps::require_possible;
use crate::{DatasetError, FramePart, Framing, RecordedFrame};
use splatseg_geometry::{CameraFrame, Intrinsics, Pose};
use std::path::{Path, PathBuf};

/// Memory used by a run of twenty frames per pixel of a frame, bytes: `graph` and the evidence memory, measured from
/// 0.08 to 2 megapixels.
const RUN_BYTES_PER_PIXEL: u64 = 250;

/// Checks of the frames of a source, in order.
#[derive(Debug)]
pub(crate) struct FrameChecks {
    pub(crate) framing: Framing,
    /// Size of the first good frame, before framing.
    pub(crate) original_size: Option<(usize, usize)>,
    /// Intrinsics of the first frame, before framing.
    original_intrinsics: Option<Intrinsics>,
    depth_unit: DepthUnitCheck,
    plausibility: Plausibility,
}

impl FrameChecks {
    pub(crate) fn new(framing: Framing) -> Self {
        let (depth_unit, plausibility) = (DepthUnitCheck::default(), Plausibility::new(framing.max_depth));
        Self { framing, original_size: None, original_intrinsics: None, depth_unit, plausibility }
    }

    /// Does not warn that there is no depth.
    pub(crate) fn without_depth(mut self) -> Self {
        self.plausibility = Plausibility::without_depth();
        self
    }

    /// Returns the size `(width, height)` of the next frame. `source` is the name of its scene.
    ///
    /// # Errors
    /// If it differs from that of the first good frame, or a run with such frames would exceed the memory limit.
    pub(crate) fn check_size(&self, frame: &CameraFrame<'_>, source: &str) -> Result<(usize, usize), DatasetError> {
        let size = (frame.width(), frame.height());
        match self.original_size {
            Some(expected) if expected != size => {
                return Err(sizes_differ(frame, "frame", size, expected, "the first frame"));
            }
            Some(_) => {}
            None => self.require_memory(size, source)?,
        }
        Ok(size)
    }

    /// Checks and frames the next frame. `place` names the file of a part of it.
    ///
    /// # Errors
    /// If its pose is impossible, or nothing would be left of it or of its depth.
    pub(crate) fn framed(
        &mut self,
        recorded: RecordedFrame,
        place: &dyn Fn(FramePart) -> PathBuf,
    ) -> Result<(CameraFrame<'static>, Option<Pose>), DatasetError> {
        require_possible(recorded.frame.timestamp(), || place(FramePart::Depth))?;
        self.depth_unit.check(&recorded, place)?;
        self.plausibility.check(&recorded, place)?;
        let RecordedFrame { frame, world_from_camera } = recorded;
        let (size, intrinsics) = ((frame.width(), frame.height()), *frame.intrinsics());
        let frame = self.framing.apply(frame)?;
        self.original_size = Some(size);
        self.original_intrinsics.get_or_insert(intrinsics);
        Ok((frame, world_from_camera))
    }

    /// Checks the intrinsics of the first good frame. `place` names their file.
    ///
    /// # Errors
    /// If they are impossible.
    pub(crate) fn check_intrinsics(&self, place: &dyn Fn(FramePart) -> PathBuf) -> Result<(), DatasetError> {
        self.original_intrinsics.as_ref().map_or(Ok(()), |intrinsics| check_intrinsics(intrinsics, place))
    }

    /// Checks that a run with frames of size `(width, height)` can stay within the memory limit.
    fn require_memory(&self, size: (usize, usize), source: &str) -> Result<(), DatasetError> {
        self.framing.check(size)?;
        let requirement = MemoryRequirement {
            what: "run on frames",
            size: self.framing.resized(size),
            bytes_per_pixel: RUN_BYTES_PER_PIXEL,
            remedy: "make frames smaller with --resize or dataset.max_pixels, or raise --memory-limit",
        };
        requirement.check(Path::new(source))
    }
}

pub(crate) fn sizes_differ(
    frame: &CameraFrame<'_>,
    what: &'static str,
    found: (usize, usize),
    expected: (usize, usize),
    expected_from: &'static str,
) -> DatasetError {
    DatasetError::SizesDiffer { path: frame.name().into(), what, found, expected, expected_from }
}
