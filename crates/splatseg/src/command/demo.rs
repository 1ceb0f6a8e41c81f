//! `splatseg demo`: runs on a clip that is built into the program.

use super::Failure;
use super::arguments::DemoArguments;
use super::output_folder::{Existing, OutputFolder};
use super::run::{Job, execute, report};
use include_dir::{Dir, include_dir};
use splatseg::Settings;
use splatseg_dataset::write_atomically;
use std::path::Path;

/// A rendered room in ScanNet's exported layout, with ground truth.
static CLIP: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/demo");

/// Writes the clip to `<out>/scene` and runs on it.
pub fn demo(arguments: &DemoArguments) -> Result<(), Failure> {
    let existing = Existing::from_flag(arguments.overwrite);
    OutputFolder::check(&arguments.out, existing)?;
    let scene = arguments.out.join("scene");
    extract(&CLIP, &scene)?;
    let mut settings = Settings::default();
    settings.dataset.max_frames = arguments.frames;
    let job = Job {
        scene: scene.display().to_string(),
        out: arguments.out.clone(),
        // The folder has the clip now; before, it was empty or could be overwritten.
        existing: Existing::Replace,
        settings,
        save_memory: Some(arguments.out.join("memory.ply")),
        load_memory: None,
    };
    say!("a camera moves through a rendered room: the built-in segmenter finds masks, and the memory keeps their ids");
    let summary = execute(&job)?;
    say!("{}", report(&job, &summary));
    say!("your own video: splatseg run FOLDER --out DIR");
    Ok(())
}

fn extract(folder: &Dir<'_>, to: &Path) -> Result<(), Failure> {
    let failed = |path: &Path, error: std::io::Error| Failure::work(format!("{}: {error}", path.display()));
    std::fs::create_dir_all(to).map_err(|error| failed(to, error))?;
    for inner in folder.dirs() {
        extract(inner, &to.join(inner.path().file_name().unwrap_or_default()))?;
    }
    for file in folder.files() {
        let path = to.join(file.path().file_name().unwrap_or_default());
        write_atomically(&path, file.contents()).map_err(Failure::work)?;
    }
    Ok(())
}
