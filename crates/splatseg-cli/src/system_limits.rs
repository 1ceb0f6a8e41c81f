//! The system's limits of the process: threads, address space, size of files. A limit that is too low is an error in one line,
//! before the work begins.

use crate::Failure;
use splatseg_files::{address_space_limit, display_bytes};
use splatseg_kernels::Instructions;
use std::error::Error;
use std::sync::{Mutex, PoisonError};

/// The environment variable with the number of threads, if the setting leaves it open.
const THREADS_VARIABLE: &str = "RAYON_NUM_THREADS";
/// Maximum number of threads, as of the setting `threads`.
const MAX_THREADS: usize = 512;
/// The address space that the smallest scene needs, bytes: in all, and per thread.
const MIN_ADDRESS_SPACE: (u64, u64) = (64_000_000, 8_000_000);

const ADVICE: &str = "use fewer (--threads), or raise the limit (ulimit -u, ulimit -v)";

/// The failure to start a thread with a purpose of its own.
pub fn no_thread(purpose: &str, error: &std::io::Error) -> Failure {
    Failure::runtime(format!("the thread that {purpose} cannot be started: {error}: {ADVICE}"))
}

/// Makes a write beyond the limit for the size of files (`ulimit -f`) an error of this write. By default, the signal
/// SIGXFSZ ends the program, and results so far are lost.
pub fn survive_file_size_limit() {
    #[cfg(unix)]
    {
        use signal_hook::consts::SIGXFSZ;
        // Without it, the program still works up to that size.
        let _ = signal_hook::flag::register(SIGXFSZ, std::sync::Arc::default());
    }
}

/// Checks the environment variables that change how the program runs.
///
/// # Errors
/// Names the variable that cannot be used.
pub fn check_environment() -> Result<(), Failure> {
    Instructions::check_choice().map_err(Failure::input)?;
    wanted_threads().map(drop)
}

/// Starts the threads of the process; 0: as many as the environment variable or the number of cores says. Their number
/// cannot change afterwards.
///
/// # Errors
/// If the number is out of range, or the system does not allow so many.
pub fn use_threads(threads: usize) -> Result<(), Failure> {
    static STARTED: Mutex<Option<usize>> = Mutex::new(None);
    let mut started = STARTED.lock().unwrap_or_else(PoisonError::into_inner);
    let count = match threads {
        0 => wanted_threads()?,
        threads => threads,
    };
    match *started {
        Some(running) if threads == 0 || threads == running => return Ok(()),
        Some(running) => {
            let reason = format!("this process has {running} threads already: their number cannot change");
            return Err(Failure::runtime(format!("threads is {threads}, but {reason}")));
        }
        None => {}
    }
    require_address_space(count)?;
    match rayon::ThreadPoolBuilder::new().num_threads(count).build_global() {
        Ok(()) => {}
        Err(error) => match error.source() {
            Some(reason) => {
                return Err(Failure::runtime(format!("{count} threads cannot be started: {reason}: {ADVICE}")));
            }
            // Started by a program that uses this command as a library.
            None if [0, rayon::current_num_threads()].contains(&threads) => {}
            None => return Err(Failure::runtime(&error)),
        },
    }
    *started = Some(rayon::current_num_threads());
    Ok(())
}

/// The number of threads if the setting leaves it open.
fn wanted_threads() -> Result<usize, Failure> {
    threads_of_environment(std::env::var_os(THREADS_VARIABLE).map(|text| text.to_string_lossy().into_owned()))
}

fn threads_of_environment(text: Option<String>) -> Result<usize, Failure> {
    let cores = || std::thread::available_parallelism().map_or(1, usize::from).min(MAX_THREADS);
    let Some(text) = text.filter(|text| !text.is_empty()) else { return Ok(cores()) };
    match text.parse() {
        Ok(0) => Ok(cores()),
        Ok(threads @ 1..=MAX_THREADS) => Ok(threads),
        _ => Err(Failure::input(format!("{THREADS_VARIABLE} is {text:?}, expected a number from 0 to {MAX_THREADS}"))),
    }
}

fn require_address_space(threads: usize) -> Result<(), Failure> {
    let needed = MIN_ADDRESS_SPACE.0 + MIN_ADDRESS_SPACE.1 * threads as u64;
    match address_space_limit() {
        Some(limit) if limit < needed => {
            let (limit, needed) = (display_bytes(limit), display_bytes(needed));
            Err(Failure::runtime(format!(
                "the address space is limited to {limit} (ulimit -v), but {threads} threads need {needed} and more: raise the \
                 limit, or use fewer --threads"
            )))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_environment_may_name_any_sensible_number_of_threads() {
        let threads = |text: &str| threads_of_environment(Some(text.to_owned()));
        assert_eq!(threads("3").unwrap(), 3);
        for unset in [threads(""), threads("0"), threads_of_environment(None)] {
            assert!((1..=MAX_THREADS).contains(&unset.unwrap()));
        }
        for wrong in ["100000", "513", "-1", "many", "99999999999999999999999"] {
            let error = threads(wrong).unwrap_err().to_string();
            assert_eq!(error, format!("RAYON_NUM_THREADS is {wrong:?}, expected a number from 0 to 512"));
        }
    }
}
