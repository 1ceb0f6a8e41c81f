//! Hashes of the input files of a result, to detect stored results whose inputs have changed.

use super::mesh_files::MeshFiles;
use crate::Failure;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use splatseg::settings::{Settings, SettingsInput};
use splatseg_files::read_file;
use splatseg_output::write_atomically;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::Metadata;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, SystemTime};

/// Largest file of hashes that is read, bytes.
const MAX_CACHE_BYTES: u64 = 64_000_000;
/// Coarsest resolution of file times. A file that changed this recently can change again without a different time.
const COARSEST_CLOCK: Duration = Duration::from_secs(2);

/// An input file or folder, with the hash of its content.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InputFile {
    /// Path of the file or folder.
    pub path: String,
    /// Number of files in the folder; 1 for a file.
    pub files: u64,
    /// Total size, bytes.
    pub bytes: u64,
    /// SHA-256 of the names and contents of all files.
    pub sha256: String,
}

/// A cached hash, with the state of the files it was computed from: names, sizes and times. The times include the status
/// change time (ctime) on systems that have it. Unlike the modification time, programs cannot set it back.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Cached {
    state: String,
    input: InputFile,
}

/// Hashes input files. A file is read only once. A list of hashes in the folder of results avoids reading it in later
/// runs, unless its size or a time has changed.
pub struct InputHashes {
    cache: PathBuf,
    /// The folder of results. It is never an input, even if it is inside one.
    out: PathBuf,
    known: Mutex<Known>,
}

#[derive(Default)]
struct Known {
    /// Hashes of the list in the folder of results, by path.
    cached: BTreeMap<String, Cached>,
    /// Inputs hashed or looked up in this run, by path.
    found: BTreeMap<PathBuf, InputFile>,
}

impl InputHashes {
    /// Reads the list of hashes in the folder of results, if there is one.
    pub fn open(out: &Path) -> Self {
        let cache = out.join("input_hashes.json");
        let bytes = read_file(&cache, MAX_CACHE_BYTES).unwrap_or_default();
        let known = Known { cached: serde_json::from_slice(&bytes).unwrap_or_default(), ..Known::default() };
        let out = out.canonicalize().unwrap_or_else(|_| out.to_owned());
        Self { cache, out, known: Mutex::new(known) }
    }

    /// Returns the input files that affect the result of a scene with these settings.
    ///
    /// # Errors
    /// Names the file that cannot be read.
    pub fn of(&self, scene: &Path, settings: &Settings, mesh: Option<&MeshFiles>) -> Result<Vec<InputFile>, String> {
        let mut paths = scene_files(scene);
        paths.extend(mesh.map(MeshFiles::paths).unwrap_or_default());
        let is_used = |input: &SettingsInput<'_>| !input.is_of_segmenter || settings.method.uses_segmenter();
        paths.extend(settings.input_files().into_iter().filter(is_used).map(|input| input.path.to_owned()));
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        paths.iter().map(|path| self.input(path, &mut known)).collect()
    }

    /// Writes the list of hashes.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn save(&self) -> Result<(), Failure> {
        let known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        let text = serde_json::to_vec_pretty(&known.cached).map_err(Failure::runtime)?;
        write_atomically(&self.cache, &text).map_err(Failure::runtime)
    }

    fn input(&self, path: &Path, known: &mut Known) -> Result<InputFile, String> {
        if let Some(found) = known.found.get(path) {
            return Ok(found.clone());
        }
        let wrong = |error: std::io::Error| format!("{}: {error}", path.display());
        let mut files = Vec::new();
        self.list(path, &mut files, &mut BTreeSet::new()).map_err(wrong)?;
        files.sort_by(|(a, _), (b, _)| a.cmp(b));
        let state = state_of(&files);
        let key = path.canonicalize().map_err(wrong)?.to_string_lossy().into_owned();
        let cached = known.cached.get(&key).filter(|cached| cached.state == state);
        let input = match cached {
            Some(cached) => InputFile { path: path.display().to_string(), ..cached.input.clone() },
            None => content_of(path, &files).map_err(|(path, error)| format!("{}: {error}", path.display()))?,
        };
        if is_settled(&files) {
            known.cached.insert(key, Cached { state, input: input.clone() });
        }
        known.found.insert(path.to_owned(), input.clone());
        Ok(input)
    }

    /// Adds the file at a path, or all files in the folder. Each folder is listed only once, as links may form a cycle.
    fn list(
        &self,
        path: &Path,
        files: &mut Vec<(PathBuf, Metadata)>,
        folders: &mut BTreeSet<PathBuf>,
    ) -> std::io::Result<()> {
        let metadata = std::fs::metadata(path)?;
        if metadata.is_file() {
            files.push((path.to_owned(), metadata));
        } else if metadata.is_dir() && path.canonicalize()? != self.out && folders.insert(path.canonicalize()?) {
            for entry in std::fs::read_dir(path)? {
                let path = entry?.path();
                // A broken link is not an input.
                if path.exists() {
                    self.list(&path, files, folders)?;
                }
            }
        }
        Ok(())
    }
}

