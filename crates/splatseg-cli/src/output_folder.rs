//! The folder that a run writes to.
//!
//! Results are written to `.splatseg-new/` in the folder, and moved into place when they are complete. The earlier run's
//! files are removed only when the first frame's results are complete, and only those listed in its manifest. So a run
//! that cannot start loses nothing and leaves nothing behind.

use super::Failure;
use super::manifest::{EXTRA_FOLDERS, MANIFEST, Manifest, RESULT_FILES, RESULT_FOLDERS, SUMMARY, listed_files, place};
use super::run::saved_run::{self, SavedRun};
use splatseg_annotations::write_segments_png;
use splatseg_dataset::padded_number;
use splatseg_files::sync_file_system;
use splatseg_geometry::{CowImage, SegmentMap};
use splatseg_output::{FrameRecord, OutputError, ResultFolder, write_atomically, write_overlay_jpeg, write_unsynced};
use std::collections::BTreeSet;
use std::fs::{self, File, TryLockError};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Policy for existing results.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OverwritePolicy {
    /// Keep them: the run fails.
    Keep,
    /// Remove the results of an earlier run.
    Replace,
    /// Resume the run that wrote them.
    Resume,
}

impl OverwritePolicy {
    /// Returns the policy for the flag `--overwrite`.
    pub fn from_flag(overwrite: bool) -> Self {
        if overwrite { Self::Replace } else { Self::Keep }
    }
}

/// Staging folder for incomplete results. Leftovers of a killed run are ignored.
const STAGING: &str = ".splatseg-new";
/// File in the staging folder that reserves disk space for the summary, in case the disk gets full.
const RESERVE: &str = "reserve";
/// Size of the reserve, larger than any summary.
const RESERVE_BYTES: usize = 1 << 16;

/// A folder for results.
#[derive(Debug)]
pub struct OutputFolder {
    path: PathBuf,
    /// Files listed in the earlier run's manifest.
    earlier: BTreeSet<String>,
    /// The list of this run's files, once there are any.
    manifest: Option<Manifest>,
    /// Whether overlays are written.
    overlays: bool,
    /// The files that wait in the staging folder, and those that they leave nothing of, if all results are replaced at once.
    replacing: Option<Replacing>,
    // Dropped in this order, as only an empty folder can be removed.
    staging: Staging,
    _created: CreatedFolders,
}

/// Results that replace those of before together.
#[derive(Debug, Default)]
struct Replacing {
    complete: BTreeSet<String>,
    removed: BTreeSet<String>,
}

