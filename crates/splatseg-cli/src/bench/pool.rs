//! Runs several jobs at a time, each on its own threads.

use super::plan::BenchJob;
use crate::Failure;
use crate::system_limits::no_thread;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// Numbers of concurrent jobs and threads.
#[derive(Clone, Copy, Debug)]
pub struct Workers {
    /// Number of jobs at a time.
    pub jobs: usize,
    /// Total number of threads of these jobs; 0: one per core.
    pub threads: usize,
}

impl Workers {
    /// Runs `work` on every job. Results are in the order of the jobs. A job that panics fails; the others continue.
    pub fn run<T: Send>(
        &self,
        jobs: &[BenchJob],
        work: impl Fn(&BenchJob) -> Result<T, String> + Sync,
    ) -> Result<Vec<Result<T, String>>, Failure> {
        let threads = match self.threads {
            0 => std::thread::available_parallelism().map_or(1, usize::from),
            threads => threads,
        };
        let workers = self.jobs.min(jobs.len()).max(1);
        let pools = (0..workers)
            .map(|_| rayon::ThreadPoolBuilder::new().num_threads((threads / workers).max(1)).build())
            .collect::<Result<Vec<_>, _>>()
            .map_err(Failure::runtime)?;
        let next = AtomicUsize::new(0);
        let results: Vec<Mutex<Option<Result<T, String>>>> = jobs.iter().map(|_| Mutex::new(None)).collect();
        std::thread::scope(|scope| {
            for pool in &pools {
                let work = || {
                    while let Some((job, place)) = {
                        let index = next.fetch_add(1, Ordering::Relaxed);
                        jobs.get(index).zip(results.get(index))
                    } {
                        let done = pool.install(|| catch_unwind(AssertUnwindSafe(|| work(job))));
                        let result = done.unwrap_or_else(|_| Err("the program panicked".to_owned()));
                        *place.lock().unwrap_or_else(PoisonError::into_inner) = Some(result);
                    }
                };
                let started = std::thread::Builder::new().spawn_scoped(scope, work);
                started.map_err(|error| no_thread("runs jobs", &error))?;
            }
            Ok(())
        })?;
        let taken = |place: Mutex<Option<_>>| place.into_inner().unwrap_or_else(PoisonError::into_inner);
        Ok(results.into_iter().map(|place| taken(place).unwrap_or_else(|| Err("was not run".to_owned()))).collect())
    }
}
