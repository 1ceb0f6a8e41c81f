//! Listing of all MVPd videos in a folder.

use super::video_path::VideoPath;
use crate::DatasetError;
use crate::files::open_file;
use crate::listing::names_in;
use serde::Deserialize;
use std::collections::BTreeSet;
use std::ffi::OsString;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

/// Split with published results.
const TEST_SPLIT: &str = "test";
/// The authors' list of a split's accepted videos. The others show nothing in some frames.
const ACCEPTED_VIDEOS: &str = "empty_videos.json";
/// Maximum file size. The published list has 80 kB.
const MAX_LIST_BYTES: u64 = 100_000_000;

/// An MVPd video.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MvpdVideo {
    /// Its path for [`crate::open_scene`]: `FOLDER:VIDEO` or `SCENE.tar.gz:VIDEO`.
    pub path: PathBuf,
    /// Its name.
    pub name: String,
    /// Number of its frames.
    pub frames: usize,
}

/// The videos of a split.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MvpdVideos {
    /// The videos, in the order of the archives and of their annotation files.
    pub videos: Vec<MvpdVideo>,
    /// Number of videos skipped because `empty_videos.json` does not accept them; `None` without such a file.
    pub rejected: Option<usize>,
    /// Folder that contains them.
    pub split: PathBuf,
}

/// Content of `empty_videos.json`.
#[derive(Deserialize)]
struct AcceptedVideos {
    accepted: BTreeSet<String>,
}

impl MvpdVideos {
    /// Finds the videos of a folder: of the split, if the folder is one, of the scene archives in it, or of its
    /// subfolder `test`. If the split has the authors' `empty_videos.json`, only accepted videos. The list is empty if
    /// there are none.
    ///
    /// # Errors
    /// If annotations, an archive or the list of accepted videos cannot be read.
    pub fn find(folder: &Path) -> Result<Self, DatasetError> {
        let test = folder.join(TEST_SPLIT);
        let split = if places_in(folder).is_empty() && test.is_dir() { test } else { folder.to_owned() };
        let accepted = accepted_videos(&split.join(ACCEPTED_VIDEOS))?;
        let mut found = Self { rejected: accepted.is_some().then_some(0), split, ..Self::default() };
        for (place, path) in places_in(&found.split) {
            for (name, frames) in path.list_videos()? {
                if accepted.as_ref().is_some_and(|accepted| !accepted.contains(&name)) {
                    found.rejected = found.rejected.map(|rejected| rejected + 1);
                    continue;
                }
                let mut path = OsString::from(&place);
                path.push(format!(":{name}"));
                found.videos.push(MvpdVideo { path: path.into(), name, frames });
            }
        }
        Ok(found)
    }
}

/// Returns the split's folder itself, or the archives in it.
fn places_in(folder: &Path) -> Vec<(PathBuf, VideoPath)> {
    let place = |path: PathBuf| VideoPath::parse(&path).map(|parsed| (path, parsed));
    match place(folder.to_owned()) {
        Some(own) => vec![own],
        None => {
            let names = names_in(folder).into_iter().map(|name| folder.join(name));
            names.filter(|path| path.is_file()).filter_map(place).collect()
        }
    }
}

fn accepted_videos(path: &Path) -> Result<Option<BTreeSet<String>>, DatasetError> {
    if !path.exists() {
        return Ok(None);
    }
    let reader = BufReader::new(open_file(path)?.take(MAX_LIST_BYTES));
    let list: AcceptedVideos =
        serde_json::from_reader(reader).map_err(|source| DatasetError::Json { path: path.to_owned(), source })?;
    Ok(Some(list.accepted))
}
