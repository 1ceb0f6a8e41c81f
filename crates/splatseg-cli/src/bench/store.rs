//! Results on disk: one file per job, written when the job is done.

use super::job::{JobInputs, JobResult};
use crate::Failure;
use crate::manifest::{MANIFEST, Manifest, listed, listed_files};
use crate::output_folder::OverwritePolicy;
use serde::Deserialize;
use sha2::{Digest, Sha256};
use splatseg_files::read_file;
use splatseg_output::{OutputError, write_atomically};
use splatseg_report::{Series, Thumbnail};
use std::path::{Path, PathBuf};

/// Largest result that is read, bytes.
const MAX_RESULT_BYTES: u64 = 256_000_000;

/// Name of the folder of results inside the folder of a benchmark.
const RESULTS_FOLDER: &str = "results";

/// Files that a benchmark writes beside `results/`.
const FILES: [&str; 6] =
    ["results.json", "results.csv", "failures.json", "tables.md", "report.html", "input_hashes.json"];

/// Files of the paper's tables, beside the folders of their benchmarks.
pub const PAPER_FILES: [&str; 3] = ["paper.md", "paper.csv", "paper.html"];

/// Prepares a folder for the paper's tables. Refuses a folder with content other than an earlier benchmark.
pub fn claim_paper_folder(out: &Path, existing: OverwritePolicy) -> Result<(), Failure> {
    claim(out, existing, &PAPER_FILES, || listed(out, is_paper_file).is_ok_and(|listed| !listed.is_empty()))
}

fn is_paper_file(file: &str) -> bool {
    PAPER_FILES.contains(&file)
}

fn is_benchmark_file(file: &str) -> bool {
    FILES.contains(&file)
}

