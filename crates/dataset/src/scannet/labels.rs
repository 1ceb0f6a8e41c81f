//! ScanNet's instance labels, in a folder or in the published zip file.

use crate::DatasetError;
use crate::archive::ZippedImages;
use crate::decode::{decode_labels, read_labels};
use crate::error::SEGMENT_IMAGE;
use crate::listing::names_in;
use splatseg_geometry::SegmentMap;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// Folder of the labels, on disk and in the zip file.
const FOLDER: &str = "instance-filt";
const ZIP_ENDING: &str = "_2d-instance-filt.zip";

/// Location of a scene's labels, `instance-filt/<frame>.png`.
#[derive(Debug)]
pub(super) enum InstanceLabels {
    /// Folder that contains the images.
    Folder(PathBuf),
    /// The published zip file, read without unpacking it to disk.
    Zip(ZippedImages),
}

impl InstanceLabels {
    /// Finds the labels in a folder that contains one scene: the folder `instance-filt`, else the scene's own zip file,
    /// else the only zip file of labels.
    pub(super) fn in_folder(folder: &Path, scene: &str) -> Result<Option<Self>, DatasetError> {
        if folder.join(FOLDER).is_dir() {
            return Ok(Some(Self::Folder(folder.join(FOLDER))));
        }
        let own = format!("{scene}{ZIP_ENDING}");
        let zips: Vec<String> = names_in(folder).into_iter().filter(|name| name.ends_with(ZIP_ENDING)).collect();
        match zips.as_slice() {
            [] => Ok(None),
            [only] => Self::open_zip(&folder.join(only)).map(Some),
            several if several.contains(&own) => Self::open_zip(&folder.join(own)).map(Some),
            several => Err(DatasetError::Field {
                path: folder.to_owned(),
                field: "zip file of labels".to_owned(),
                found: several.join(", "),
                expected: format!("one, or {own}"),
            }),
        }
    }

    /// Finds the labels of a recording in a folder that may contain others: its own zip file, else the folder
    /// `instance-filt`.
    pub(super) fn beside(folder: &Path, scene: &OsStr) -> Result<Option<Self>, DatasetError> {
        let mut name = scene.to_owned();
        name.push(ZIP_ENDING);
        let zip = folder.join(name);
        if zip.is_file() {
            return Self::open_zip(&zip).map(Some);
        }
        Ok(folder.join(FOLDER).is_dir().then(|| Self::Folder(folder.join(FOLDER))))
    }

    fn open_zip(path: &Path) -> Result<Self, DatasetError> {
        ZippedImages::open(path).map(Self::Zip)
    }

    /// Reads the labels of the frame named `frame`, as stored, and the path of their image for messages; `None` if this
    /// frame is not labelled.
    pub(super) fn read(&self, frame: &str) -> Result<Option<(PathBuf, SegmentMap)>, DatasetError> {
        match self {
            Self::Folder(folder) => {
                let path = folder.join(format!("{frame}.png"));
                if !path.exists() {
                    return Ok(None);
                }
                let labels = read_labels(&path)?;
                Ok(Some((path, labels)))
            }
            Self::Zip(zip) => {
                let Some((path, bytes)) = zip.read(&format!("{FOLDER}/{frame}.png"), SEGMENT_IMAGE)? else {
                    return Ok(None);
                };
                let labels = decode_labels(&path, &bytes)?;
                Ok(Some((path, labels)))
            }
        }
    }
}
