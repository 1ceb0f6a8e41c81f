//! `splatseg batch`: many scenes, each in its own run.
//!
//! `plan.rs` determines the scenes still to do. `pool.rs` distributes them to worker processes (`worker.rs`), which write a
//! row (`row.rs`) for each finished scene. `tables.rs` summarises the rows. On a Ray cluster, the Python package replaces
//! `pool.rs` and starts the same workers.

mod arguments;
mod plan;
mod pool;
mod row;
mod tables;
mod worker;

pub use arguments::BatchArguments;
pub use worker::work;

use super::Failure;
use super::run::StopSignals;
use super::system_limits::no_thread;
use super::terminal::counted;
use plan::Plan;
use splatseg_files::read_file;
use splatseg_output::write_atomically;
use std::ffi::OsString;
use std::path::Path;
use tables::FailedScene;

/// Largest list of failed scenes that is read, bytes.
const MAX_LIST_BYTES: u64 = 256_000_000;

/// Executes `splatseg batch`. `program` is the start of a command line that runs this program in another process.
pub fn batch(arguments: &BatchArguments, program: &[OsString]) -> Result<(), Failure> {
    if arguments.ray.is_some() {
        return Err(Failure::input("--ray needs the Python package and Ray: pip install ./python 'ray[data]'"));
    }
    let plan = Plan::of(arguments)?;
    if let Some(path) = &arguments.plan {
        let text = serde_json::to_vec_pretty(&plan).map_err(Failure::runtime)?;
        return write_atomically(path, &text).map_err(Failure::runtime);
    }
    let failed = match &arguments.collect {
        Some(path) => failed_scenes(path)?,
        None => {
            inform!("{}, {} done before", counted(plan.scenes.len(), "scene"), plan.scenes.len() - plan.jobs.len());
            let signals = StopSignals::listen().map_err(|error| no_thread("listens for signals", &error))?;
            pool::Pool { program, plan: &plan, signals: &signals }.run()?
        }
    };
    tables::write(&arguments.out, &plan, &failed)?;
    report(&arguments.out, &plan, &failed)
}

fn failed_scenes(path: &Path) -> Result<Vec<FailedScene>, Failure> {
    let wrong = |error: &dyn std::fmt::Display| Failure::input(format!("{}: {error}", path.display()));
    let bytes = read_file(path, MAX_LIST_BYTES).map_err(|error| wrong(&error))?;
    let scene = |line: &[u8]| serde_json::from_slice(line).map_err(|error| wrong(&error));
    bytes.split(|byte| *byte == b'\n').filter(|line| !line.is_empty()).map(scene).collect()
}

fn report(out: &Path, plan: &Plan, failed: &[FailedScene]) -> Result<(), Failure> {
    report!("{} in {}", counted(plan.scenes.len() - failed.len(), "scene"), out.join(tables::RESULTS).display());
    if out.join(tables::SCORES).is_file() {
        report!("scores over all scenes with ground truth are in {}", out.join(tables::SCORES).display());
    }
    match failed.first() {
        None => Ok(()),
        Some(first) => Err(Failure::runtime(format!(
            "{} failed, listed in {}; the first is {}: {}",
            counted(failed.len(), "scene"),
            out.join(tables::FAILED).display(),
            first.scene,
            first.error
        ))),
    }
}
