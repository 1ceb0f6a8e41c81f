//! Frames that cannot be used. Each kind of reason is reported once, with its total count at the end.

use super::super::terminal::counted;
use splatseg::pipeline::{PipelineError, UnusableFrame};
use splatseg_dataset::{DatasetError, FrameReadError};
use splatseg_geometry::PoseError;
use splatseg_segmenter::SegmenterError;
use std::mem::{Discriminant, discriminant};

/// The frames of a run that were skipped.
#[derive(Debug, Default)]
pub struct SkippedFrames {
    kinds: Vec<Kind>,
}

/// Frames that were skipped for the same kind of reason.
#[derive(Debug)]
struct Kind {
    reason: Reason,
    /// The first frame's message.
    first: String,
    frames: usize,
}

/// A kind of reason.
#[derive(Debug, PartialEq, Eq)]
enum Reason {
    /// The frame could not be read: kind of error, part of the frame, and kind of pose error.
    Unread(Discriminant<DatasetError>, Option<&'static str>, Option<Discriminant<PoseError>>),
    /// The frame's pose could not be determined.
    Unposed,
    /// The segmenter failed.
    Unsegmented(Option<Discriminant<SegmenterError>>),
}

impl SkippedFrames {
    /// Counts a frame that did not reach the method. Returns its message if it is the first of its kind.
    pub fn add_unusable(&mut self, error: &UnusableFrame) -> Option<String> {
        match error {
            UnusableFrame::Read(error) => self.add_unread(error),
            error => self.add(Reason::Unposed, error.to_string()),
        }
    }

    /// Counts a frame that could not be read. Returns its message if it is the first of its kind.
    pub fn add_unread(&mut self, error: &FrameReadError) -> Option<String> {
        let pose = match error.source.as_ref() {
            DatasetError::Pose { source, .. } => Some(discriminant(source)),
            _ => None,
        };
        let reason = Reason::Unread(discriminant(error.source.as_ref()), what(&error.source), pose);
        self.add(reason, error.to_string())
    }

    /// Counts a frame that the segmenter failed on. Returns its message if it is the first of its kind.
    pub fn add_unsegmented(&mut self, error: &PipelineError) -> Option<String> {
        let kind = match error {
            PipelineError::Segmenter { source, .. } => Some(discriminant(source.as_ref())),
            _ => None,
        };
        self.add(Reason::Unsegmented(kind), error.to_string())
    }

    fn add(&mut self, reason: Reason, message: String) -> Option<String> {
        if let Some(kind) = self.kinds.iter_mut().find(|kind| kind.reason == reason) {
            kind.frames += 1;
            return None;
        }
        self.kinds.push(Kind { reason, first: message.clone(), frames: 1 });
        Some(message)
    }

    /// Messages with the number of skipped frames, for each kind of reason that occurred more than once.
    pub fn messages(&self) -> impl Iterator<Item = String> {
        self.kinds.iter().filter(|kind| kind.frames > 1).map(|kind| {
            let more = counted(kind.frames - 1, "more frame");
            format!("{more} skipped for the same kind of reason as the first: {}", kind.first)
        })
    }
}

/// Returns the part of the frame that could not be read, for errors that contain it.
fn what(error: &DatasetError) -> Option<&'static str> {
    match error {
        DatasetError::MissingFile { what, .. }
        | DatasetError::Image { what, .. }
        | DatasetError::CutOff { what, .. }
        | DatasetError::ImplausibleSize { what, .. }
        | DatasetError::PixelKind { what, .. }
        | DatasetError::SizesDiffer { what, .. }
        | DatasetError::Text { what, .. } => Some(what),
        _ => None,
    }
}