/// Returns the files and folders that a scene is read from. Some formats have further files beside the scene, in the same
/// folder under the scene's name, or one folder up.
fn scene_files(scene: &Path) -> Vec<PathBuf> {
    let chosen = scene.to_str().filter(|_| !scene.exists()).and_then(|scene| scene.rsplit_once(':'));
    let place = chosen.map(|(place, _)| Path::new(place));
    if let Some(video) = chosen.and_then(|(folder, video)| mvpd_video_files(Path::new(folder), video)) {
        return video;
    }
    let Some(path) = [Some(scene), place].into_iter().flatten().find(|path| path.exists()) else {
        return Vec::new();
    };
    let full = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let parent = full.parent().unwrap_or(Path::new("/"));
    let mut paths = vec![path.to_owned()];
    if path.is_file() {
        // ScanNet's labels beside a recording.
        let stem = full.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let siblings = std::fs::read_dir(parent).into_iter().flatten().flatten().map(|entry| entry.path());
        let mut labels: Vec<PathBuf> = siblings
            .filter(|sibling| {
                let name = sibling.file_name().unwrap_or_default().to_string_lossy();
                *sibling != full && (name.starts_with(&stem) || name.contains("instance-filt"))
            })
            .collect();
        labels.sort();
        paths.extend(labels);
    } else if let Some(split) = parent.parent().filter(|_| parent.ends_with("imagesRGB")) {
        let video = full.file_name().unwrap_or_default().to_string_lossy();
        paths = mvpd_video_files(split, &video).unwrap_or_else(|| vec![split.to_owned()]);
    } else {
        // Replica's camera, shared by several rooms.
        paths.extend(Some(parent.join("cam_params.json")).filter(|camera| camera.is_file()));
    }
    paths
}

/// Returns the files of one video of an MVPd split, where depth and labels are in separate folders and one annotation file
/// covers all videos. Returns `None` if the folder has a different layout.
fn mvpd_video_files(split: &Path, video: &str) -> Option<Vec<PathBuf>> {
    if !split.join("imagesRGB").is_dir() {
        return None;
    }
    let folders = ["imagesRGB", "imagesDEPTH", "panomasksRGB"].map(|folder| split.join(folder).join(video));
    let mut paths: Vec<PathBuf> = folders.into_iter().filter(|folder| folder.is_dir()).collect();
    let entries = std::fs::read_dir(split).ok()?.flatten().map(|entry| entry.path());
    let is_annotations = |path: &PathBuf| path.extension().is_some_and(|extension| extension == "json");
    let mut annotations: Vec<PathBuf> = entries.filter(|path| path.is_file() && is_annotations(path)).collect();
    annotations.sort();
    paths.extend(annotations);
    Some(paths)
}

fn content_of(path: &Path, files: &[(PathBuf, Metadata)]) -> Result<InputFile, (PathBuf, std::io::Error)> {
    let mut hash = Sha256::new();
    let (mut bytes, mut buffer) = (0, vec![0; 1 << 16]);
    for (file, metadata) in files {
        let wrong = |error| (file.clone(), error);
        // The lengths first, so that the end of a file cannot be confused with the start of the next.
        let name = file.strip_prefix(path).unwrap_or(file).to_string_lossy();
        hash.update(format!("{}:{name}:{}:", name.len(), metadata.len()));
        let mut reader = std::fs::File::open(file).map_err(wrong)?.take(metadata.len());
        loop {
            let read = reader.read(&mut buffer).map_err(wrong)?;
            if read == 0 {
                break;
            }
            hash.update(&buffer[..read]);
            bytes += read as u64;
        }
    }
    let sha256 = hex(&hash.finalize());
    Ok(InputFile { path: path.display().to_string(), files: files.len() as u64, bytes, sha256 })
}

/// Hashes the files' names, sizes and times.
fn state_of(files: &[(PathBuf, Metadata)]) -> String {
    let mut hash = Sha256::new();
    for (path, metadata) in files {
        let name = path.to_string_lossy();
        hash.update(format!("{}:{name}:{}:{:?}:", name.len(), metadata.len(), metadata.modified().ok()));
        #[cfg(unix)]
        {
            use std::os::unix::fs::MetadataExt;
            hash.update(format!("{}:{}:{}:", metadata.ino(), metadata.ctime(), metadata.ctime_nsec()));
        }
    }
    hex(&hash.finalize())
}

