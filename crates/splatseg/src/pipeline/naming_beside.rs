//! Naming beside the frames: a thread of its own names one object at a time, and takes no more than its share of the CPU.
//!
//! There is no queue. When the thread is free, it gets the object seen last of those that need a name, with its views as they
//! are then, so names are never about old views. The thread has the lowest priority, and a pool of threads of its own with
//! itself in it, so that no part of a frame waits for it. It rests while a frame is processed: even the lowest priority slows
//! the frames by several percent, since cores share caches and memory.

use super::background::{busy_time, lower_priority};
use super::frame_gate::{ClosedGate, FrameGate};
use super::kept_names::SharedNamer;
use crate::parts::{ObjectToName, Pacer};
use splatseg_geometry::SegmentId;
use splatseg_objects::{Object, ObjectName, ObjectView};
use std::error::Error;
use std::io;
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

/// Labels of all objects are chosen anew at most this often while there are objects to be named.
const LABELS_INTERVAL: Duration = Duration::from_secs(2);

/// An error of the namer.
type NamerError = Box<dyn Error + Send + Sync>;

/// Requests to the thread.
pub(super) enum Job {
    /// Name an object from its views, whose score together is the last number.
    Object(Box<Object>, Vec<(ObjectView, f64)>, f64),
    /// Choose labels for objects with these embeddings.
    Labels(Vec<(SegmentId, Vec<f32>)>),
}

/// Results of the thread.
pub(super) enum Named {
    /// The name of an object, and the score of the views that it is from.
    Object(SegmentId, ObjectName, f64),
    /// Labels of objects.
    Labels(Vec<(SegmentId, ObjectName)>),
}

/// The thread.
pub(super) struct NamingBeside {
    jobs: Sender<Job>,
    done: Receiver<(Result<Named, NamerError>, Duration)>,
    /// The present job.
    work: Option<Work>,
    /// When it may be given the next job.
    next: Instant,
    /// When labels were last asked for.
    labelled: Instant,
    /// Rest after each second of work, seconds.
    rest: f64,
    /// Closed while a frame is processed.
    gate: Arc<FrameGate>,
    /// Ends the thread, once the jobs have ended.
    _pool: rayon::ThreadPool,
}

/// The present job of the thread.
#[derive(Clone, Copy, PartialEq)]
enum Work {
    Object(SegmentId),
    /// The id has changed its meaning since.
    ForNothing,
    Labels,
}

impl NamingBeside {
    /// Starts the thread. `share` is how much of the time of all cores it may take, 0 to 1.
    ///
    /// # Errors
    /// If the system allows no more threads.
    pub(super) fn start(namer: SharedNamer, share: f64) -> io::Result<Self> {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(1)
            .thread_name(|_| "splatseg-names".to_owned())
            .start_handler(|_| lower_priority())
            // Without a handler, a namer that panics ends the program. `take` tells.
            .panic_handler(|_| {})
            .build()
            .map_err(io::Error::other)?;
        let (jobs, to_do) = channel::<Job>();
        let (send, done) = channel();
        let gate = Arc::new(FrameGate::default());
        let pacer = Arc::clone(&gate);
        pool.spawn(move || {
            for job in to_do {
                let started = busy_time();
                let named = carry_out(&namer, job, &*pacer);
                // The pipeline may be gone.
                if send.send((named, busy_time().saturating_sub(started))).is_err() {
                    break;
                }
            }
        });
        let cores = std::thread::available_parallelism().map_or(1, usize::from) as f64;
        let rest = (1.0 / (share * cores).max(1e-9) - 1.0).max(0.0);
        let now = Instant::now();
        Ok(Self { jobs, done, work: None, next: now, labelled: now, rest, gate, _pool: pool })
    }

    /// Lets the thread rest until the guard is dropped.
    pub(super) fn rest_during_frame(&self) -> ClosedGate {
        FrameGate::close(&self.gate)
    }