/// Prepares a folder for these files, and lists them in its manifest. `is_ours` returns true if an earlier benchmark used
/// the folder.
fn claim(
    out: &Path,
    existing: OverwritePolicy,
    files: &[&'static str],
    is_ours: impl FnOnce() -> bool,
) -> Result<(), Failure> {
    let occupied = std::fs::read_dir(out).is_ok_and(|mut entries| entries.next().is_some());
    if occupied && existing == OverwritePolicy::Keep && !is_ours() {
        return Err(Failure::input(format!(
            "{}: the folder is not empty and not from a benchmark: choose another --out, or give --overwrite",
            out.display()
        )));
    }
    refuse_files_of_others(out, files)?;
    std::fs::create_dir_all(out).map_err(|error| Failure::runtime(format!("{}: {error}", out.display())))?;
    let manifest = Manifest::start(out).and_then(|mut manifest| manifest.add(files));
    manifest.map_err(|error| Failure::runtime(format!("{}: {error}", out.join(MANIFEST).display())))
}

/// Refuses a folder where a benchmark would replace files that no manifest lists.
fn refuse_files_of_others(out: &Path, files: &[&'static str]) -> Result<(), Failure> {
    if !listed_files(out)?.is_empty() {
        let reason = "has the results of a run: choose another --out";
        return Err(Failure::input(format!("{}: {reason}", out.display())));
    }
    let mut ours = listed(out, is_benchmark_file)?;
    ours.extend(listed(out, is_paper_file)?);
    let is_in_the_way = |file: &&str| out.join(file).symlink_metadata().is_ok() && !ours.contains(*file);
    match files.iter().copied().find(is_in_the_way) {
        Some(file) => Err(Failure::input(format!(
            "{}: is in the way, and no {MANIFEST} lists it as a splatseg result: remove it, or choose another --out",
            out.join(file).display()
        ))),
        None => Ok(()),
    }
}

/// The program that measures. Two builds of one version may give different results.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Program {
    /// SHA-256 of the program's file; `None` if it cannot be read.
    fingerprint: Option<String>,
}

impl Program {
    /// Returns the running program.
    pub fn running() -> Self {
        let bytes = std::env::current_exe().and_then(std::fs::read).ok();
        let hex = |bytes: &[u8]| bytes.iter().map(|byte| format!("{byte:02x}")).collect();
        Self { fingerprint: bytes.map(|bytes| hex(&Sha256::digest(bytes))) }
    }
}

/// A lookup of a job in the store.
#[derive(Debug)]
pub enum Stored {
    /// A valid result.
    Same(Box<JobResult>),
    /// An outdated result, with the reason.
    Outdated(String),
    /// No result.
    Nothing,
}

/// The folder of results.
pub struct ResultStore {
    folder: PathBuf,
    existing: OverwritePolicy,
    program: Program,
}

impl ResultStore {
    /// Opens `out/results`, or creates it. Refuses a folder with content other than an earlier benchmark.
    pub fn open(out: &Path, existing: OverwritePolicy, program: Program) -> Result<Self, Failure> {
        let folder = out.join(RESULTS_FOLDER);
        claim(out, existing, &FILES, || folder.is_dir())?;
        std::fs::create_dir_all(&folder).map_err(|error| Failure::runtime(format!("{}: {error}", folder.display())))?;
        Ok(Self { folder, existing, program })
    }

    /// Loads the stored result of a job, if the same program made it from the same inputs.
    pub fn load(&self, key: &str, inputs: &JobInputs) -> Stored {
        let path = self.path(key);
        if self.existing == OverwritePolicy::Replace || !path.exists() {
            return Stored::Nothing;
        }
        let read = read_file(&path, MAX_RESULT_BYTES).map_err(|error| error.to_string());
        let result = read.and_then(|text| {
            serde_json::from_slice::<JobResult>(&text).map_err(|_| "the stored result cannot be read".to_owned())
        });
        match result.and_then(|result| self.outdated(&result, inputs).map_or(Ok(result), Err)) {
            Ok(result) => Stored::Same(Box::new(result)),
            Err(reason) => Stored::Outdated(reason),
        }
    }

    /// Returns the reason if a stored result is outdated.
    fn outdated(&self, result: &JobResult, inputs: &JobInputs) -> Option<String> {
        if result.inputs.version != inputs.version {
            return Some(format!("it was measured by version {}", result.inputs.version));
        }
        if self.program.fingerprint.as_ref() != Some(&result.program) {
            return Some("it was measured by another build of the program".to_owned());
        }
        let changed = inputs.files.iter().find(|file| !result.inputs.files.contains(file));
        if let Some(file) = changed {
            return Some(format!("{} has changed", file.path));
        }
        (result.inputs != *inputs).then(|| "its inputs have changed".to_owned())
    }

    /// Stores the result of a job.
    pub fn save(&self, key: &str, result: &JobResult) -> Result<(), OutputError> {
        let program = self.program.fingerprint.clone().unwrap_or_default();
        let result = JobResult { program, ..result.clone() };
        let text = serde_json::to_vec(&result)
            .map_err(|error| OutputError::Io { path: self.path(key), source: error.into() })?;
        write_atomically(&self.path(key), &text)
    }

    fn path(&self, key: &str) -> PathBuf {
        result_path(&self.folder, key)
    }
}

/// Returns a readable name for a job, unique to its inputs. It does not depend on the content of files, so that a new
/// result replaces the outdated one.
pub fn job_key(scene: &str, inputs: &JobInputs) -> Result<String, Failure> {
    let JobInputs { scene: path, settings, score, mesh, files: _, version: _ } = inputs;
    let text = serde_json::to_vec(&(path, settings, score, mesh)).map_err(Failure::runtime)?;
    let plain = |character: char| if character.is_ascii_alphanumeric() { character } else { '-' };
    let scene: String = scene.chars().map(plain).take(60).collect();
    Ok(format!("{scene}.{}.seed{}.{:016x}", settings.method.name(), settings.run.seed, fnv1a(&text)))
}

/// Returns the speed of a stored result, frames per second, even if the result is outdated. Returns `None` if there is no
/// result.
pub fn stored_speed(out: &Path, key: &str) -> Option<f64> {
    let bytes = read_file(&result_path(&out.join(RESULTS_FOLDER), key), MAX_RESULT_BYTES).ok()?;
    serde_json::from_slice::<JobResult>(&bytes).ok().map(|result| result.fps.total)
}

/// The pictures and curves of a stored result.
#[derive(Debug, Deserialize)]
pub struct StoredDrawings {
    /// Curves over the frames.
    pub series: Series,
    /// Thumbnails of some of the frames.
    pub strip: Vec<Thumbnail>,
}

/// Reads the pictures and curves of a stored result.
///
/// # Errors
/// If the result's file cannot be read.
pub fn stored_drawings(out: &Path, key: &str) -> Result<StoredDrawings, String> {
    let path = result_path(&out.join(RESULTS_FOLDER), key);
    let bytes = read_file(&path, MAX_RESULT_BYTES).map_err(|error| error.to_string())?;
    serde_json::from_slice(&bytes).map_err(|error| format!("{}: {error}", path.display()))
}

fn result_path(folder: &Path, key: &str) -> PathBuf {
    folder.join(format!("{key}.json"))
}

/// 64-bit FNV-1a. Unlike the standard library's hashes, it is the same in every version of Rust, which file names need.
fn fnv1a(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3))
}
