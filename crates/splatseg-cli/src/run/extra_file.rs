//! Output files at paths given by options, outside the folder of results.

use crate::Failure;
use crate::output_folder::{CreatedFolders, OverwritePolicy};
use splatseg_files::{AtomicFile, remove_leftovers};
use splatseg_output::{CocoFile, McapFile};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// A kind of output file.
#[derive(Clone, Copy, Debug)]
pub struct FileKind {
    /// The option that names the file.
    pub option: &'static str,
    /// Description of the content, for errors.
    content: &'static str,
    /// Description of such a file, for errors.
    name: &'static str,
    /// First bytes of such files. Files with none of these are not replaced.
    starts: &'static [&'static [u8]],
}

impl FileKind {
    /// A saved memory.
    pub const MEMORY: Self =
        Self { option: "--save-memory", content: "the memory", name: "a saved memory", starts: &[b"ply"] };
    /// A mesh as binary glTF.
    pub const GLTF: Self = Self { option: "--out", content: "the mesh", name: "a glTF file", starts: &[b"glTF"] };
    /// A scene graph.
    pub const SCENE_GRAPH: Self = Self {
        option: "--out",
        content: "the scene graph",
        name: "a scene graph by splatseg",
        starts: &[b"{\n  \"format\": \"splatseg-scene-graph\""],
    };
    /// The map of a live session.
    pub const MAP: Self = Self { option: "--map", content: "the map", name: "a saved memory", starts: &[b"ply"] };
    /// A COCO file with all masks.
    pub const COCO: Self = Self {
        option: "--save-coco",
        content: "the masks",
        name: "a COCO file by splatseg",
        starts: &[CocoFile::START.as_bytes()],
    };
    /// A recording for robotics viewers.
    pub const MCAP: Self = Self {
        option: "--save-mcap",
        content: "the recording",
        name: "a recording by splatseg",
        starts: McapFile::STARTS,
    };
    /// A converted scene.
    pub const CONVERTED: Self = Self { option: "OUT.mcap", ..Self::MCAP };
    /// The part of the stream that a live session used.
    pub const RECORDING: Self = Self { option: "--record", ..Self::MCAP };

    /// Name of the format in `export`.
    pub fn of_exports(&self) -> &'static str {
        if self.option == Self::MEMORY.option { "a PLY file" } else { self.name }
    }

    /// Returns true if the file at `path` has the first bytes of this kind.
    pub fn is_kind_of(&self, path: &Path) -> bool {
        let starts_with = |start: &&[u8]| {
            let mut found = vec![0; start.len()];
            File::open(path).and_then(|mut file| file.read_exact(&mut found)).is_ok() && found == **start
        };
        path.is_file() && self.starts.iter().any(starts_with)
    }
}

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
    /// If an existing file may not be replaced, or no file can be written there.
    pub fn prepare(path: &Path, kind: FileKind, existing: OverwritePolicy) -> Result<Self, Failure> {
        let wrong = |reason: String| Err(Failure::input(format!("{}: {reason}", path.display())));
        if path.symlink_metadata().is_ok() {
            if existing == OverwritePolicy::Keep {
                return wrong("exists: give --overwrite to replace it".to_owned());
            }
            if !kind.is_kind_of(path) {
                return wrong(format!("exists and is not {}: choose another file for {}", kind.name, kind.option));
            }
        }
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let created = CreatedFolders::create(folder);
        remove_leftovers(path);
        // The test file is dropped at once, which removes it.
        match created.and_then(|created| AtomicFile::create(path).map(|_| created)) {
            Ok(created) => Ok(Self { path: path.to_owned(), _created: created }),
            Err(error) => wrong(format!("{} cannot be saved there: {error}", kind.content)),
        }
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }
}
