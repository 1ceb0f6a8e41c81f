//! Paths that choose one of several videos.

use super::panoptic::{PanopticVideo, VideoChoice, read_panoptic, read_video_list};
use super::video_files::VideoFiles;
use crate::DatasetError;
use crate::archive::{MemberFlow, UnpackedMembers, for_each_member};
use crate::files::open_file;
use crate::listing::names_in;
use std::collections::BTreeSet;
use std::io::BufReader;
use std::path::{Path, PathBuf};

const IMAGES_FOLDER: &str = "imagesRGB";

/// Path of a video.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct VideoPath {
    place: Place,
    /// Name of the chosen video, if any.
    video: Option<String>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum Place {
    /// A folder with the annotation file and the image folders.
    Folder(PathBuf),
    /// A scene's `.tar.gz`.
    Archive(PathBuf),
}

/// Annotations of the chosen video.
pub(super) struct Annotations {
    pub(super) content: PanopticVideo,
    /// Their file, for messages.
    pub(super) path: PathBuf,
    /// Prefix of `imagesRGB/` in an archive, e.g. `00800-TEEsavR23oF/`; empty for a folder.
    pub(super) prefix: String,
}

/// Returns the required parts of a split's folder, each with true if the folder has it.
pub(crate) fn parts(path: &Path) -> Vec<(&'static str, bool)> {
    vec![
        ("panoptic_<split>.json", names_in(path).iter().any(|name| is_annotation_file(name))),
        ("imagesRGB/", path.join(IMAGES_FOLDER).is_dir()),
        ("imagesDEPTH/", path.join("imagesDEPTH").is_dir()),
    ]
}

/// Returns true if a path refers to MVPd, with or without the name of a video.
pub(crate) fn looks_like(path: &Path) -> bool {
    VideoPath::parse(path).is_some()
}

impl VideoPath {
    /// Parses `PLACE`, `PLACE:VIDEO` and `FOLDER/imagesRGB/VIDEO`. Never splits an existing path at a colon.
    pub(super) fn parse(path: &Path) -> Option<Self> {
        if path.exists() {
            return Place::at(path).map(|place| Self { place, video: None }).or_else(|| Self::from_images_folder(path));
        }
        let (place, video) = split_at_last_colon(path)?;
        let place = Place::at(&place)?;
        (!video.is_empty()).then_some(Self { place, video: Some(video) })
    }