    /// Returns what the thread has done since the last call, if anything. With `wait`, it is waited for.
    pub(super) fn take(&mut self, wait: bool) -> Option<Result<Named, NamerError>> {
        let work = self.work?;
        let done = match wait {
            true => self.done.recv().map_err(|_| TryRecvError::Disconnected),
            false => self.done.try_recv(),
        };
        let (named, busy) = match done {
            Ok(done) => done,
            Err(TryRecvError::Empty) => return None,
            Err(TryRecvError::Disconnected) => (Err("the namer has panicked".into()), Duration::ZERO),
        };
        self.work = None;
        let rest = Duration::try_from_secs_f64(busy.as_secs_f64() * self.rest).unwrap_or(Duration::MAX);
        let now = Instant::now();
        self.next = now.checked_add(rest).unwrap_or(now);
        (work != Work::ForNothing || named.is_err()).then_some(named)
    }

    /// True if it may be given a job. It rests after each, unless the frames do.
    pub(super) fn is_free(&self, is_idle: bool) -> bool {
        self.work.is_none() && (is_idle || Instant::now() >= self.next)
    }

    /// True if labels were not asked for in the last seconds.
    pub(super) fn is_time_for_labels(&self) -> bool {
        self.labelled.elapsed() >= LABELS_INTERVAL
    }

    pub(super) fn give(&mut self, job: Job) {
        self.work = Some(match &job {
            Job::Object(object, ..) => Work::Object(object.id),
            Job::Labels(_) => {
                self.labelled = Instant::now();
                Work::Labels
            }
        });
        if self.jobs.send(job).is_err() {
            self.work = None;
        }
    }

    /// An id has another meaning from now on.
    pub(super) fn forget(&mut self, id: SegmentId) {
        if self.work == Some(Work::Object(id)) {
            self.work = Some(Work::ForNothing);
        }
    }
}

