//! Times each stage of a frame, from the [`tracing`] spans that methods and memory open.
//!
//! A stage is a span with the target `splatseg::stage`, named after the span. The time of a nested stage is not counted
//! for the stage around it. The program's own subscriber still receives every span and event.

use splatseg_geometry::STAGE_TARGET;
use std::collections::HashMap;
use std::ops::AddAssign;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tracing::span::{Attributes, Id, Record};
use tracing::{Dispatch, Event, Metadata, Subscriber, dispatcher};

/// The stages of this project's methods, in order.
const STAGES: [&str; 10] =
    ["segment", "track", "project_and_bin", "rasterise", "decode", "match", "reprompt", "fuse", "grow", "learn"];

/// Wall-clock time of each stage of one frame, or summed over frames.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StageTimes {
    stages: Vec<(&'static str, Duration)>,
}

impl Default for StageTimes {
    fn default() -> Self {
        Self { stages: STAGES.map(|name| (name, Duration::ZERO)).to_vec() }
    }
}

impl StageTimes {
    /// Name and time of each stage. Stages of methods defined elsewhere come last.
    pub fn stages(&self) -> &[(&'static str, Duration)] {
        &self.stages
    }

    /// Total time of all stages except the segmenter. A tracker's stages are included.
    pub fn without_segmenter(&self) -> Duration {
        self.stages.iter().filter(|(name, _)| *name != "segment").map(|(_, time)| *time).sum()
    }

    /// Adds time to a stage.
    pub(super) fn add(&mut self, stage: &'static str, time: Duration) {
        match self.stages.iter_mut().find(|(name, _)| *name == stage) {
            Some((_, sum)) => *sum += time,
            None => self.stages.push((stage, time)),
        }
    }
}

impl AddAssign<&StageTimes> for StageTimes {
    fn add_assign(&mut self, other: &Self) {
        other.stages.iter().for_each(|(stage, time)| self.add(stage, *time));
    }
}

/// Measures the time of each stage.
pub(super) struct StageClock {
    dispatch: Dispatch,
    recording: Arc<Mutex<Recording>>,
}

impl StageClock {
    /// Creates a clock. The program's own subscriber still receives every span and event.
    pub(super) fn new() -> Self {
        let recording = Arc::new(Mutex::new(Recording::default()));
        let outer = dispatcher::get_default(Clone::clone);
        let dispatch = Dispatch::new(StageSubscriber { outer, recording: Arc::clone(&recording) });
        Self { dispatch, recording }
    }

    /// Calls `work`. Returns its result and the time of each stage in it.
    pub(super) fn time<T>(&self, work: impl FnOnce() -> T) -> (T, StageTimes) {
        *locked(&self.recording) = Recording::default();
        let result = dispatcher::with_default(&self.dispatch, work);
        (result, std::mem::take(&mut *locked(&self.recording)).times)
    }
}

/// The stages of a frame so far.
#[derive(Default)]
struct Recording {
    times: StageTimes,
    spans: HashMap<u64, Stage>,
    /// Running stages, innermost last: id, start, and total time of nested stages.
    running: Vec<(u64, Instant, Duration)>,
    last_id: u64,
}

/// A span that is a stage.
struct Stage {
    name: &'static str,
    /// The span in the program's own subscriber, if stages are enabled there.
    outer: Option<Id>,
}

/// Set in the ids of stages, so that they differ from ids of the program's own subscriber.
const STAGE_BIT: u64 = 1 << 63;

/// Records stages, and forwards everything to the program's own subscriber.
struct StageSubscriber {
    outer: Dispatch,
    recording: Arc<Mutex<Recording>>,
}

fn locked(recording: &Mutex<Recording>) -> MutexGuard<'_, Recording> {
    recording.lock().unwrap_or_else(PoisonError::into_inner)
}

fn is_stage(id: &Id) -> bool {
    id.into_u64() & STAGE_BIT != 0
}

impl StageSubscriber {
    /// Returns the span in the program's own subscriber.
    fn outer_id(&self, id: &Id) -> Option<Id> {
        if !is_stage(id) {
            return Some(id.clone());
        }
        locked(&self.recording).spans.get(&id.into_u64()).and_then(|stage| stage.outer.clone())
    }
}

