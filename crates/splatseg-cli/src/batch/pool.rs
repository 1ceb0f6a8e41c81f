//! Worker processes on this machine.

use super::plan::{BatchJob, Plan};
use super::tables::FailedScene;
use super::worker::Answer;
use crate::Failure;
use crate::run::StopSignals;
use crate::system_limits::no_thread;
use std::collections::VecDeque;
use std::ffi::OsString;
use std::fs::File;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::Builder;
use std::time::{Duration, Instant};

/// Interval between checks for signals.
const POLL: Duration = Duration::from_millis(100);
/// Time between two progress lines.
const BETWEEN_LINES: Duration = Duration::from_secs(10);

/// Workers that share the jobs of a plan.
pub struct Pool<'a> {
    /// Start of a command line that runs this program.
    pub program: &'a [OsString],
    /// The jobs.
    pub plan: &'a Plan,
    /// Signals that stop the batch.
    pub signals: &'a StopSignals,
}

/// State shared by the workers.
struct Shared {
    /// Waiting jobs, and the number of failed attempts.
    waiting: VecDeque<(BatchJob, usize)>,
    running: usize,
    done: usize,
    frames: usize,
    failed: Vec<FailedScene>,
    /// Running processes.
    children: Vec<Option<Child>>,
    stopped: bool,
}

/// A worker process.
struct Worker {
    input: ChildStdin,
    output: BufReader<ChildStdout>,
}

impl Pool<'_> {
    /// Runs all jobs. Returns the failed ones, in the order of the plan.
    ///
    /// # Errors
    /// If a worker cannot be started, or a signal ended the batch. Finished scenes stay done.
    pub fn run(&self) -> Result<Vec<FailedScene>, Failure> {
        let workers = self.plan.workers.min(self.plan.jobs.len());
        let shared = Mutex::new(Shared {
            waiting: self.plan.jobs.iter().map(|job| (job.clone(), 0)).collect(),
            running: 0,
            done: 0,
            frames: 0,
            failed: Vec::new(),
            children: (0..workers).map(|_| None).collect(),
            stopped: false,
        });
        let ended = std::thread::scope(|scope| {
            let shared = &shared;
            let start = |place| {
                let started = Builder::new().spawn_scoped(scope, move || self.work(place, shared));
                started.map_err(|error| {
                    lock(shared).waiting.clear();
                    no_thread("starts a worker", &error)
                })
            };
            let threads = (0..workers).map(start).collect::<Result<Vec<_>, _>>()?;
            self.watch(shared, || threads.iter().all(std::thread::ScopedJoinHandle::is_finished));
            threads
                .into_iter()
                .try_for_each(|thread| thread.join().unwrap_or_else(|_| Err(Failure::runtime("a thread failed"))))
        });
        let shared = shared.into_inner().unwrap_or_else(PoisonError::into_inner);
        if let Some(signal) = self.signals.received() {
            let text =
                format!("interrupted by {} after {} of {} scenes", signal.name, shared.done, self.plan.jobs.len());
            let text = format!("{text}; run the same command again to process the others");
            return Err(Failure::Interrupted { code: signal.exit_code(), text });
        }
        ended?;
        let place = |failed: &FailedScene| self.plan.scenes.iter().position(|job| job.scene == failed.scene);
        let mut failed = shared.failed;
        failed.sort_by_key(place);
        Ok(failed)
    }

    /// Prints the progress, and ends the batch if a signal is received.
    fn watch(&self, shared: &Mutex<Shared>, is_over: impl Fn() -> bool) {
        let (started, mut latest) = (Instant::now(), Instant::now());
        while !is_over() {
            std::thread::sleep(POLL);
            if self.signals.received().is_some() {
                let mut shared = lock(shared);
                shared.stopped = true;
                shared.waiting.clear();
                // Unfinished scenes have no row, so the next start processes them again.
                shared.children.iter_mut().flatten().for_each(|child| _ = child.kill());
            }
            if latest.elapsed() >= BETWEEN_LINES {
                latest = Instant::now();
                inform!("{}", lock(shared).progress(self.plan.jobs.len(), started.elapsed()));
            }
        }
    }

    /// Processes jobs until there are no more.
    fn work(&self, place: usize, shared: &Mutex<Shared>) -> Result<(), Failure> {
        let mut worker = None;
        loop {
            let Some((job, tries)) = lock(shared).take() else {
                // Another worker's job may still be queued again.
                if lock(shared).running == 0 {
                    return Ok(());
                }
                std::thread::sleep(POLL);
                continue;
            };
            let answer = self.answer(place, &mut worker, &job, shared);
            let mut shared = lock(shared);
            shared.running -= 1;
            match answer {
                Ok(Answer { error: None, frames }) => {
                    shared.done += 1;
                    shared.frames += frames;
                }
                Ok(Answer { error: Some(error), .. }) => {
                    shared.failed.push(FailedScene { scene: job.scene, error });
                }
                Err(_) if shared.stopped => return Ok(()),
                Err(Lost::Start(failure)) => {
                    shared.waiting.clear();
                    return Err(failure);
                }
                Err(Lost::Killed) if tries < self.plan.retries => shared.waiting.push_back((job, tries + 1)),
                Err(Lost::Killed) => {
                    let error = format!("the process that worked on it was killed, {} times", tries + 1);
                    shared.failed.push(FailedScene { scene: job.scene, error });
                }
            }
        }
    }

    /// Sends a job to the worker, starting one if there is none, and waits for the answer.
    fn answer(
        &self,
        place: usize,
        worker: &mut Option<Worker>,
        job: &BatchJob,
        shared: &Mutex<Shared>,
    ) -> Result<Answer, Lost> {
        if worker.is_none() {
            *worker = Some(self.start(place, job, shared).map_err(Lost::Start)?);
        }
        let answered = worker.as_mut().and_then(|worker| worker.answer(job));
        answered.ok_or_else(|| {
            *worker = None;
            if let Some(mut child) = lock(shared).children.get_mut(place).and_then(Option::take) {
                let _ = child.kill();
                let _ = child.wait();
            }
            Lost::Killed
        })
    }

    fn start(&self, place: usize, job: &BatchJob, shared: &Mutex<Shared>) -> Result<Worker, Failure> {
        let (first, rest) = self.program.split_first().ok_or_else(|| Failure::runtime("the program has no path"))?;
        let failed = |error: std::io::Error| Failure::runtime(format!("a worker cannot be started: {error}"));
        let out = Path::new(&job.row).parent().and_then(Path::parent).unwrap_or(Path::new("."));
        let log = File::create(out.join(format!("worker-{place}.log"))).map_err(failed)?;
        let mut command = Command::new(first);
        command.args(rest).arg("batch-worker").stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(log);
        #[cfg(unix)]
        {
            // Ctrl-C reaches only the batch process, which then ends its workers.
            use std::os::unix::process::CommandExt;
            command.process_group(0);
        }
        let mut child = command.spawn().map_err(failed)?;
        let missing = || Failure::runtime("a worker has no pipes");
        let input = child.stdin.take().ok_or_else(missing)?;
        let output = BufReader::new(child.stdout.take().ok_or_else(missing)?);
        if let Some(slot) = lock(shared).children.get_mut(place) {
            *slot = Some(child);
        }
        Ok(Worker { input, output })
    }
}