fn carry_out(namer: &SharedNamer, job: Job, pacer: &dyn Pacer) -> Result<Named, NamerError> {
    let mut namer = namer.lock().unwrap_or_else(PoisonError::into_inner);
    Ok(match job {
        Job::Object(object, views, score) => {
            let views: Vec<(&ObjectView, f64)> = views.iter().map(|(view, weight)| (view, *weight)).collect();
            let Some((view, _)) = views.first() else { return Err("no view".into()) };
            let name = namer.name_object_beside(ObjectToName { object: &object, view, views: &views }, pacer)?;
            Named::Object(object.id, name, score)
        }
        Job::Labels(objects) => {
            let objects: Vec<(SegmentId, &[f32])> =
                objects.iter().map(|(id, embedding)| (*id, embedding.as_slice())).collect();
            Named::Labels(namer.label_objects_beside(&objects, pacer)?)
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parts::Namer;
    use splatseg_geometry::Image;
    use std::sync::Mutex;
    use std::sync::atomic::{AtomicUsize, Ordering};

    /// A namer that works for some time.
    struct Busy(Duration);

    impl Namer for Busy {
        fn name(&self) -> &str {
            "busy"
        }

        fn name_object(&mut self, object: ObjectToName<'_>) -> Result<ObjectName, NamerError> {
            let started = busy_time();
            while busy_time() - started < self.0 {
                std::hint::spin_loop();
            }
            if object.object.id == 9 { Err("no words".into()) } else { Ok(ObjectName::by_hand("thing")) }
        }
    }

    /// A namer that takes many steps, and counts them.
    struct InSteps(Arc<AtomicUsize>);

    impl Namer for InSteps {
        fn name(&self) -> &str {
            "in steps"
        }

        fn name_object(&mut self, _: ObjectToName<'_>) -> Result<ObjectName, NamerError> {
            Ok(ObjectName::by_hand("thing"))
        }

        fn name_object_beside(
            &mut self,
            object: ObjectToName<'_>,
            pacer: &dyn Pacer,
        ) -> Result<ObjectName, NamerError> {
            for _ in 0..STEPS {
                pacer.before_step();
                self.0.fetch_add(1, Ordering::SeqCst);
            }
            self.name_object(object)
        }
    }

    const STEPS: usize = 1000;

    fn job(id: SegmentId) -> Job {
        let view = ObjectView { image: Image::filled(2, 2, [9; 3]), mask: Image::filled(2, 2, true) };
        Job::Object(Box::new(Object::unknown(id)), vec![(view, 1.0)], 4.0)
    }

    /// Jobs that are done in a time, if there is always another one.
    fn jobs_in(time: Duration, share: f64, is_idle: bool) -> u32 {
        let mut beside = NamingBeside::start(Arc::new(Mutex::new(Box::new(Busy(JOB)))), share).unwrap();
        let (started, mut done) = (Instant::now(), 0);
        while started.elapsed() < time {
            done += u32::from(beside.take(false).is_some());
            if beside.is_free(is_idle) {
                beside.give(job(1));
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        done
    }

    /// A namer with a fault.
    struct Panics;

    impl Namer for Panics {
        fn name(&self) -> &str {
            "panics"
        }

        fn name_object(&mut self, _: ObjectToName<'_>) -> Result<ObjectName, NamerError> {
            panic!("a fault of the namer")
        }
    }

    #[test]
    fn a_namer_that_panics_ends_the_naming_and_nothing_else() {
        let mut beside = NamingBeside::start(Arc::new(Mutex::new(Box::new(Panics))), 1.0).unwrap();
        beside.give(job(3));
        assert!(matches!(beside.take(true), Some(Err(error)) if error.to_string().contains("panicked")));
        assert!(beside.take(true).is_none());
    }

    const JOB: Duration = Duration::from_millis(10);

    #[test]
    fn the_share_of_the_cpu_is_kept_while_frames_come() {
        let cores = std::thread::available_parallelism().map_or(1, usize::from) as f64;
        let (time, share) = (Duration::from_secs(1), 0.05 / cores);
        let beside = jobs_in(time, share, false);
        // One twentieth of one core is 5 jobs of 10 ms in a second, besides the first.
        assert!((1..=7).contains(&beside), "{beside}");
        let idle = jobs_in(time, share, true);
        assert!(idle > beside, "{idle}, {beside}");
    }

    #[test]
    fn it_rests_while_a_frame_is_processed_and_goes_on_after_it() {
        let steps = Arc::new(AtomicUsize::new(0));
        let mut beside = NamingBeside::start(Arc::new(Mutex::new(Box::new(InSteps(Arc::clone(&steps))))), 1.0).unwrap();
        let frame = beside.rest_during_frame();
        beside.give(job(3));
        std::thread::sleep(10 * JOB);
        // Without any rest it would have ended long ago.
        let during = steps.load(Ordering::SeqCst);
        assert!(during < STEPS / 2 && beside.take(false).is_none(), "{during}");
        drop(frame);
        drop(beside.rest_during_frame());
        assert!(matches!(beside.take(true), Some(Ok(Named::Object(3, ..)))));
        assert_eq!(steps.load(Ordering::SeqCst), STEPS);
    }

    #[test]
    fn what_has_another_meaning_by_now_is_dropped_and_errors_are_not() {
        let mut beside = NamingBeside::start(Arc::new(Mutex::new(Box::new(Busy(JOB)))), 1.0).unwrap();
        assert!(beside.take(true).is_none(), "it has nothing to do");
        beside.give(job(3));
        assert!(!beside.is_free(true));
        assert!(matches!(beside.take(true), Some(Ok(Named::Object(3, name, 4.0))) if name.label.is_some()));
        beside.give(job(3));
        beside.forget(4);
        beside.forget(3);
        assert!(beside.take(true).is_none());
        beside.give(job(9));
        beside.forget(9);
        assert!(matches!(beside.take(true), Some(Err(error)) if error.to_string() == "no words"));
    }
}
