//! The folder that a run writes to.
//!
//! Results are written beside, to `.splatseg-new/` in the folder, and moved to their place when they are complete. Only
//! when the first frame's are complete are the earlier run's files removed: those that its manifest lists, and no others.
//! So a run that cannot start loses nothing and leaves nothing behind.

use super::Failure;
use super::manifest::{EXTRA_FOLDERS, MANIFEST, Manifest, RESULT_FILES, RESULT_FOLDERS, SUMMARY, listed_files, place};
use super::run::saved_run::{self, SavedRun};
use splatseg_dataset::padded_number;
use splatseg_output::{
    FrameRecord, OutputError, ResultFolder, write_atomically, write_overlay_jpeg, write_segments_png,
};
use std::collections::BTreeSet;
use std::fs::{self, File, TryLockError};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// What to do with existing results.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Existing {
    /// Leave them alone: the run fails.
    Keep,
    /// Remove what an earlier run wrote.
    Replace,
    /// Go on with the run that wrote them.
    Resume,
}

impl Existing {
    /// What `--overwrite` asks for.
    pub fn from_flag(overwrite: bool) -> Self {
        if overwrite { Self::Replace } else { Self::Keep }
    }
}

/// The folder of what is not in place yet. One that a killed run has left counts as nothing.
const STAGING: &str = ".splatseg-new";
/// A file in it that holds room for the summary, for the case that the disk is full when it is written.
const RESERVE: &str = "reserve";
/// More than any summary takes.
const RESERVE_BYTES: usize = 1 << 16;

/// A folder that takes results.
#[derive(Debug)]
pub struct OutputFolder {
    path: PathBuf,
    /// What the earlier run's manifest lists.
    earlier: BTreeSet<String>,
    /// The list of this run's files, as soon as there are any.
    manifest: Option<Manifest>,
    // Dropped in this order: a folder can be removed only when it is empty.
    staging: Staging,
    _created: CreatedFolders,
}

impl OutputFolder {
    /// Checks that results can be written to `path`: it does not exist, is an empty folder, or may be overwritten.
    pub fn check(path: &Path, existing: Existing) -> Result<(), Failure> {
        let entries = match fs::read_dir(path) {
            Ok(entries) => entries,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
            Err(error) => return Err(Failure::input(format!("{}: {error}", path.display()))),
        };
        if existing == Existing::Keep && entries.flatten().any(|entry| entry.file_name() != STAGING) {
            let resume = match SavedRun::settings_file(path) {
                Some(_) => ", or --resume to go on with the run that was stopped",
                None => "",
            };
            return Err(Failure::input(format!(
                "{}: the folder is not empty: choose another --out, or give --overwrite to replace earlier \
                 results{resume}",
                path.display()
            )));
        }
        Ok(())
    }

    /// Gets the folder ready for the results of these frames. Earlier results stay until the first new ones are there.
    /// If there never are any, nothing is left behind.
    ///
    /// # Errors
    /// If the folder cannot be written, has files in the place of results that no manifest lists, or is being written by
    /// another run.
    pub fn prepare(path: &Path, existing: Existing, frames: &[String]) -> Result<Self, Failure> {
        Self::check(path, existing)?;
        for folder in folders() {
            refuse_other_than_folder(&path.join(folder))?;
        }
        let earlier = listed_files(path)?;
        refuse_files_of_others(path, &earlier, frames)?;
        let unusable =
            |error: std::io::Error| Failure::input(format!("{}: cannot be written: {error}", path.display()));
        let created = CreatedFolders::create(path).map_err(unusable)?;
        let staging = Staging::create(path)?;
        let manifest = match existing {
            Existing::Resume => Some(Manifest::resume(path).map_err(unusable)?),
            _ => None,
        };
        Ok(Self { path: path.to_owned(), earlier, manifest, staging, _created: created })
    }

    /// Whether a path is where the results in the folder `out` are. Both are without symbolic links.
    pub fn is_result_place(out: &Path, path: &Path) -> bool {
        [MANIFEST].into_iter().chain(RESULT_FILES).chain(folders()).any(|place| path.starts_with(out.join(place)))
    }

    /// The folder itself.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The folder of what is not in place yet.
    pub fn staging(&self) -> &Path {
        &self.staging.path
    }

    /// Whether `--resume` can go on with the run.
    pub fn can_be_resumed(&self) -> bool {
        SavedRun::settings_file(&self.path).is_some()
    }

