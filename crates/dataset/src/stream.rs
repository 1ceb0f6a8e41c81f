//! Frames of a scene, in order, read ahead in the background.

use crate::{DatasetError, DatasetSettings, FrameReadError, Framing, Scene};
use splatseg_geometry::{RgbdFrame, SegmentMap};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

/// Frames that wait in the channel.
const WAITING_FRAMES: usize = 2;

/// The most frames of a [`FrameStream`] in memory at once, however long the video: two that wait, one that is being
/// read and the one that the caller holds.
pub const MAX_FRAMES_IN_MEMORY: usize = WAITING_FRAMES + 2;

/// Whether a stream reads the true segments along with each frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GroundTruth {
    /// Read it where there is some.
    Read,
    /// Leave it.
    Skip,
}

/// One frame of a stream, resized and cropped as the settings say.
#[derive(Clone, Debug, PartialEq)]
pub struct StreamedFrame {
    /// Index of the frame in its scene.
    pub index: usize,
    /// The frame; its name is the scene's name for it.
    pub frame: RgbdFrame<'static>,
    /// The true segments, of the frame's size; `None` if there are none or they were not requested.
    pub ground_truth: Option<SegmentMap>,
}

impl AsRef<RgbdFrame<'static>> for StreamedFrame {
    fn as_ref(&self) -> &RgbdFrame<'static> {
        &self.frame
    }
}

/// What a stream gives for one frame: a frame, or why it cannot be used.
type FrameResult = Result<StreamedFrame, FrameReadError>;

/// An iterator over the frames that the settings select, in order. They are read ahead on a background thread, never
/// more than [`MAX_FRAMES_IN_MEMORY`]; dropping the stream stops the thread.
///
/// A frame that cannot be read, or whose size differs from that of the first good frame, is an `Err`, and the stream
/// goes on with the next.
#[derive(Debug)]
pub struct FrameStream {
    /// What was read to find the first good frame.
    first: std::vec::IntoIter<FrameResult>,
    receiver: Option<Receiver<FrameResult>>,
    reader: Option<JoinHandle<()>>,
    /// Frames not given yet.
    pending: std::vec::IntoIter<usize>,
    frame_size: Option<(usize, usize)>,
    scene: Arc<dyn Scene>,
}

impl FrameStream {
    /// Starts to read the selected frames of a scene. Reads up to the first good frame at once, to check the crop.
    ///
    /// # Errors
    /// [`DatasetError::Setting`] if the settings are invalid, select no frame, or crop everything away.
    pub fn open(
        scene: Arc<dyn Scene>,
        settings: &DatasetSettings,
        ground_truth: GroundTruth,
    ) -> Result<Self, DatasetError> {
        let selected = settings.selected_frames(scene.frame_count())?;
        let mut job =
            ReadingJob { scene: Arc::clone(&scene), framing: settings.framing(), ground_truth, original_size: None };
        let mut first = Vec::new();
        let mut frame_size = None;
        for index in &selected {
            let result = job.read(*index);
            if let Err(FrameReadError { source, .. }) = &result
                && let DatasetError::Setting(error) = source.as_ref()
            {
                return Err(error.clone().into());
            }
            frame_size = result.as_ref().ok().map(|streamed| (streamed.frame.width(), streamed.frame.height()));
            first.push(result);
            if frame_size.is_some() {
                break;
            }
        }
        let rest: Vec<usize> = selected[first.len()..].to_vec();
        let (sender, receiver) = sync_channel(WAITING_FRAMES);
        let reader = std::thread::Builder::new()
            .name("frame reader".to_owned())
            .spawn(move || job.run(&rest, &sender))
            .map_err(|source| DatasetError::Io { path: scene.name().into(), source })?;
        Ok(Self {
            first: first.into_iter(),
            receiver: Some(receiver),
            reader: Some(reader),
            pending: selected.into_iter(),
            frame_size,
            scene,
        })
    }

    /// The size `(width, height)` of every frame; `None` if none of the selected frames can be read.
    pub fn frame_size(&self) -> Option<(usize, usize)> {
        self.frame_size
    }
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

/// What the background thread works on.
struct ReadingJob {
    scene: Arc<dyn Scene>,
    framing: Framing,
    ground_truth: GroundTruth,
    /// Size of the first good frame, before framing.
    original_size: Option<(usize, usize)>,
}

impl ReadingJob {
    fn run(mut self, indices: &[usize], sender: &SyncSender<FrameResult>) {
        for index in indices {
            if sender.send(self.read(*index)).is_err() {
                return;
            }
        }
    }

    fn read(&mut self, index: usize) -> FrameResult {
        self.try_read(index).map_err(|error| FrameReadError {
            index,
            name: self.scene.frame_name(index),
            source: Box::new(error),
        })
    }

    fn try_read(&mut self, index: usize) -> Result<StreamedFrame, DatasetError> {
        let frame = self.scene.read_frame(index)?;
        let size = (frame.width(), frame.height());
        if let Some(expected) = self.original_size.filter(|expected| *expected != size) {
            return Err(DatasetError::SizesDiffer {
                path: frame.name().into(),
                what: "frame",
                found: size,
                expected,
                expected_from: "the first frame",
            });
        }
        let ground_truth = match self.ground_truth {
            GroundTruth::Read => self.scene.read_ground_truth(index)?,
            GroundTruth::Skip => None,
        };
        if let Some(labels) = ground_truth.as_ref().filter(|labels| labels.size() != size) {
            return Err(DatasetError::SizesDiffer {
                path: frame.name().into(),
                what: "ground truth",
                found: labels.size(),
                expected: size,
                expected_from: "its frame",
            });
        }
        let ground_truth = ground_truth.map(|labels| self.framing.apply_to_labels(labels)).transpose()?;
        let frame = self.framing.apply(frame)?;
        self.original_size = Some(size);
        Ok(StreamedFrame { index, frame, ground_truth })
    }
}
