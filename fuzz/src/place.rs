//! Files on disk of which one is damaged at a time.

use splatseg_dataset::{DatasetSettings, open_scene};
use splatseg_files::MemoryLimit;
use std::cell::OnceCell;
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// Input that says it needs more is refused; less than the allocator allows, as the targets have files of their own.
const ACCEPTED_MEMORY: u64 = 200_000_000;

/// A folder with the files of a template. An input's first byte chooses a file; the rest of the input replaces it.
pub struct Place {
    folder: TempDir,
    files: Vec<(PathBuf, Vec<u8>)>,
}

impl Place {
    /// Writes a template.
    pub fn new(write: impl Fn(&Path)) -> Self {
        MemoryLimit::Bytes(ACCEPTED_MEMORY).enforce();
        // Files in memory are written a hundred times faster.
        let memory = Path::new("/dev/shm");
        let folder = if memory.is_dir() { tempfile::tempdir_in(memory) } else { tempfile::tempdir() };
        let folder = folder.expect("a temporary folder");
        write(folder.path());
        let mut files = Vec::new();
        collect(folder.path(), &mut files);
        files.sort();
        Self { folder, files }
    }

    /// Runs `work` on the folder with one file replaced. Every thread has its own folder, written once.
    pub fn with_input(
        place: &'static std::thread::LocalKey<OnceCell<Self>>,
        write: impl Fn(&Path),
        input: &[u8],
        work: impl Fn(&Path),
    ) {
        let Some((choice, bytes)) = input.split_first() else { return };
        place.with(|place| {
            let place = place.get_or_init(|| Self::new(write));
            place.with_file(usize::from(*choice) % place.files.len(), bytes, || work(place.folder.path()));
        });
    }

    /// Runs `work` while a file of the folder has another content.
    pub fn with_file(&self, choice: usize, bytes: &[u8], work: impl FnOnce()) {
        let (path, whole) = &self.files[choice];
        fs::write(path, bytes).expect("a file in the temporary folder");
        work();
        fs::write(path, whole).expect("a file in the temporary folder");
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// Paths and contents of the files in it.
    pub fn files(&self) -> &[(PathBuf, Vec<u8>)] {
        &self.files
    }

    /// The inputs that leave the template as it is, one for each file.
    pub fn seeds(&self) -> Vec<Vec<u8>> {
        self.files.iter().zip(0u8..).map(|((_, bytes), choice)| [&[choice], &bytes[..]].concat()).collect()
    }
}

fn collect(folder: &Path, files: &mut Vec<(PathBuf, Vec<u8>)>) {
    for entry in fs::read_dir(folder).expect("the template's folder") {
        let path = entry.expect("an entry of the template's folder").path();
        if path.is_dir() {
            collect(&path, files);
        } else {
            let bytes = fs::read(&path).expect("a file of the template");
            files.push((path, bytes));
        }
    }
}

/// Reads everything of a scene. Whatever is wrong with it must come back as an error.
pub fn read_scene(path: impl AsRef<Path>) {
    let Ok(scene) = open_scene(path, &DatasetSettings::default()) else { return };
    for index in 0..scene.frame_count().min(3) {
        let _ = scene.frame_name(index);
        let _ = scene.read_frame(index);
        let _ = scene.read_ground_truth(index);
    }
}