/// Reason why a worker gave no answer.
enum Lost {
    /// The worker could not be started.
    Start(Failure),
    /// The worker ended.
    Killed,
}

impl Shared {
    fn take(&mut self) -> Option<(BatchJob, usize)> {
        let job = self.waiting.pop_front();
        self.running += usize::from(job.is_some());
        job
    }

    fn progress(&self, jobs: usize, elapsed: Duration) -> String {
        let Self { running, done, frames, failed, .. } = self;
        let ended = done + failed.len();
        let left = match ended {
            0 => String::new(),
            _ => {
                let seconds = elapsed.as_secs_f64() * (jobs - ended) as f64 / ended as f64;
                format!(", about {:.0} min left", (seconds / 60.0).ceil())
            }
        };
        let rate = *frames as f64 / elapsed.as_secs_f64().max(1e-3);
        format!("{done} of {jobs} scenes done, {running} running, {} failed; {rate:.1} frames/s{left}", failed.len())
    }
}

impl Worker {
    /// Sends a job and returns the worker's answer, or `None` if it has ended.
    fn answer(&mut self, job: &BatchJob) -> Option<Answer> {
        let text = serde_json::to_string(job).ok()?;
        writeln!(self.input, "{text}").and_then(|()| self.input.flush()).ok()?;
        let mut line = String::new();
        self.output.read_line(&mut line).ok()?;
        serde_json::from_str(&line).ok()
    }
}

fn lock(shared: &Mutex<Shared>) -> MutexGuard<'_, Shared> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}
