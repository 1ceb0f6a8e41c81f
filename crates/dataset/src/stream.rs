//! Streams of a scene's frames, in order, read ahead in the background.

use crate::frame_checks::{FrameChecks, sizes_differ};
use crate::{
    CorrectedPose, DatasetError, DatasetSettings, FrameReadError, FrameSource, Framing, Scene, SceneDescription,
    StreamedFrame,
};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

/// Maximum number of frames that wait in the channel.
const WAITING_FRAMES: usize = 2;
/// Maximum size of all waiting frames together, bytes. The larger the frames, the fewer wait, down to none.
const WAITING_BYTES: usize = 64 << 20;
/// Bytes per pixel of colour, depth and labels.
const FRAME_BYTES_PER_PIXEL: usize = 3 + 4 + 4;
/// Maximum number of frames of a [`FrameStream`] in memory at once, however long the video: two that wait, one being
/// read, and one held by the caller. Fewer wait if frames are large.
pub const MAX_FRAMES_IN_MEMORY: usize = WAITING_FRAMES + 2;

/// Choice of reading the ground truth segments along with each frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GroundTruth {
    /// Read the ground truth where it exists.
    Read,
    /// Do not read the ground truth.
    Skip,
}

/// Item of a stream: a frame, or the reason it cannot be used.
type FrameResult = Result<StreamedFrame, FrameReadError>;

/// Iterator over the frames selected by the settings, in order. They are read ahead on a background thread, at most
/// [`MAX_FRAMES_IN_MEMORY`] at a time. Dropping the stream stops the thread.
///
/// A frame that cannot be read, or whose size differs from that of the first good frame, is an `Err`. The stream then
/// continues with the next frame.
#[derive(Debug)]
pub struct FrameStream {
    /// Results read while looking for the first good frame.
    first: std::vec::IntoIter<FrameResult>,
    receiver: Option<Receiver<FrameResult>>,
    reader: Option<JoinHandle<()>>,
    /// Indices of the frames not returned yet.
    pending: std::vec::IntoIter<usize>,
    description: SceneDescription,
    scene: Arc<dyn Scene>,
}

impl FrameStream {
    /// Starts reading the selected frames of a scene. Reads up to the first good frame immediately, to check the crop,
    /// the memory needed for frames of this size, and the intrinsics.
    ///
    /// # Errors
    /// [`DatasetError::Setting`] if the settings are invalid, select no frame, or crop everything away;
    /// [`DatasetError::MemoryLimit`] if frames are too large; [`DatasetError::Field`] if the intrinsics are
    /// implausible.
    pub fn open(
        scene: Arc<dyn Scene>,
        settings: &DatasetSettings,
        ground_truth: GroundTruth,
    ) -> Result<Self, DatasetError> {
        Self::open_at(scene, settings, ground_truth, 0)
    }

    /// Like [`Self::open`], but skips the first `done` of the selected frames. The skipped frames still count
    /// otherwise: the first good frame of all determines the size of the others.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn open_at(
        scene: Arc<dyn Scene>,
        settings: &DatasetSettings,
        ground_truth: GroundTruth,
        done: usize,
    ) -> Result<Self, DatasetError> {
        let selected = settings.selected_frames(scene.frame_count())?;
        let mut job = ReadingJob::new(&scene, settings.framing(), ground_truth);
        let mut description = SceneDescription::of(scene.as_ref(), selected.len());
        let mut first = Vec::new();
        for index in &selected {
            let result = job.read(*index);
            match result {
                // Errors that affect all frames are reported once.
                Err(error) if error.source.affects_all_frames() => return Err(*error.source),
                Ok(streamed) => {
                    job.check_intrinsics(*index)?;
                    description.add_first_frame(
                        scene.as_ref(),
                        (streamed.index, &streamed.frame),
                        job.checks.original_size,
                    );
                    first.push(Ok(streamed));
                    break;
                }
                Err(_) => first.push(result),
            }
        }
        description.warn_of_reduction(settings);
        description.warn_of_left_out();
        if let Some(last) = done.checked_sub(1).and_then(|last| selected.get(last)) {
            job.unknown_from = last + 1;
        }
        job.selected = selected.clone();
        let rest: Vec<usize> = selected.iter().copied().skip(first.len().max(done)).collect();
        let first: Vec<FrameResult> = first.into_iter().skip(done).collect();
        let pending: Vec<usize> = selected.into_iter().skip(done).collect();
        let (sender, receiver) = sync_channel(waiting_frames(description.frame_size));
        let reader = std::thread::Builder::new()
            .name("frame reader".to_owned())
            .spawn(move || job.run(&rest, &sender))
            .map_err(|error| {
                let reason = format!("the thread that reads frames cannot be started: {error}");
                DatasetError::Io { path: scene.name().into(), source: std::io::Error::new(error.kind(), reason) }
            })?;
        Ok(Self {
            first: first.into_iter(),
            receiver: Some(receiver),
            reader: Some(reader),
            pending: pending.into_iter(),
            description,
            scene,
        })
    }

    /// Returns the size `(width, height)` of every frame; `None` if none of the selected frames can be read.
    pub fn frame_size(&self) -> Option<(usize, usize)> {
        self.description.frame_size
    }
}

