//! Results on disk: one file per job, written when it is done.

use super::job::{JobInputs, JobResult};
use super::plan::Job;
use crate::command::Failure;
use crate::command::output_folder::Existing;
use splatseg_dataset::{OutputError, write_atomically};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

/// The program that measured a result. Two builds of one version may give different results.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Program {
    fingerprint: String,
}

impl Program {
    /// The program that is running. The fingerprint is that of no bytes where its file cannot be read.
    pub fn running() -> Self {
        let bytes = std::env::current_exe().and_then(std::fs::read).unwrap_or_default();
        Self { fingerprint: format!("{:016x}", fnv1a(&bytes)) }
    }
}

/// The folder of results.
pub struct ResultStore {
    folder: PathBuf,
    existing: Existing,
    program: String,
    of_other_programs: AtomicUsize,
}

impl ResultStore {
    /// Opens `out/results`, or creates it. A folder with other content than an earlier benchmark is refused.
    pub fn open(out: &Path, existing: Existing, program: &Program) -> Result<Self, Failure> {
        let folder = out.join("results");
        let occupied = std::fs::read_dir(out).is_ok_and(|mut entries| entries.next().is_some());
        if occupied && !folder.is_dir() && existing == Existing::Keep {
            return Err(Failure::input(format!(
                "{}: the folder is not empty and not from a benchmark: choose another --out, or give --overwrite",
                out.display()
            )));
        }
        std::fs::create_dir_all(&folder).map_err(|error| Failure::work(format!("{}: {error}", folder.display())))?;
        Ok(Self { folder, existing, program: program.fingerprint.clone(), of_other_programs: AtomicUsize::new(0) })
    }

    /// The stored result of a job, if it was made from the same inputs. One that cannot be read is measured again.
    pub fn load(&self, job: &Job) -> Option<JobResult> {
        if self.existing == Existing::Replace {
            return None;
        }
        let text = std::fs::read(self.path(job)).ok()?;
        let result: JobResult = match serde_json::from_slice(&text) {
            Ok(result) => result,
            Err(error) => {
                tracing::warn!("{}: measured again: {error}", self.path(job).display());
                return None;
            }
        };
        if result.inputs != job.inputs {
            return None;
        }
        if result.program != self.program {
            self.of_other_programs.fetch_add(1, Ordering::Relaxed);
        }
        Some(result)
    }

    /// Stores the result of a job.
    pub fn save(&self, job: &Job, result: &JobResult) -> Result<(), OutputError> {
        let result = JobResult { program: self.program.clone(), ..result.clone() };
        let text = serde_json::to_vec(&result)
            .map_err(|error| OutputError::Io { path: self.path(job), source: error.into() })?;
        write_atomically(&self.path(job), &text)
    }

    /// Warns of results that another build of this version measured.
    pub fn warn_of_other_programs(&self) {
        let count = self.of_other_programs.load(Ordering::Relaxed);
        if count > 0 {
            eprintln!(
                "warning: {count} results were measured by another build of version {}; --overwrite measures them again",
                env!("CARGO_PKG_VERSION")
            );
        }
    }

    fn path(&self, job: &Job) -> PathBuf {
        self.folder.join(format!("{}.json", job.key))
    }
}

/// A name for a job: readable, and different for different inputs.
pub fn job_key(scene: &str, inputs: &JobInputs) -> Result<String, Failure> {
    let text = serde_json::to_vec(inputs).map_err(Failure::work)?;
    let plain = |character: char| if character.is_ascii_alphanumeric() { character } else { '-' };
    let scene: String = scene.chars().map(plain).take(60).collect();
    let settings = &inputs.settings;
    Ok(format!("{scene}.{}.seed{}.{:016x}", settings.method.name(), settings.run.seed, fnv1a(&text)))
}

/// 64-bit FNV-1a: unlike the standard library's hashes, the same in every version of Rust, as file names must be.
fn fnv1a(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3))
}