    /// Whether any frame's results are in the folder.
    pub fn has_results(&self) -> bool {
        self.manifest.is_some()
    }

    /// Writes the images of a frame: beside, and then to their place.
    ///
    /// # Errors
    /// If one of them cannot be written; later frames may be.
    pub fn write_frame(&mut self, frame: &FrameRecord) -> Result<(), OutputError> {
        let [segments, overlay] = result_files(&frame.file_name);
        write_segments_png(&place(&self.staging.path, &segments), &frame.segments)
            .map_err(|error| self.error_in_place(&segments, error))?;
        write_overlay_jpeg(&place(&self.staging.path, &overlay), frame.frame.color(), &frame.segments)
            .map_err(|error| self.error_in_place(&overlay, error))?;
        if self.manifest.is_none() {
            self.remove_earlier()?;
            self.manifest = Some(Manifest::start(&self.path).map_err(|source| self.error(MANIFEST, source))?);
        }
        self.put_in_place(&[&segments, &overlay])
    }

    /// Writes the description of the run. There must be results.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write_summary(&mut self, text: &str) -> Result<(), OutputError> {
        // If this fails there was no reserve.
        let _ = fs::remove_file(self.staging.path.join(RESERVE));
        write_atomically(&self.staging.path.join(SUMMARY), text.as_bytes())
            .map_err(|error| self.error_in_place(SUMMARY, error))?;
        self.put_in_place(&[SUMMARY])
    }

    /// Removes the earlier run's files, and makes folders for the new ones.
    fn remove_earlier(&self) -> Result<(), OutputError> {
        saved_run::remove(&self.path).map_err(|source| self.error(saved_run::FOLDER, source))?;
        for file in &self.earlier {
            match fs::remove_file(place(&self.path, file)) {
                Err(source) if source.kind() != ErrorKind::NotFound => return Err(self.error(file, source)),
                _ => {}
            }
        }
        for (folder, _) in RESULT_FOLDERS {
            fs::create_dir_all(self.path.join(folder)).map_err(|source| self.error(folder, source))?;
        }
        Ok(())
    }

    /// Lists files that are complete, and moves them to their place.
    fn put_in_place(&mut self, files: &[&str]) -> Result<(), OutputError> {
        if let Some(manifest) = &mut self.manifest {
            manifest.add(files).map_err(|source| self.error(MANIFEST, source))?;
        }
        for file in files {
            fs::rename(place(&self.staging.path, file), place(&self.path, file))
                .map_err(|source| self.error(file, source))?;
        }
        Ok(())
    }

    /// The error of a file that was written beside, with the path of its place.
    fn error_in_place(&self, file: &str, error: OutputError) -> OutputError {
        let path = place(&self.path, file);
        match error {
            OutputError::Io { source, .. } => OutputError::Io { path, source },
            OutputError::IdTooLarge { id, .. } => OutputError::IdTooLarge { path, id },
            OutputError::Encode { source, .. } => OutputError::Encode { path, source },
            error => error,
        }
    }

    fn error(&self, file: &str, source: std::io::Error) -> OutputError {
        OutputError::Io { path: place(&self.path, file), source }
    }
}

impl ResultFolder for OutputFolder {
    fn write(&mut self, file: &str, bytes: &[u8]) -> Result<(), OutputError> {
        write_atomically(&place(&self.staging.path, file), bytes).map_err(|error| self.error_in_place(file, error))?;
        if let Some(folder) = place(&self.path, file).parent() {
            fs::create_dir_all(folder).map_err(|source| self.error(file, source))?;
        }
        self.put_in_place(&[file])
    }

    fn path_of(&self, file: &str) -> PathBuf {
        place(&self.path, file)
    }
}

/// The name of the result files of a frame, without folder and extension. A scene's names may come from a file, and must
/// not lead out of the folder.
pub fn file_name(frame: &str) -> String {
    padded_number(frame).replace(['/', '\\', '\0'], "_")
}

/// The ids and the overlay of a frame, by their paths in the folder.
pub fn result_files(file_name: &str) -> [String; 2] {
    RESULT_FOLDERS.map(|(folder, extension)| format!("{folder}/{file_name}.{extension}"))
}

/// The folders that a run may write to.
fn folders() -> impl Iterator<Item = &'static str> {
    RESULT_FOLDERS.into_iter().chain(EXTRA_FOLDERS).map(|(folder, _)| folder).chain([STAGING, saved_run::FOLDER])
}