/// Returns the number of frames of size `(width, height)` that may wait.
fn waiting_frames(size: Option<(usize, usize)>) -> usize {
    let bytes = size.map_or(1, |(width, height)| width.saturating_mul(height).saturating_mul(FRAME_BYTES_PER_PIXEL));
    (WAITING_BYTES / bytes.max(1)).min(WAITING_FRAMES)
}

impl Iterator for FrameStream {
    type Item = FrameResult;

    fn next(&mut self) -> Option<FrameResult> {
        let index = self.pending.next()?;
        if let Some(result) = self.first.next() {
            return Some(result);
        }
        match self.receiver.as_ref().map(Receiver::recv) {
            Some(Ok(result)) => Some(result),
            _ => {
                self.pending = Vec::new().into_iter();
                let source = Box::new(DatasetError::ReaderEnded { scene: self.scene.name().to_owned() });
                Some(Err(FrameReadError { index, name: self.scene.frame_name(index), source }))
            }
        }
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        self.pending.size_hint()
    }
}

impl ExactSizeIterator for FrameStream {}

impl FrameSource for FrameStream {
    fn frames_left(&self) -> Option<usize> {
        Some(self.len())
    }

    fn description(&self) -> &SceneDescription {
        &self.description
    }
}

impl Drop for FrameStream {
    fn drop(&mut self) {
        // Without a receiver the thread's next send fails, which ends it.
        self.receiver = None;
        if let Some(reader) = self.reader.take() {
            // A panic in the reader has been reported as `ReaderEnded`.
            let _ = reader.join();
        }
    }
}

/// State of the background thread.
struct ReadingJob {
    scene: Arc<dyn Scene>,
    checks: FrameChecks,
    ground_truth: GroundTruth,
    /// Indices of the selected frames, increasing.
    selected: Vec<usize>,
    /// The first frame whose corrections have not been returned.
    unknown_from: usize,
}

impl ReadingJob {
    fn new(scene: &Arc<dyn Scene>, framing: Framing, ground_truth: GroundTruth) -> Self {
        let checks = FrameChecks::new(framing);
        Self {
            scene: Arc::clone(scene),
            checks: if scene.has_depth() { checks } else { checks.without_depth() },
            ground_truth,
            selected: Vec::new(),
            unknown_from: 0,
        }
    }

    fn run(mut self, indices: &[usize], sender: &SyncSender<FrameResult>) {
        for index in indices {
            if sender.send(self.read(*index)).is_err() {
                return;
            }
        }
    }

    /// Checks the intrinsics of the first good frame, frame `index`.
    fn check_intrinsics(&self, index: usize) -> Result<(), DatasetError> {
        self.checks.check_intrinsics(&|part| self.scene.file_of(index, part))
    }

    fn read(&mut self, index: usize) -> FrameResult {
        self.try_read(index).map_err(|error| FrameReadError {
            index,
            name: self.scene.frame_name(index),
            source: Box::new(error),
        })
    }

    fn try_read(&mut self, index: usize) -> Result<StreamedFrame, DatasetError> {
        let recorded = self.scene.read_recorded(index)?;
        let size = self.checks.check_size(&recorded.frame, self.scene.name())?;
        let ground_truth = match self.ground_truth {
            GroundTruth::Read => self.scene.read_ground_truth(index)?,
            GroundTruth::Skip => None,
        };
        if let Some(labels) = ground_truth.as_ref().filter(|labels| labels.size() != size) {
            return Err(sizes_differ(&recorded.frame, "ground truth", labels.size(), size, "its frame"));
        }
        let ground_truth = ground_truth.map(|labels| self.checks.framing.apply_to_labels(labels));
        let scene = &self.scene;
        let (frame, world_from_camera) = self.checks.framed(recorded, &|part| scene.file_of(index, part))?;
        let ground_truth = ground_truth.transpose()?;
        let corrections = self.corrections(index);
        Ok(StreamedFrame { index, frame, world_from_camera, corrections, ground_truth })
    }

    /// Returns the corrections of selected frames that became known since the last good frame, up to frame `index`.
    fn corrections(&mut self, index: usize) -> Vec<CorrectedPose> {
        let mut corrections = self.scene.corrections(self.unknown_from..index + 1);
        corrections.retain(|correction| self.selected.binary_search(&correction.frame).is_ok());
        self.unknown_from = index + 1;
        corrections
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fewer_large_frames_wait() {
        assert_eq!(waiting_frames(Some((640, 480))), WAITING_FRAMES);
        assert_eq!(waiting_frames(Some((1920, 1080))), WAITING_FRAMES);
        assert_eq!(waiting_frames(Some((2560, 1440))), 1);
        assert_eq!(waiting_frames(Some((4096, 4096))), 0);
        assert_eq!(waiting_frames(Some((usize::MAX, 2))), 0);
        assert_eq!(waiting_frames(None), WAITING_FRAMES);
    }
}
