//! The file that the memory is saved to.

use crate::command::Failure;
use crate::command::output_folder::{CreatedFolders, Existing};
use splatseg_atomic_file::AtomicFile;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// A place where the memory can be saved.
#[derive(Debug)]
pub struct MemoryFile {
    path: PathBuf,
    _created: CreatedFolders,
}

impl MemoryFile {
    /// Checks that a memory can be saved at `path`, and makes its folder.
    ///
    /// # Errors
    /// If something is there that may not be replaced, or no file can be written there.
    pub fn prepare(path: &Path, existing: Existing) -> Result<Self, Failure> {
        let wrong = |reason: &str| Err(Failure::input(format!("{}: {reason}", path.display())));
        if path.symlink_metadata().is_ok() {
            // A run that was stopped saves its memory, too.
            if existing == Existing::Keep {
                return wrong("exists: give --overwrite to replace it");
            }
            if !is_ply(path) {
                return wrong("exists and is not a saved memory: choose another file for --save-memory");
            }
        }
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let created = CreatedFolders::create(folder);
        // Dropped at once, which removes it.
        match created.and_then(|created| AtomicFile::create(path).map(|_| created)) {
            Ok(created) => Ok(Self { path: path.to_owned(), _created: created }),
            Err(error) => wrong(&format!("the memory cannot be saved there: {error}")),
        }
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

/// Whether this is a file that starts as PLY files do.
pub fn is_ply(path: &Path) -> bool {
    let mut start = [0; 3];
    path.is_file() && File::open(path).and_then(|mut file| file.read_exact(&mut start)).is_ok() && start == *b"ply"
}