    fn from_images_folder(path: &Path) -> Option<Self> {
        let images = path.parent()?;
        if images.file_name()? != IMAGES_FOLDER {
            return None;
        }
        let root = images.parent().filter(|root| !root.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let video = path.file_name()?.to_str()?.to_owned();
        Place::at(root).map(|place| Self { place, video: Some(video) })
    }

    /// Returns the name and number of images of every video at the path.
    pub(super) fn list_videos(&self) -> Result<Vec<(String, usize)>, DatasetError> {
        match &self.place {
            Place::Folder(folder) => {
                let path = folder.join(annotation_file(folder)?);
                read_video_list(BufReader::new(open_file(&path)?), &path)
            }
            Place::Archive(archive) => {
                let mut videos = None;
                for_each_member(archive, |name, _, content| {
                    if !is_annotation_file(name.rsplit('/').next().unwrap_or(name)) {
                        return Ok(MemberFlow::Continue);
                    }
                    videos = Some(read_video_list(BufReader::new(content), &archive.join(name))?);
                    Ok(MemberFlow::Stop)
                })?;
                videos.ok_or_else(|| no_annotations(archive))
            }
        }
    }

    /// Reads the annotations of the chosen video.
    pub(super) fn read_annotations(&self) -> Result<Annotations, DatasetError> {
        match &self.place {
            Place::Folder(folder) => {
                let path = folder.join(annotation_file(folder)?);
                let content = read_panoptic(BufReader::new(open_file(&path)?), &self.naming(&path))?;
                Ok(Annotations { content, path, prefix: String::new() })
            }
            Place::Archive(archive) => {
                let mut annotations = None;
                for_each_member(archive, |name, _, content| {
                    let (prefix, file) = name.rsplit_once('/').map_or(("", name), |(folder, file)| (folder, file));
                    if !is_annotation_file(file) {
                        return Ok(MemberFlow::Continue);
                    }
                    let prefix = if prefix.is_empty() { String::new() } else { format!("{prefix}/") };
                    let path = archive.join(name);
                    let content = read_panoptic(BufReader::new(content), &self.naming(&path))?;
                    annotations = Some(Annotations { content, path, prefix });
                    Ok(MemberFlow::Stop)
                })?;
                annotations.ok_or_else(|| no_annotations(archive))
            }
        }
    }

    /// Opens the files of the chosen video. `wanted` are their names, `prefix` is their prefix in an archive.
    pub(super) fn files(&self, prefix: &str, wanted: Vec<String>) -> Result<VideoFiles, DatasetError> {
        match &self.place {
            Place::Folder(folder) => Ok(VideoFiles::Folder(folder.clone())),
            Place::Archive(archive) => {
                let members: BTreeSet<String> = wanted.into_iter().map(|name| format!("{prefix}{name}")).collect();
                let members = UnpackedMembers::unpack(archive, &members)?;
                Ok(VideoFiles::Archive { members, prefix: prefix.to_owned() })
            }
        }
    }

    fn naming<'a>(&'a self, annotations: &'a Path) -> VideoChoice<'a> {
        let (Place::Folder(place) | Place::Archive(place)) = &self.place;
        VideoChoice { annotations, place, video: self.video.as_deref() }
    }
}

fn no_annotations(archive: &Path) -> DatasetError {
    DatasetError::MissingFile { path: archive.join("panoptic.json"), what: "file of annotations" }
}

/// Splits a path at its last colon. Only the part after it, the name of a video, must be UTF-8.
fn split_at_last_colon(path: &Path) -> Option<(PathBuf, String)> {
    #[cfg(unix)]
    {
        use std::os::unix::ffi::OsStrExt;
        let bytes = path.as_os_str().as_bytes();
        let colon = bytes.iter().rposition(|byte| *byte == b':')?;
        let place = PathBuf::from(std::ffi::OsStr::from_bytes(&bytes[..colon]));
        Some((place, std::str::from_utf8(&bytes[colon + 1..]).ok()?.to_owned()))
    }
    #[cfg(not(unix))]
    path.to_str()?.rsplit_once(':').map(|(place, video)| (PathBuf::from(place), video.to_owned()))
}

impl Place {
    /// Detects the kind of place at a path, which may not exist.
    fn at(path: &Path) -> Option<Self> {
        if path.is_dir() {
            let holds_videos =
                path.join(IMAGES_FOLDER).is_dir() && names_in(path).iter().any(|name| is_annotation_file(name));
            return holds_videos.then(|| Self::Folder(path.to_owned()));
        }
        let name = path.file_name()?.to_string_lossy().to_ascii_lowercase();
        let is_archive = path.is_file() && [".tar.gz", ".tgz"].iter().any(|ending| name.ends_with(ending));
        is_archive.then(|| Self::Archive(path.to_owned()))
    }
}

/// Returns true for `panoptic.json` and `panoptic_<split>.json`.
fn is_annotation_file(name: &str) -> bool {
    name.strip_prefix("panoptic")
        .and_then(|rest| rest.strip_suffix(".json"))
        .is_some_and(|rest| rest.is_empty() || rest.starts_with('_'))
}

fn annotation_file(folder: &Path) -> Result<String, DatasetError> {
    let mut names: Vec<String> = names_in(folder).into_iter().filter(|name| is_annotation_file(name)).collect();
    match (names.pop(), names.is_empty()) {
        (Some(only), true) => Ok(only),
        (last, _) => Err(DatasetError::Field {
            path: folder.to_owned(),
            field: "file of annotations".to_owned(),
            found: names.into_iter().chain(last).collect::<Vec<_>>().join(", "),
            expected: "one panoptic_<split>.json".to_owned(),
        }),
    }
}
