//! The frame loop.

use super::{FrameResult, Pipeline, PipelineError, Segmented, in_thread_pool, process, segment};
use splatseg_geometry::RgbdFrame;
use splatseg_memory::SplatMemory;

/// An iterator over the results of a stream of frames.
///
/// The segmenter does not depend on the method, so segmenting ahead changes the time that results take and nothing
/// else.
pub struct Frames<'p, I: Iterator> {
    pipeline: &'p mut Pipeline,
    frames: I,
    next: Option<Next<I::Item>>,
}

/// A frame and its result.
#[derive(Debug)]
pub struct Processed<F> {
    /// The frame.
    pub frame: F,
    /// Its result. After [`PipelineError::Segmenter`] the stream can continue.
    pub result: Result<FrameResult, PipelineError>,
}

/// The next item of the stream, with masks if it was segmented ahead.
type Next<R> = (R, Option<Segmented>);

impl<'p, I: Iterator> Frames<'p, I> {
    pub(super) fn new(pipeline: &'p mut Pipeline, frames: I) -> Self {
        Self { pipeline, frames, next: None }
    }

    /// The splat memory after the latest frame, if the method has one.
    pub fn memory(&self) -> Option<&SplatMemory> {
        self.pipeline.memory()
    }
}

impl<I, F, E> Iterator for Frames<'_, I>
where
    I: Iterator<Item = Result<F, E>>,
    F: AsRef<RgbdFrame<'static>> + Sync,
    E: Sync,
{
    type Item = Result<Processed<F>, E>;

    fn next(&mut self) -> Option<Self::Item> {
        let Self { pipeline, frames, next } = self;
        let Pipeline { segmenter, method, segment_ahead, clock, objects } = &mut **pipeline;
        let (frame, segmented) = match next.take().or_else(|| Some((frames.next()?, None)))? {
            (Ok(frame), segmented) => (frame, segmented),
            (Err(error), _) => return Some(Err(error)),
        };
        // Read on this thread: a thread of the pool that waits for a frame could be the one that the frame waits for.
        let ahead = if *segment_ahead { frames.next() } else { None };
        let (result, segmented_ahead) = in_thread_pool(|| {
            let segmented = segmented.unwrap_or_else(|| segment(segmenter.as_mut(), frame.as_ref()));
            rayon::join(
                || process(method.as_mut(), clock, objects, frame.as_ref(), segmented),
                || Some(segment(segmenter.as_mut(), ahead.as_ref()?.as_ref().ok()?.as_ref())),
            )
        });
        *next = ahead.map(|frame| (frame, segmented_ahead));
        Some(Ok(Processed { frame, result }))
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        let ahead = usize::from(self.next.is_some());
        let (least, most) = self.frames.size_hint();
        (least + ahead, most.map(|most| most + ahead))
    }
}
