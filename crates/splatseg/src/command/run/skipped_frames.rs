//! Frames that cannot be used: each kind of reason is reported once, and how often it came at the end.

use super::super::terminal::counted;
use crate::pipeline::PipelineError;
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
    /// The frame could not be read; what of it, and what is wrong with its pose.
    Unread(Discriminant<DatasetError>, Option<&'static str>, Option<Discriminant<PoseError>>),
    /// The segmenter failed.
    Unsegmented(Option<Discriminant<SegmenterError>>),
}

impl SkippedFrames {
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

    /// How many frames were skipped for each kind of reason that more than one frame had.
    pub fn messages(&self) -> impl Iterator<Item = String> {
        self.kinds.iter().filter(|kind| kind.frames > 1).map(|kind| {
            let more = counted(kind.frames - 1, "more frame");
            format!("{more} skipped for the same kind of reason as this one: {}", kind.first)
        })
    }
}

/// What could not be read, where errors of one variant tell that.
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
