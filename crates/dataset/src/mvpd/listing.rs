//! All videos of MVPd in a folder.

use super::video_path::VideoPath;
use crate::DatasetError;
use crate::files::open_file;
use crate::listing::names_in;
use serde::Deserialize;
use std::collections::BTreeSet;
use std::ffi::OsString;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

/// The split that results are published for.
const TEST_SPLIT: &str = "test";
/// The authors' list of the videos of a split that count: the others show nothing in some frames.
const ACCEPTED_VIDEOS: &str = "empty_videos.json";
/// The published list takes 80 kB.
const MAX_LIST_BYTES: u64 = 100_000_000;

/// A video of MVPd.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MvpdVideo {
    /// Where it is, as [`crate::open_scene`] takes it: `FOLDER:VIDEO` or `SCENE.tar.gz:VIDEO`.
    pub path: PathBuf,
    /// Its name.
    pub name: String,
    /// Number of its frames.
    pub frames: usize,
}

/// The videos of a split.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MvpdVideos {
    /// The videos, in the order of their places and files.
    pub videos: Vec<MvpdVideo>,
    /// Number of videos that are left out, as `empty_videos.json` does not accept them; `None` without such a file.
    pub rejected: Option<usize>,
    /// The folder that they are in.
    pub split: PathBuf,
}

/// The content of `empty_videos.json`.
#[derive(Deserialize)]
struct AcceptedVideos {
    accepted: BTreeSet<String>,
}

impl MvpdVideos {
    /// The videos of a folder: of the split that it is, of the scenes' archives in it, or of its subfolder `test`. Where the
    /// split has the authors' `empty_videos.json`, only the videos that this accepts. Without any video the list is empty.
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

/// The split's folder itself, or the archives in it.
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