/// A link would lead results, or the removal of earlier ones, out of the folder.
fn refuse_other_than_folder(path: &Path) -> Result<(), Failure> {
    match fs::symlink_metadata(path) {
        Ok(metadata) if !metadata.is_dir() => {
            let found = if metadata.is_symlink() { "a symbolic link" } else { "a file" };
            Err(Failure::input(format!("{}: is {found}, expected a folder: choose another --out", path.display())))
        }
        _ => Ok(()),
    }
}

/// Refuses a folder where something that no manifest lists would be replaced.
fn refuse_files_of_others(path: &Path, earlier: &BTreeSet<String>, frames: &[String]) -> Result<(), Failure> {
    let new: BTreeSet<String> = frames.iter().flat_map(|frame| result_files(&file_name(frame))).collect();
    let mut found = Vec::new();
    for (folder, _) in RESULT_FOLDERS {
        found.extend(files_in(path, folder));
    }
    found.retain(|file| new.contains(file));
    for (folder, extension) in EXTRA_FOLDERS {
        let is_taken = |file: &String| file.ends_with(&format!(".{extension}"));
        found.extend(files_in(path, folder).filter(is_taken));
    }
    found.extend(RESULT_FILES.into_iter().filter(|file| path.join(file).symlink_metadata().is_ok()).map(str::to_owned));
    found.sort_unstable();
    let is_ours = |file: &String| earlier.contains(file) && !place(path, file).is_dir();
    match found.iter().find(|file| !is_ours(file)) {
        Some(file) => Err(Failure::input(format!(
            "{}: is in the way, and no {MANIFEST} says that splatseg wrote it (results of 0.1.0 have none): remove it, \
             or choose another --out",
            place(path, file).display()
        ))),
        None => Ok(()),
    }
}

/// What is in a folder of results, by its path in `path`.
fn files_in(path: &Path, folder: &'static str) -> impl Iterator<Item = String> {
    let entries = fs::read_dir(path.join(folder)).into_iter().flatten().flatten();
    entries.filter_map(move |entry| Some(format!("{folder}/{}", entry.file_name().to_str()?)))
}

/// The folder of what is not in place yet. It is locked while a run uses it, and removed after.
#[derive(Debug)]
struct Staging {
    path: PathBuf,
    _lock: File,
}

impl Staging {
    fn create(folder: &Path) -> Result<Self, Failure> {
        let path = folder.join(STAGING);
        let unusable = |error| Failure::input(format!("{}: cannot be written: {error}", folder.display()));
        fs::create_dir_all(&path).map_err(unusable)?;
        let lock = File::create(path.join("lock")).map_err(unusable)?;
        if let Err(TryLockError::WouldBlock) = lock.try_lock() {
            return Err(Failure::input(format!("{}: another run is writing to this folder", folder.display())));
        }
        let staging = Self { path, _lock: lock };
        for (results, _) in RESULT_FOLDERS.into_iter().chain(EXTRA_FOLDERS) {
            let results = staging.path.join(results);
            // A killed run's.
            match fs::remove_dir_all(&results) {
                Err(error) if error.kind() != ErrorKind::NotFound => return Err(unusable(error)),
                _ => fs::create_dir(&results).map_err(unusable)?,
            }
        }
        // Without a reserve the run can still succeed.
        let _ = fs::write(staging.path.join(RESERVE), vec![b' '; RESERVE_BYTES]);
        Ok(staging)
    }
}

impl Drop for Staging {
    fn drop(&mut self) {
        // If this fails, the next run does it.
        let _ = fs::remove_dir_all(&self.path);
    }
}

/// Folders that were made for results. Those that are empty in the end are removed again.
#[derive(Debug)]
pub struct CreatedFolders {
    /// The innermost first.
    folders: Vec<PathBuf>,
}

impl CreatedFolders {
    /// Creates a folder and those around it, where they do not exist.
    pub fn create(path: &Path) -> std::io::Result<Self> {
        let is_missing = |folder: &&Path| !folder.as_os_str().is_empty() && !folder.exists();
        let created = Self { folders: path.ancestors().take_while(is_missing).map(Path::to_owned).collect() };
        fs::create_dir_all(path)?;
        Ok(created)
    }
}

impl Drop for CreatedFolders {
    fn drop(&mut self) {
        for folder in &self.folders {
            let _ = fs::remove_dir(folder);
        }
    }
}
