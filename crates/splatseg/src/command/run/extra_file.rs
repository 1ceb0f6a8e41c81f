//! Files that a run writes where an option says, outside its folder of results.

use crate::command::Failure;
use crate::command::output_folder::{CreatedFolders, Existing};
use splatseg_atomic_file::AtomicFile;
use splatseg_output::{CocoFile, McapFile};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// A kind of file.
#[derive(Clone, Copy, Debug)]
pub struct FileKind {
    /// The option that names the file.
    pub option: &'static str,
    /// What is in it.
    content: &'static str,
    /// What such a file is called.
    name: &'static str,
    /// How every such file starts: no other is replaced.
    start: &'static [u8],
}

impl FileKind {
    /// The memory.
    pub const MEMORY: Self =
        Self { option: "--save-memory", content: "the memory", name: "a saved memory", start: b"ply" };
    /// All masks.
    pub const COCO: Self = Self {
        option: "--save-coco",
        content: "the masks",
        name: "a COCO file by splatseg",
        start: CocoFile::START.as_bytes(),
    };
    /// What viewers of robots' recordings show.
    pub const MCAP: Self = Self {
        option: "--save-mcap",
        content: "the recording",
        name: "a recording by splatseg",
        start: McapFile::START,
    };

    /// Whether this is a file that starts as this kind does.
    pub fn is_kind_of(&self, path: &Path) -> bool {
        let mut start = vec![0; self.start.len()];
        let mut read = || File::open(path).and_then(|mut file| file.read_exact(&mut start));
        path.is_file() && read().is_ok() && start == self.start
    }
}

/// A place where a file can be written.
#[derive(Debug)]
pub struct ExtraFile {
    path: PathBuf,
    _created: CreatedFolders,
}

impl ExtraFile {
    /// Checks that a file can be written at `path`, and makes its folder.
    ///
    /// # Errors
    /// If something is there that may not be replaced, or no file can be written there.
    pub fn prepare(path: &Path, kind: FileKind, existing: Existing) -> Result<Self, Failure> {
        let wrong = |reason: String| Err(Failure::input(format!("{}: {reason}", path.display())));
        if path.symlink_metadata().is_ok() {
            if existing == Existing::Keep {
                return wrong("exists: give --overwrite to replace it".to_owned());
            }
            if !kind.is_kind_of(path) {
                return wrong(format!("exists and is not {}: choose another file for {}", kind.name, kind.option));
            }
        }
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let created = CreatedFolders::create(folder);
        // Dropped at once, which removes it.
        match created.and_then(|created| AtomicFile::create(path).map(|_| created)) {
            Ok(created) => Ok(Self { path: path.to_owned(), _created: created }),
            Err(error) => wrong(format!("{} cannot be saved there: {error}", kind.content)),
        }
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }
}
