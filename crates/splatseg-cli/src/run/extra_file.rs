//! Output files at paths given by options, outside the folder of results.

use crate::Failure;
use crate::file_kind::FileKind;
use crate::output_folder::{CreatedFolders, OverwritePolicy};
use splatseg_files::{AtomicFile, remove_leftovers};
use std::path::{Path, PathBuf};

/// A path that was checked to be writable.
#[derive(Debug)]
pub struct ExtraFile {
    path: PathBuf,
    _created: CreatedFolders,
}

impl ExtraFile {
    /// Checks that a file can be written at `path`, and creates its folder.
    ///
    /// # Errors
    /// If its name has another ending, an existing file may not be replaced, or no file can be written there.
    pub fn prepare(path: &Path, kind: FileKind, existing: OverwritePolicy) -> Result<Self, Failure> {
        kind.check(path, existing)?;
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let created = CreatedFolders::create(folder);
        remove_leftovers(path);
        // The test file is dropped at once, which removes it.
        match created.and_then(|created| AtomicFile::create(path).map(|_| created)) {
            Ok(created) => Ok(Self { path: path.to_owned(), _created: created }),
            Err(error) => {
                Err(Failure::input(format!("{}: {} cannot be saved there: {error}", path.display(), kind.content)))
            }
        }
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }
}
