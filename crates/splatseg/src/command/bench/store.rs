//! Results on disk: one file per job, written when it is done.

use super::job::{JobInputs, JobResult};
use super::plan::Job;
use crate::command::Failure;
use crate::command::output_folder::Existing;
use splatseg_dataset::{OutputError, write_atomically};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

/// A program that makes results: two builds of one version may differ.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Program {
    fingerprint: String,
}

impl Program {
    /// The one that is running; without a fingerprint where its file cannot be read.
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
    /// Opens or makes `out/results`. A folder that holds anything but an earlier benchmark is left alone.
    pub fn open(out: &Path, existing: Existing, program: &Program) -> Result<Self, Failure> {
        let folder = out.join("results");
        let occupied = std::fs::read_dir(out).is_ok_and(|mut entries| entries.next().is_some());
        if occupied && !folder.is_dir() && existing == Existing::Keep {
            return Err(Failure::input(format!(
                "{}: the folder is not empty and holds no benchmark: choose another --out, or give --overwrite",
                out.display()
            )));
        }
        std::fs::create_dir_all(&folder).map_err(|error| Failure::work(format!("{}: {error}", folder.display())))?;
        Ok(Self { folder, existing, program: program.fingerprint.clone(), of_other_programs: AtomicUsize::new(0) })
    }

    /// The result of a job, if it is there and was made from the same inputs. One that cannot be read counts for
    /// nothing and is measured again.
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

    /// Keeps the result of a job.
    pub fn save(&self, job: &Job, result: &JobResult) -> Result<(), OutputError> {
        let result = JobResult { program: self.program.clone(), ..result.clone() };
        let text = serde_json::to_vec(&result)
            .map_err(|error| OutputError::Io { path: self.path(job), source: error.into() })?;
        write_atomically(&self.path(job), &text)
    }

    /// Tells the user about results that another build of this version made.
    pub fn warn_of_other_programs(&self) {
        let count = self.of_other_programs.load(Ordering::Relaxed);
        if count > 0 {
            eprintln!(
                "warning: {count} results are from another build of version {}; --overwrite measures them again",
                env!("CARGO_PKG_VERSION")
            );
        }
    }

    fn path(&self, job: &Job) -> PathBuf {
        self.folder.join(format!("{}.json", job.key))
    }
}

/// A name for a job that says what it is and differs for different inputs.
pub fn job_key(scene: &str, inputs: &JobInputs) -> Result<String, Failure> {
    let text = serde_json::to_vec(inputs).map_err(Failure::work)?;
    let plain = |character: char| if character.is_ascii_alphanumeric() { character } else { '-' };
    let scene: String = scene.chars().map(plain).take(60).collect();
    let settings = &inputs.settings;
    Ok(format!("{scene}.{}.seed{}.{:016x}", settings.method.name(), settings.seed, fnv1a(&text)))
}

/// 64-bit FNV-1a: the same on every machine and in every version of Rust, as file names must be.
fn fnv1a(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3))
}
