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

/// The next item of the stream, with masks if it is a frame.
type Next<R> = (R, Option<Segmented>);

impl<'p, I, F, E> Frames<'p, I>
where
    I: Iterator<Item = Result<F, E>>,
    F: AsRef<RgbdFrame<'static>> + Sync,
{
    fn read_and_segment(
        frames: &mut I,
        segmenter: &mut Box<dyn splatseg_segmenter::Segmenter>,
    ) -> Option<Next<I::Item>> {
        let frame = frames.next()?;
        let segmented = match &frame {
            Ok(frame) => Some(in_thread_pool(|| segment(segmenter.as_mut(), frame.as_ref()))),
            Err(_) => None,
        };
        Some((frame, segmented))
    }
}

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
    I: Iterator<Item = Result<F, E>> + Send,
    F: AsRef<RgbdFrame<'static>> + Send + Sync,
    E: Send,
{
    type Item = Result<Processed<F>, E>;

    fn next(&mut self) -> Option<Self::Item> {
        let Self { pipeline, frames, next } = self;
        let Pipeline { segmenter, method, segment_ahead, clock, objects } = &mut **pipeline;
        let (frame, segmented) = next.take().or_else(|| Self::read_and_segment(frames, segmenter))?;
        let (frame, segmented) = match (frame, segmented) {
            (Ok(frame), Some(segmented)) => (frame, segmented),
            (Ok(_), None) => return None,
            (Err(error), _) => return Some(Err(error)),
        };
        let process = || process(method.as_mut(), clock, objects, frame.as_ref(), segmented);
        let result = if *segment_ahead {
            let (result, ahead) = rayon::join(process, || Self::read_and_segment(frames, segmenter));
            *next = ahead;
            result
        } else {
            in_thread_pool(process)
        };
        Some(Ok(Processed { frame, result }))
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        let ahead = usize::from(self.next.is_some());
        let (least, most) = self.frames.size_hint();
        (least + ahead, most.map(|most| most + ahead))
    }
}
