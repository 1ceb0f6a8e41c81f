//! Segmenting a frame while the method is at the one before.

use splatseg_dataset::{FrameReadError, FrameStream, StreamedFrame};
use splatseg_geometry::ScoredMask;
use splatseg_segmenter::{PreparedMasks, Segmenter, SegmenterError};
use splatseg_tracking::{FrameOutput, Method, TrackingError};
use std::time::{Duration, Instant};

/// A frame that a method has processed: itself, and its result.
pub type Processed = (StreamedFrame, Result<FrameOutput, TrackingError>);

/// The frames of a stream with their masks, made one frame ahead of the method.
///
/// A segmenter knows nothing of the method, so the result is the same as if it waited; only the time is not.
pub struct Lookahead {
    source: Source,
    prepared: PreparedMasks,
    /// Whether the segmenter runs beside the method, or after it.
    beside: bool,
    next: Option<Item>,
}

struct Source {
    stream: FrameStream,
    segmenter: Box<dyn Segmenter>,
}

/// A frame, with its masks and the time they took.
struct Segmented {
    frame: StreamedFrame,
    masks: Result<Vec<ScoredMask>, SegmenterError>,
    time: Duration,
}

type Item = Result<Box<Segmented>, FrameReadError>;

impl Lookahead {
    /// Frames of `stream` with masks of `segmenter`, which the method finds in `prepared`.
    pub fn new(stream: FrameStream, segmenter: Box<dyn Segmenter>, prepared: PreparedMasks, beside: bool) -> Self {
        Self { source: Source { stream, segmenter }, prepared, beside, next: None }
    }

    /// Frames that have not been processed.
    pub fn len(&self) -> usize {
        self.source.stream.len() + usize::from(self.next.is_some())
    }

    /// Has `method` process the next frame, and meanwhile segments the one after it. `Err` says why a frame cannot be
    /// used; `None`: there are no more.
    pub fn process_next(&mut self, method: &mut dyn Method) -> Option<Result<Processed, FrameReadError>> {
        let item = self.next.take().or_else(|| self.source.next())?;
        let segmented = match item {
            Ok(segmented) => *segmented,
            Err(error) => return Some(Err(error)),
        };
        let Segmented { frame, masks, time } = segmented;
        self.prepared.put(&frame.frame, masks);
        let mut output = if self.beside {
            let (output, next) = rayon::join(|| method.process(&frame.frame), || self.source.next());
            self.next = next;
            output
        } else {
            method.process(&frame.frame)
        };
        if let Ok(output) = &mut output {
            output.times.segment = time;
        }
        Some(Ok((frame, output)))
    }
}

impl Source {
    fn next(&mut self) -> Option<Item> {
        let read = self.stream.next()?;
        Some(read.map(|frame| {
            let started = Instant::now();
            let masks = self.segmenter.segment(&frame.frame);
            Box::new(Segmented { frame, masks, time: started.elapsed() })
        }))
    }
}
