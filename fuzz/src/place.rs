//! Files on disk of which one is damaged at a time.

use splatseg_dataset::{DatasetSettings, Format, open_scene};
use splatseg_files::MemoryLimit;
use std::cell::{Cell, OnceCell};
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// Input that says it needs more is refused; less than the allocator allows, as the targets have files of their own.
const ACCEPTED_MEMORY: u64 = 200_000_000;

/// Inputs whose first byte is at least this detect the format of the scene, which takes most of the time of a small one.
const DETECTED: u8 = 128;

/// A folder with the files of a template. An input's first byte chooses a file; the rest of the input replaces it.
pub struct Place {
    folder: TempDir,
    files: Vec<(PathBuf, Vec<u8>)>,
    replaced: Cell<Option<usize>>,
    /// The scenes in it and their formats, if it was made for [`read_changed_scene`].
    scenes: Vec<(PathBuf, Format)>,
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
        Self { folder, files, replaced: Cell::new(None), scenes: Vec::new() }
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
            place.with_file(usize::from(*choice) % place.files.len(), bytes, || work(place.folder()));
        });
    }

    /// Writes a template with scenes, which are opened to know their formats.
    fn of_scenes(write: impl Fn(&Path), scenes: &[&str]) -> Self {
        let place = Self::new(write);
        let format = |scene: &PathBuf| {
            let opened = open_scene(scene, &DatasetSettings::default());
            let format = opened.ok().and_then(|scene| scene.format());
            format.unwrap_or_else(|| panic!("{}: not a scene before any change", scene.display()))
        };
        let scenes = scenes.iter().map(|scene| place.folder().join(scene));
        let scenes = scenes.map(|scene| (scene.clone(), format(&scene))).collect();
        Self { scenes, ..place }
    }

    /// Runs `work` while a file of the folder has another content. It keeps that until the next file is replaced.
    pub fn with_file(&self, choice: usize, bytes: &[u8], work: impl FnOnce()) {
        let write = |(path, _): &(PathBuf, _), bytes: &[u8]| {
            fs::write(path, bytes).expect("a file in the temporary folder");
        };
        if let Some(before) = self.replaced.replace(Some(choice)).filter(|before| *before != choice) {
            write(&self.files[before], &self.files[before].1);
        }
        write(&self.files[choice], bytes);
        work();
    }

    /// The scene that has a file: the first of `scenes` in whose path it is.
    pub fn scene_of(&self, choice: usize, scenes: &[&str]) -> Option<PathBuf> {
        let mut scenes = scenes.iter().map(|scene| self.folder.path().join(scene));
        scenes.find(|scene| self.files[choice].0.starts_with(scene))
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

/// Reads, of the scenes in a folder, the one whose file the input replaces.
pub fn read_changed_scene(
    place: &'static std::thread::LocalKey<OnceCell<Place>>,
    write: impl Fn(&Path),
    scenes: &[&str],
    input: &[u8],
) {
    let Some((choice, bytes)) = input.split_first() else { return };
    place.with(|place| {
        let place = place.get_or_init(|| Place::of_scenes(write, scenes));
        let index = usize::from(*choice % DETECTED) % place.files.len();
        let is_in = |(scene, _): &&(PathBuf, Format)| place.files[index].0.starts_with(scene);
        let Some((scene, format)) = place.scenes.iter().find(is_in) else { return };
        let format = if *choice < DETECTED { *format } else { Format::Auto };
        place.with_file(index, bytes, || read_scene_as(scene, format));
    });
}

/// Reads everything of a scene. Whatever is wrong with it must come back as an error.
pub fn read_scene(path: impl AsRef<Path>) {
    read_scene_as(path, Format::Auto);
}

fn read_scene_as(path: impl AsRef<Path>, format: Format) {
    let settings = DatasetSettings::default().with(|settings| settings.format = format);
    let Ok(scene) = open_scene(path, &settings) else { return };
    for index in 0..scene.frame_count().min(3) {
        let _ = scene.frame_name(index);
        let _ = scene.read_frame(index);
        let _ = scene.read_ground_truth(index);
    }
}
