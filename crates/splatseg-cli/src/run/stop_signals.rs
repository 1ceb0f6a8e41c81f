//! Signals (Ctrl-C, `kill`, a closed terminal) that end a run after the current frame.

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;
use std::io::Result;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// A signal that requests the program's end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StopSignal {
    /// Its usual name.
    pub name: &'static str,
    number: i32,
}

/// The stop signals of this system.
const STOP_SIGNALS: &[StopSignal] = &[
    StopSignal { name: "SIGINT", number: SIGINT },
    StopSignal { name: "SIGTERM", number: SIGTERM },
    #[cfg(unix)]
    StopSignal { name: "SIGHUP", number: signal_hook::consts::SIGHUP },
];

/// Maximum time from a signal to the message about it.
const POLL: Duration = Duration::from_millis(50);

impl StopSignal {
    /// The exit code that shells report for a program ended by the signal.
    pub fn exit_code(self) -> u8 {
        u8::try_from(128 + self.number).unwrap_or(u8::MAX)
    }
}

/// Listens for signals.
#[derive(Clone, Debug)]
pub struct StopSignals {
    /// Number of the latest signal, or 0.
    received: Arc<AtomicUsize>,
    announced: Arc<AtomicBool>,
}

impl StopSignals {
    /// Starts listening. The first signal is recorded and announced. A second one ends the program at once. Ignored
    /// signals, such as SIGHUP under `nohup`, stay ignored.
    ///
    /// A process listens only once: later calls return the same signals.
    pub fn listen() -> Result<Self> {
        static LISTENING: Mutex<Option<StopSignals>> = Mutex::new(None);
        let mut listening = LISTENING.lock().unwrap_or_else(PoisonError::into_inner);
        match &*listening {
            Some(signals) => Ok(signals.clone()),
            None => Ok(listening.insert(Self::start()?).clone()),
        }
    }

    fn start() -> Result<Self> {
        let received = Arc::new(AtomicUsize::new(0));
        let again = Arc::new(AtomicBool::new(false));
        for signal in STOP_SIGNALS.iter().filter(|signal| !is_ignored(signal.number)) {
            // In this order, so that the first signal does not see the flag that it sets itself.
            flag::register_conditional_shutdown(signal.number, i32::from(signal.exit_code()), Arc::clone(&again))?;
            flag::register(signal.number, Arc::clone(&again))?;
            flag::register_usize(signal.number, Arc::clone(&received), signal.number as usize)?;
        }
        let signals = Self { received, announced: Arc::default() };
        let listening = signals.clone();
        // A thread prints the message at once, instead of after the frame.
        let announce = move || {
            while listening.received().is_none() {
                std::thread::sleep(POLL);
            }
        };
        std::thread::Builder::new().name("stop signals".to_owned()).spawn(announce)?;
        Ok(signals)
    }

    /// Returns the received signal, if any. The first call that finds one announces it.
    pub fn received(&self) -> Option<StopSignal> {
        let number = self.received.load(Ordering::SeqCst);
        let signal = STOP_SIGNALS.iter().find(|signal| signal.number as usize == number).copied()?;
        if !self.announced.swap(true, Ordering::SeqCst) {
            say_error!("{}: stopping after this frame; again to end at once", signal.name);
        }
        Some(signal)
    }
}

/// Returns true if the program was started with this signal ignored. Known on Linux only.
fn is_ignored(signal: i32) -> bool {
    let ignored = || {
        let status = std::fs::read_to_string("/proc/self/status").ok()?;
        let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"))?;
        u64::from_str_radix(mask.trim(), 16).ok()
    };
    ignored().is_some_and(|mask| mask >> (signal - 1) & 1 == 1)
}
