//! Threads beside the frames: their priority, and the time that they use.

use std::time::Duration;
#[cfg(not(target_os = "linux"))]
use std::time::Instant;

/// Lets all other threads go first.
pub(super) fn lower_priority() {
    #[cfg(target_os = "linux")]
    if let Err(error) = rustix::process::setpriority_process(Some(rustix::thread::gettid()), 19) {
        tracing::debug!("a thread beside the frames keeps its priority: {error}");
    }
}

/// Time that this thread has used: of the CPU where that is known, otherwise by the clock.
pub(super) fn busy_time() -> Duration {
    #[cfg(target_os = "linux")]
    {
        let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
        let seconds = u64::try_from(time.tv_sec).unwrap_or(0);
        Duration::new(seconds, u32::try_from(time.tv_nsec).unwrap_or(0))
    }
    #[cfg(not(target_os = "linux"))]
    {
        static START: std::sync::OnceLock<Instant> = std::sync::OnceLock::new();
        START.get_or_init(Instant::now).elapsed()
    }
}