impl Subscriber for StageSubscriber {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        metadata.target() == STAGE_TARGET || self.outer.enabled(metadata)
    }

    fn new_span(&self, span: &Attributes<'_>) -> Id {
        let metadata = span.metadata();
        if metadata.target() != STAGE_TARGET {
            return self.outer.new_span(span);
        }
        let outer = self.outer.enabled(metadata).then(|| self.outer.new_span(span));
        let mut recording = locked(&self.recording);
        recording.last_id += 1;
        let id = recording.last_id | STAGE_BIT;
        recording.spans.insert(id, Stage { name: metadata.name(), outer });
        Id::from_u64(id)
    }

    fn record(&self, span: &Id, values: &Record<'_>) {
        if let Some(outer) = self.outer_id(span) {
            self.outer.record(&outer, values);
        }
    }

    fn record_follows_from(&self, span: &Id, follows: &Id) {
        if let (Some(span), Some(follows)) = (self.outer_id(span), self.outer_id(follows)) {
            self.outer.record_follows_from(&span, &follows);
        }
    }

    fn event(&self, event: &Event<'_>) {
        self.outer.event(event);
    }

    fn enter(&self, span: &Id) {
        if let Some(outer) = self.outer_id(span) {
            self.outer.enter(&outer);
        }
        if is_stage(span) {
            locked(&self.recording).running.push((span.into_u64(), Instant::now(), Duration::ZERO));
        }
    }

    fn exit(&self, span: &Id) {
        if is_stage(span) {
            locked(&self.recording).end(span.into_u64());
        }
        if let Some(outer) = self.outer_id(span) {
            self.outer.exit(&outer);
        }
    }

    fn try_close(&self, span: Id) -> bool {
        let outer = self.outer_id(&span);
        if is_stage(&span) {
            locked(&self.recording).spans.remove(&span.into_u64());
        }
        outer.is_none_or(|outer| self.outer.try_close(outer))
    }
}

impl Recording {
    /// Ends a stage. Spans are entered with guards, so the innermost stage ends first.
    fn end(&mut self, id: u64) {
        let Some((_, started, inside)) = self.running.pop_if(|(running, _, _)| *running == id) else { return };
        let time = started.elapsed();
        if let Some((_, _, inside)) = self.running.last_mut() {
            *inside += time;
        }
        if let Some(stage) = self.spans.get(&id) {
            self.times.add(stage.name, time.saturating_sub(inside));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wait() {
        std::thread::sleep(Duration::from_millis(4));
    }

    #[test]
    fn each_stage_has_its_own_time() {
        let clock = StageClock::new();
        let ((), times) = clock.time(|| {
            let outer = tracing::debug_span!(target: STAGE_TARGET, "decode").entered();
            wait();
            let inner = tracing::debug_span!(target: STAGE_TARGET, "rasterise").entered();
            wait();
            wait();
            drop(inner);
            drop(outer);
            let _other = tracing::debug_span!("decode").entered();
            wait();
        });
        let of = |stage| times.stages().iter().find(|(name, _)| *name == stage).unwrap().1;
        assert!(of("decode") >= Duration::from_millis(4) && of("rasterise") >= Duration::from_millis(8));
        assert!(times.without_segmenter() < Duration::from_millis(100));
        assert_eq!(of("match"), Duration::ZERO);
        let ((), nothing) = clock.time(|| {});
        assert_eq!(nothing, StageTimes::default());
    }

    #[test]
    fn the_programs_own_subscriber_still_receives_everything() {
        #[derive(Clone, Default)]
        struct Seen(Arc<Mutex<Vec<String>>>);
        impl Subscriber for Seen {
            fn enabled(&self, _: &Metadata<'_>) -> bool {
                true
            }
            fn new_span(&self, span: &Attributes<'_>) -> Id {
                let mut seen = self.0.lock().unwrap();
                seen.push(span.metadata().name().to_owned());
                Id::from_u64(seen.len() as u64)
            }
            fn record(&self, _: &Id, _: &Record<'_>) {}
            fn record_follows_from(&self, _: &Id, _: &Id) {}
            fn event(&self, event: &Event<'_>) {
                self.0.lock().unwrap().push(event.metadata().level().to_string());
            }
            fn enter(&self, span: &Id) {
                self.0.lock().unwrap().push(format!("enter {}", span.into_u64()));
            }
            fn exit(&self, _: &Id) {}
        }
        let seen = Seen::default();
        tracing::subscriber::with_default(seen.clone(), || {
            StageClock::new().time(|| {
                let _stage = tracing::debug_span!(target: STAGE_TARGET, "fuse").entered();
                tracing::warn!("a warning");
            });
        });
        assert_eq!(*seen.0.lock().unwrap(), ["fuse", "enter 1", "WARN"]);
    }
}