/// Returns true if any later change to these files will change their times.
fn is_settled(files: &[(PathBuf, Metadata)]) -> bool {
    let now = SystemTime::now();
    files.iter().all(|(_, metadata)| {
        let age = |time: SystemTime| now.duration_since(time).unwrap_or_default();
        #[cfg(unix)]
        let changed = {
            use std::os::unix::fs::MetadataExt;
            let seconds = u64::try_from(metadata.ctime()).unwrap_or_default();
            Some(SystemTime::UNIX_EPOCH + Duration::from_secs(seconds))
        };
        #[cfg(not(unix))]
        let changed = metadata.modified().ok();
        changed.is_some_and(|changed| age(changed) > COARSEST_CLOCK)
    })
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use splatseg::settings::{MaskFolderSettings, SegmenterSettings};

    fn demo() -> PathBuf {
        concat!(env!("CARGO_MANIFEST_DIR"), "/demo").into()
    }

    #[test]
    fn files_whose_sizes_and_times_are_known_are_not_read_again() {
        let out = tempfile::tempdir().unwrap();
        let hashes = InputHashes::open(out.path());
        let settings = Settings::default();
        let read = hashes.of(&demo(), &settings, None).unwrap();
        assert!(read[0].files > 100 && read[0].bytes > 100_000, "{read:?}");
        hashes.save().unwrap();

        // A hash that can only come from the list.
        let list = out.path().join("input_hashes.json");
        let text = std::fs::read_to_string(&list).unwrap();
        assert!(text.contains(&read[0].sha256));
        std::fs::write(&list, text.replace(&read[0].sha256, "of the list")).unwrap();
        assert_eq!(InputHashes::open(out.path()).of(&demo(), &settings, None).unwrap()[0].sha256, "of the list");

        // An entry with another state is ignored.
        let state = hashes.known.lock().unwrap().cached.values().next().unwrap().state.clone();
        let text = std::fs::read_to_string(&list).unwrap().replace(&state, "another state");
        std::fs::write(&list, text).unwrap();
        assert_eq!(InputHashes::open(out.path()).of(&demo(), &settings, None).unwrap(), read);
        // A damaged list is ignored.
        std::fs::write(&list, "{").unwrap();
        assert_eq!(InputHashes::open(out.path()).of(&demo(), &settings, None).unwrap(), read);
    }

    #[test]
    fn a_changed_name_size_or_byte_is_another_content() {
        let folder = tempfile::tempdir().unwrap();
        let scene = folder.path().join("scene");
        std::fs::create_dir_all(scene.join("color")).unwrap();
        let hash = || {
            let hashes = InputHashes::open(&folder.path().join("out"));
            hashes.of(&scene, &Settings::default(), None).unwrap()[0].sha256.clone()
        };
        let mut seen = vec![hash()];
        let mut expect_another = |what: &str| {
            let hash = hash();
            assert!(!seen.contains(&hash), "{what}");
            seen.push(hash);
        };
        std::fs::write(scene.join("color/1"), "ab").unwrap();
        expect_another("a new file");
        std::fs::write(scene.join("color/1"), "ac").unwrap();
        expect_another("another byte");
        std::fs::rename(scene.join("color/1"), scene.join("color/2")).unwrap();
        expect_another("another name");
        std::fs::write(scene.join("color/2"), "acd").unwrap();
        expect_another("another size");
        // A link that forms a cycle, and a broken link.
        #[cfg(unix)]
        for (target, name) in [("..", "circle"), ("nowhere", "nothing")] {
            std::os::unix::fs::symlink(target, scene.join("color").join(name)).unwrap();
            assert_eq!(&hash(), seen.last().unwrap());
        }
    }

    #[cfg(unix)]
    #[test]
    fn weights_that_changed_behind_the_same_size_and_time_are_noticed() {
        let folder = tempfile::tempdir().unwrap();
        let weights = folder.path().join("weights.pt");
        std::fs::write(&weights, "old").unwrap();
        std::thread::sleep(COARSEST_CLOCK + Duration::from_millis(1100));
        let mut settings = Settings::default();
        let fastsam = SegmenterSettings::of(splatseg_models::fastsam::FastSamPredictorSettings::default());
        settings.segmenter = fastsam.with_file("weights", &weights);
        let hash = || {
            let hashes = InputHashes::open(folder.path());
            let found = hashes.of(Path::new("synthetic"), &settings, None).unwrap();
            hashes.save().unwrap();
            found
        };
        let old = hash();
        let list = std::fs::read_to_string(folder.path().join("input_hashes.json")).unwrap();
        assert!(list.contains(&old[0].sha256), "{list}");

        let modified = std::fs::metadata(&weights).unwrap().modified().unwrap();
        std::fs::write(&weights, "new").unwrap();
        std::fs::File::options().append(true).open(&weights).unwrap().set_modified(modified).unwrap();
        assert_eq!(std::fs::metadata(&weights).unwrap().modified().unwrap(), modified);
        assert_ne!(hash(), old);
    }

    #[test]
    fn only_files_in_use_are_inputs() {
        let out = tempfile::tempdir().unwrap();
        let hashes = InputHashes::open(out.path());
        let room = Path::new("synthetic:frames=3");
        assert_eq!(hashes.of(room, &Settings::default(), None), Ok(Vec::new()));
        let mut masks = Settings::default();
        let folder = SegmenterSettings::of(MaskFolderSettings::default());
        masks.segmenter = folder.clone().with_file("masks", demo());
        assert_eq!(hashes.of(room, &masks, None).unwrap().len(), 1);
        masks.segmenter = folder.with_file("masks", "/nowhere");
        assert!(hashes.of(room, &masks, None).unwrap_err().contains("/nowhere"));
    }
}