impl OutputFolder {
    /// Checks that results can be written to `path`: it does not exist, is an empty folder, or may be overwritten.
    pub fn check(path: &Path, existing: OverwritePolicy) -> Result<(), Failure> {
        let entries = match fs::read_dir(path) {
            Ok(entries) => entries,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
            Err(_) if path.is_file() => {
                let path = path.display();
                return Err(Failure::input(format!("{path}: is a file, expected a folder: choose another --out")));
            }
            Err(error) => return Err(Failure::input(format!("{}: {error}", path.display()))),
        };
        if existing == OverwritePolicy::Keep && entries.flatten().any(|entry| entry.file_name() != STAGING) {
            let resume = match SavedRun::settings_file(path) {
                Some(_) => ", or --resume to go on with the stopped run",
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

    /// Prepares the folder for the results of these frames, with overlays or without. Earlier results stay until the first new ones are complete.
    /// If there are no new results, nothing is left behind.
    ///
    /// # Errors
    /// If the folder cannot be written, contains files in the place of results that no manifest lists, or is in use by
    /// another run.
    pub fn prepare(path: &Path, existing: OverwritePolicy, frames: &[String], overlays: bool) -> Result<Self, Failure> {
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
            OverwritePolicy::Resume => Some(Manifest::resume(path, &earlier).map_err(unusable)?),
            _ => None,
        };
        Ok(Self { path: path.to_owned(), earlier, manifest, overlays, replacing: None, staging, _created: created })
    }

    /// Returns true if `path` may be a result in the folder `out`. Symbolic links must be resolved in both.
    pub fn is_result_place(out: &Path, path: &Path) -> bool {
        [MANIFEST].into_iter().chain(RESULT_FILES).chain(folders()).any(|place| path.starts_with(out.join(place)))
    }

    /// Path of the folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Path of the staging folder.
    pub fn staging(&self) -> &Path {
        &self.staging.path
    }

    /// Returns true if the run can be resumed with `--resume`.
    pub fn can_be_resumed(&self) -> bool {
        SavedRun::settings_file(&self.path).is_some()
    }

    /// Returns true if the folder contains results of any frame of this run.
    pub fn has_results(&self) -> bool {
        self.manifest.is_some()
    }

    /// Writes the images of a frame to the staging folder, then moves them into place.
    ///
    /// # Errors
    /// If one of them cannot be written. Writing later frames may still succeed.
    pub fn write_frame(&mut self, frame: &FrameRecord) -> Result<(), OutputError> {
        let [segments, overlay] = result_files(&frame.file_name);
        write_segments_png(&place(&self.staging.path, &segments), &frame.segments)
            .map_err(|error| self.error_in_place(&segments, error.into()))?;
        if self.overlays {
            write_overlay_jpeg(&place(&self.staging.path, &overlay), frame.frame.color(), &frame.segments)
                .map_err(|error| self.error_in_place(&overlay, error))?;
        }
        if self.manifest.is_none() {
            self.remove_earlier()?;
            self.manifest = Some(Manifest::start(&self.path).map_err(|source| self.error(MANIFEST, source))?);
        }
        let written = [segments.as_str(), &overlay];
        self.put_in_place(&written[..if self.overlays { 2 } else { 1 }])
    }

    /// From now on, complete files wait in the staging folder until [`Self::replace_all`]. If that is never called, the results
    /// stay as they are.
    pub fn begin_replacing(&mut self) {
        self.replacing = Some(Replacing::default());
    }

    /// Moves the files written since [`Self::begin_replacing`] into place.
    ///
    /// # Errors
    /// If one of them cannot be moved.
    pub fn replace_all(&mut self) -> Result<(), OutputError> {
        let Replacing { complete, removed } = self.replacing.take().unwrap_or_default();
        for file in &complete {
            self.put_in_place(&[file])?;
        }
        removed.iter().try_for_each(|file| self.remove(file))
    }

    /// Leaves the results as they were before [`Self::begin_replacing`].
    pub fn keep_all(&mut self) {
        self.replacing = None;
    }

    /// Writes the id image of an earlier frame again. `file` is its path relative to the folder.
    ///
    /// # Errors
    /// If it cannot be written. The earlier image stays.
    pub fn write_segments(&mut self, file: &str, segments: &SegmentMap) -> Result<(), OutputError> {
        write_segments_png(&place(&self.staging.path, file), segments)
            .map_err(|error| self.error_in_place(file, error.into()))?;
        self.put_in_place(&[file])
    }

    /// Writes the overlay of an earlier frame again, if overlays are written. `file` is its path relative to the folder.
    ///
    /// # Errors
    /// If it cannot be written. The earlier overlay stays.
    pub fn write_overlay(
        &mut self,
        file: &str,
        color: &CowImage<'_, [u8; 3]>,
        segments: &SegmentMap,
    ) -> Result<(), OutputError> {
        if !self.overlays {
            return Ok(());
        }
        write_overlay_jpeg(&place(&self.staging.path, file), color, segments)
            .map_err(|error| self.error_in_place(file, error))?;
        self.put_in_place(&[file])
    }

    /// Writes the summary of the run, once all other results are on the disk. There must be results.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write_summary(&mut self, text: &str) -> Result<(), OutputError> {
        let synced = self.sync();
        // If this fails, there was no reserve.
        let _ = fs::remove_file(self.staging.path.join(RESERVE));
        write_atomically(&self.staging.path.join(SUMMARY), text.as_bytes())
            .map_err(|error| self.error_in_place(SUMMARY, error))?;
        self.put_in_place(&[SUMMARY])?;
        synced.and(self.sync())
    }

    /// Waits until all results are on the disk.
    fn sync(&self) -> Result<(), OutputError> {
        sync_file_system(&self.path).map_err(|source| OutputError::Io { path: self.path.clone(), source })
    }

    /// Removes the earlier run's files, and creates folders for the new ones.
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

    /// Adds complete files to the manifest, and moves them into place, now or with all others.
    fn put_in_place(&mut self, files: &[&str]) -> Result<(), OutputError> {
        if let Some(Replacing { complete, removed }) = &mut self.replacing {
            for file in files {
                removed.remove(*file);
                complete.insert((*file).to_owned());
            }
            return Ok(());
        }
        if let Some(manifest) = &mut self.manifest {
            manifest.add(files).map_err(|source| self.error(MANIFEST, source))?;
        }
        for file in files {
            fs::rename(place(&self.staging.path, file), place(&self.path, file))
                .map_err(|source| self.error(file, source))?;
        }
        Ok(())
    }

    /// Replaces the staging path in an error by the file's final path.
    fn error_in_place(&self, file: &str, error: OutputError) -> OutputError {
        let path = place(&self.path, file);
        match error {
            OutputError::Io { source, .. } => OutputError::Io { path, source },
            OutputError::WriteIds(error) => OutputError::WriteIds(error.with_path(path)),
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
        write_unsynced(&place(&self.staging.path, file), bytes).map_err(|error| self.error_in_place(file, error))?;
        if let Some(folder) = place(&self.path, file).parent() {
            fs::create_dir_all(folder).map_err(|source| self.error(file, source))?;
        }
        self.put_in_place(&[file])
    }

    fn remove(&mut self, file: &str) -> Result<(), OutputError> {
        if let Some(Replacing { complete, removed }) = &mut self.replacing {
            complete.remove(file);
            removed.insert(file.to_owned());
            return Ok(());
        }
        match fs::remove_file(place(&self.path, file)) {
            Err(source) if source.kind() != ErrorKind::NotFound => Err(self.error(file, source)),
            _ => Ok(()),
        }
    }

    fn path_of(&self, file: &str) -> PathBuf {
        place(&self.path, file)
    }
}

/// Returns the name of a frame's result files, without folder and extension. Frame names may come from a file, so
/// separators are replaced to keep the path inside the folder.
pub fn file_name(frame: &str) -> String {
    padded_number(frame).replace(['/', '\\', '\0'], "_")
}

/// Returns the paths of a frame's id image and overlay in the folder.
pub fn result_files(file_name: &str) -> [String; 2] {
    RESULT_FOLDERS.map(|(folder, extension)| format!("{folder}/{file_name}.{extension}"))
}

/// Returns the folders that a run may write to.
fn folders() -> impl Iterator<Item = &'static str> {
    RESULT_FOLDERS.into_iter().chain(EXTRA_FOLDERS).map(|(folder, _)| folder).chain([STAGING, saved_run::FOLDER])
}

/// Refuses a path that exists and is not a folder. Through a link, results would be written or removed outside the folder.
fn refuse_other_than_folder(path: &Path) -> Result<(), Failure> {
    match fs::symlink_metadata(path) {
        Ok(metadata) if !metadata.is_dir() => {
            let found = if metadata.is_symlink() { "a symbolic link" } else { "a file" };
            Err(Failure::input(format!("{}: is {found}, expected a folder: choose another --out", path.display())))
        }
        _ => Ok(()),
    }
}

/// Refuses a folder where a file that no manifest lists would be replaced.
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
            "{}: is in the way, and no {MANIFEST} lists it as a splatseg result (0.1.0 wrote no such list): remove it, \
             or choose another --out",
            place(path, file).display()
        ))),
        None => Ok(()),
    }
}

/// Returns the entries of a folder of results, as paths relative to `path`.
fn files_in(path: &Path, folder: &'static str) -> impl Iterator<Item = String> {
    let entries = fs::read_dir(path.join(folder)).into_iter().flatten().flatten();
    entries.filter_map(move |entry| Some(format!("{folder}/{}", entry.file_name().to_str()?)))
}

/// The staging folder. It is locked while a run uses it, and removed afterwards.
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
            // Left by a killed run.
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
        // If this fails, the next run removes it.
        let _ = fs::remove_dir_all(&self.path);
    }
}

/// Folders that were created for results. Dropping this removes the empty ones.
#[derive(Debug)]
pub struct CreatedFolders {
    /// Innermost first.
    folders: Vec<PathBuf>,
}

impl CreatedFolders {
    /// Creates a folder and its parents, where they do not exist.
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
