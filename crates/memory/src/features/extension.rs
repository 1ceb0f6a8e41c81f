//! Codes made before they are needed, on a thread of their own.

use super::codebook::CodebookCache;
use super::{Codebook, CodebookError};
use std::thread::JoinHandle;

/// A codebook that is being extended. The result is that of [`Codebook::extend`], whenever it is asked for: how far the
/// thread has come decides how long that takes and nothing else.
#[derive(Debug)]
pub(super) struct Extension {
    thread: JoinHandle<Result<Codebook, CodebookError>>,
}

impl Extension {
    /// Starts to add a block of codes, with as many threads as work on the frames: these are slower meanwhile, but the
    /// codes are there sooner. `None` if the system has no thread left.
    pub fn start(codebook: &Codebook, additional: usize, cache: &CodebookCache) -> Option<Self> {
        let (mut codebook, cache) = (codebook.clone(), cache.clone());
        // A pool of its own: a thread of the frames' pool could pick up all of this work while it waits for another.
        let pool = rayon::ThreadPoolBuilder::new().num_threads(rayon::current_num_threads()).build().ok()?;
        let extend = move || {
            let extended = pool.install(|| codebook.extend_cached(additional, &cache, &mut |_| {}));
            extended.map(|()| codebook)
        };
        let thread = std::thread::Builder::new().name("codebook".to_owned()).spawn(extend).ok()?;
        Some(Self { thread })
    }

    /// The extended codebook, for which it waits; `None` if the thread panicked.
    pub fn finish(self) -> Option<Result<Codebook, CodebookError>> {
        self.thread.join().ok()
    }

    /// Whether it need not be waited for.
    #[cfg(test)]
    pub fn is_finished(&self) -> bool {
        self.thread.is_finished()
    }
}
