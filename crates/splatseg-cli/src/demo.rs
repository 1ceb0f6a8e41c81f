//! `splatseg demo`: runs on a built-in clip.

use super::Failure;
use super::arguments::DemoArguments;
use super::browser;
use super::output_folder::{CreatedFolders, OutputFolder, OverwritePolicy};
use super::run::{RunJob, execute, report};
use include_dir::{Dir, include_dir};
use splatseg::Settings;
use splatseg_output::{Page, write_atomically};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A rendered room in ScanNet's exported layout, with ground truth.
static CLIP: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/demo");

/// Writes the clip to `<out>/scene` and runs on it.
pub fn demo(arguments: &DemoArguments) -> Result<(), Failure> {
    OutputFolder::check(&arguments.out, OverwritePolicy::from_flag(arguments.overwrite))?;
    let scene = arguments.out.join("scene");
    let clip = ExtractedClip::at(&scene)?;
    let mut settings = Settings::default();
    settings.dataset.max_frames = arguments.frames;
    let job = RunJob {
        scene,
        out: arguments.out.clone(),
        // The folder now contains the clip. Before, it was empty or could be overwritten.
        existing: OverwritePolicy::Replace,
        settings,
        save_memory: Some(arguments.out.join("memory.ply")),
        load_memory: None,
        resume: None,
        save_coco: None,
        save_mcap: None,
        networks: Arc::default(),
    };
    report!(
        "a camera moves through a rendered room: the built-in segmenter finds masks, and the memory keeps their ids"
    );
    let summary = execute(&job)?;
    clip.keep();
    report!("{}", report(&job, &summary));
    report!("your own video: splatseg run FOLDER");
    if arguments.open {
        browser::open(&job.out.join(Page::FILE));
    }
    Ok(())
}

/// The clip on disk. Dropping it removes the files it wrote, unless it is kept, so that the next demo can start.
struct ExtractedClip {
    written: Vec<PathBuf>,
    created: Vec<CreatedFolders>,
}

impl ExtractedClip {
    /// Writes the clip to a folder. Refuses to replace other files.
    fn at(folder: &Path) -> Result<Self, Failure> {
        let mut clip = Self { written: Vec::new(), created: Vec::new() };
        clip.extract(&CLIP, folder)?;
        Ok(clip)
    }

    fn extract(&mut self, folder: &Dir<'_>, to: &Path) -> Result<(), Failure> {
        let created = CreatedFolders::create(to);
        // Inner folders first: outer ones are empty only after their removal.
        self.created.insert(0, created.map_err(|error| Failure::runtime(format!("{}: {error}", to.display())))?);
        for inner in folder.dirs() {
            self.extract(inner, &to.join(inner.path().file_name().unwrap_or_default()))?;
        }
        for file in folder.files() {
            let path = to.join(file.path().file_name().unwrap_or_default());
            match std::fs::read(&path) {
                Ok(bytes) if bytes == file.contents() => continue,
                Err(error) if error.kind() == ErrorKind::NotFound => {}
                _ => {
                    return Err(Failure::input(format!(
                        "{}: is not a demo file: choose another --out",
                        path.display()
                    )));
                }
            }
            write_atomically(&path, file.contents()).map_err(Failure::runtime)?;
            self.written.push(path);
        }
        Ok(())
    }

    /// Leaves the clip on disk.
    fn keep(mut self) {
        self.written.clear();
    }
}

impl Drop for ExtractedClip {
    fn drop(&mut self) {
        for path in &self.written {
            let _ = std::fs::remove_file(path);
        }
    }
}
