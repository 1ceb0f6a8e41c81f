//! The folder that a run writes to.

use super::Failure;
use std::path::{Path, PathBuf};

/// A folder that is ready to take results.
#[derive(Clone, Debug)]
pub struct OutputFolder {
    path: PathBuf,
}

/// What to do with existing results.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Existing {
    /// Leave them alone: the run fails.
    Keep,
    /// Remove what an earlier run wrote.
    Replace,
}

impl Existing {
    /// What `--overwrite` asks for.
    pub fn from_flag(overwrite: bool) -> Self {
        if overwrite { Self::Replace } else { Self::Keep }
    }
}

/// Folders of result files, and the extension of the files in them.
const RESULTS: [(&str, &str); 2] = [("segments", "png"), ("overlay", "jpg")];

impl OutputFolder {
    /// Checks that results can be written to `path`: it does not exist, is an empty folder, or may be overwritten.
    pub fn check(path: &Path, existing: Existing) -> Result<(), Failure> {
        let entries = match std::fs::read_dir(path) {
            Ok(entries) => entries,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(()),
            Err(error) => return Err(Failure::input(format!("{}: {error}", path.display()))),
        };
        if existing == Existing::Keep && entries.count() > 0 {
            return Err(Failure::input(format!(
                "{}: the folder is not empty: choose another --out, or give --overwrite to replace earlier results",
                path.display()
            )));
        }
        Ok(())
    }

    /// Makes the folder and removes an earlier run's results from it (and no other files).
    pub fn create(path: &Path, existing: Existing) -> Result<Self, Failure> {
        Self::check(path, existing)?;
        let failed = |path: &Path, error: std::io::Error| Failure::work(format!("{}: {error}", path.display()));
        for (folder, extension) in RESULTS {
            let folder = path.join(folder);
            std::fs::create_dir_all(&folder).map_err(|error| failed(&folder, error))?;
            for entry in std::fs::read_dir(&folder).map_err(|error| failed(&folder, error))?.flatten() {
                if entry.path().extension().is_some_and(|found| found == extension) {
                    std::fs::remove_file(entry.path()).map_err(|error| failed(&entry.path(), error))?;
                }
            }
        }
        let summary = path.join("summary.json");
        match std::fs::remove_file(&summary) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(failed(&summary, error)),
            _ => Ok(Self { path: path.to_owned() }),
        }
    }

    /// The folder itself.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The file of a frame's 16-bit ids.
    pub fn segments(&self, frame: &str) -> PathBuf {
        self.path.join("segments").join(format!("{frame}.png"))
    }

    /// The file of a frame's overlay.
    pub fn overlay(&self, frame: &str) -> PathBuf {
        self.path.join("overlay").join(format!("{frame}.jpg"))
    }

    /// The file of the run's summary.
    pub fn summary(&self) -> PathBuf {
        self.path.join("summary.json")
    }
}
