//! Generation of codes on a background thread before they are needed.

use super::codebook::CodebookCache;
use super::{Codebook, CodebookError};
use std::thread::JoinHandle;

/// A codebook that is being extended. The result equals that of [`Codebook::extend`]. The progress of the thread
/// affects only how long [`Self::finish`] takes.
#[derive(Debug)]
pub(super) struct Extension {
    thread: JoinHandle<Result<Codebook, CodebookError>>,
}

impl Extension {
    /// Starts to add a block of codes, with as many threads as process frames: frames are slower meanwhile, but the
    /// codes are ready sooner. Returns `None` if no thread can be started.
    pub fn start(codebook: &Codebook, additional: usize, cache: &CodebookCache) -> Option<Self> {
        let (mut codebook, cache) = (codebook.clone(), cache.clone());
        // A separate pool: a thread of the frames' pool could pick up all of this work while it waits for another task.
        let pool = rayon::ThreadPoolBuilder::new().num_threads(rayon::current_num_threads()).build().ok()?;
        let extend = move || {
            let extended = pool.install(|| codebook.extend_cached(additional, &cache, &mut |_| {}));
            extended.map(|()| codebook)
        };
        let thread = std::thread::Builder::new().name("codebook".to_owned()).spawn(extend).ok()?;
        Some(Self { thread })
    }

    /// Waits for the extended codebook; `None` if the thread panicked.
    pub fn finish(self) -> Option<Result<Codebook, CodebookError>> {
        self.thread.join().ok()
    }

    /// True if the thread has finished.
    #[cfg(test)]
    pub fn is_finished(&self) -> bool {
        self.thread.is_finished()
    }
}
