//! Finds the inputs of the paper's tables: scenes and checkpoints in the user's folders.

use super::other_trackers::OtherTracker;
use crate::Failure;
use splatseg_dataset::{DatasetSettings, MvpdVideos, open_scene};
use splatseg_files::{read_file, text_of};
use splatseg_models::checkpoint::{Architecture, Checkpoint};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// ScanNet's list of its validation split: scene names, one per line.
const VALIDATION_SPLIT: &str = "scannetv2_val.txt";
/// Largest list of scenes that is read, bytes. ScanNet's list takes 4 kB.
const MAX_SPLIT_BYTES: u64 = 10_000_000;

/// Source of ScanNet.
const SCANNET_PAGE: &str = "http://www.scan-net.org, after signing its terms of use";

/// An input of the paper's tables.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Input {
    /// Scenes of ScanNet.
    Scenes,
    /// The missing scenes of the validation split, if only some were found.
    RestOfTheSplit,
    /// FastSAM's checkpoint.
    FastSam,
    /// SAM 2.1's checkpoint.
    Sam2,
    /// The dataset MVPd.
    Mvpd,
}

/// An input that was not found, with its source.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MissingInput {
    /// The input.
    pub input: Input,
    /// Name of the input, and the rows that need it.
    pub what: String,
    /// Web page of the input's publisher.
    pub published: &'static str,
}

impl Input {
    /// Name of the input in a row that needs it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Scenes => "ScanNet",
            Self::RestOfTheSplit => "the rest of ScanNet's validation split",
            Self::FastSam => "weights of FastSAM",
            Self::Sam2 => "weights of SAM 2.1",
            Self::Mvpd => "MVPd",
        }
    }
}

/// The inputs that were found, and the missing ones.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Inputs {
    /// Paths of scenes, by name.
    pub scenes: Vec<PathBuf>,
    /// The videos of MVPd.
    pub mvpd: MvpdVideos,
    /// FastSAM's checkpoint.
    pub fastsam: Option<PathBuf>,
    /// SAM 2.1's checkpoint.
    pub sam2: Option<PathBuf>,
    /// Trackers that the paper does not use.
    pub other_trackers: Vec<OtherTracker>,
    /// Differences from the paper's inputs.
    pub notes: Vec<String>,
    /// Inputs that were not found.
    pub missing: Vec<MissingInput>,
}

impl Inputs {
    /// Searches the folders for inputs.
    ///
    /// # Errors
    /// If a folder cannot be read.
    pub fn find(scannet: Option<&Path>, mvpd: Option<&Path>, weights_dir: Option<&Path>) -> Result<Self, Failure> {
        let mut inputs = Self::default();
        if let Some(folder) = mvpd {
            inputs.find_mvpd(folder)?;
        }
        if let Some(folder) = scannet {
            inputs.scenes = scenes(folder, &mut inputs.missing)?;
        }
        if inputs.scenes.is_empty() {
            inputs.missing.push(MissingInput {
                input: Input::Scenes,
                what:
                    "ScanNet's validation scenes (.sens or exported, with *_2d-instance-filt.zip): every row but MVPd's"
                        .to_owned(),
                published: SCANNET_PAGE,
            });
        }
        if let Some(folder) = weights_dir {
            inputs.find_weights(folder)?;
        }
        if inputs.fastsam.is_none() {
            inputs.missing.push(MissingInput {
                input: Input::FastSam,
                what: "FastSAM-x.pt: every row except those prompted with ground truth".to_owned(),
                published: "https://github.com/CASIA-IVA-Lab/FastSAM, or https://docs.ultralytics.com/models/fast-sam",
            });
        }
        if inputs.sam2.is_none() {
            inputs.missing.push(MissingInput {
                input: Input::Sam2,
                what: "sam2.1_hiera_base_plus.pt: SAM2 and SAM2-Splat".to_owned(),
                published: "https://github.com/facebookresearch/sam2",
            });
        }
        if inputs.mvpd.videos.is_empty() {
            inputs.missing.push(MissingInput {
                input: Input::Mvpd,
                what: "MVPd, its split `test` (folders or scenes' .tar.gz): its table".to_owned(),
                published: "https://github.com/opipari/MVPd, under Matterport's terms for academic use of model data",
            });
        }
        Ok(inputs)
    }

    fn find_mvpd(&mut self, folder: &Path) -> Result<(), Failure> {
        // An unreadable folder is an error on the command line, not a missing data set.
        entries(folder)?;
        self.mvpd = MvpdVideos::find(folder).map_err(Failure::input)?;
        let (split, count) = (self.mvpd.split.display(), self.mvpd.videos.len());
        match self.mvpd.rejected {
            _ if count == 0 => {}
            Some(rejected) => {
                self.notes.push(format!("MVPd: {split}: {count} videos, {rejected} rejected by empty_videos.json"));
            }
            None => self.notes.push(format!(
                "MVPd: {split}: all {count} videos, as there is no empty_videos.json; the authors' list \
                 (https://github.com/opipari/MVPd, MVPd/test) leaves out 59 of the test split's 1800"
            )),
        }
        Ok(())
    }

    fn find_weights(&mut self, folder: &Path) -> Result<(), Failure> {
        let mut found: Vec<(PathBuf, Architecture)> = Vec::new();
        for path in entries(folder)? {
            let extension = path.extension().and_then(|extension| extension.to_str());
            if !path.is_file() || !matches!(extension, Some("pt" | "pth" | "safetensors")) {
                continue;
            }
            match Checkpoint::open(&path) {
                Ok(checkpoint) => found.push((path, checkpoint.architecture())),
                Err(error) => self.notes.push(format!("skipped: {error}")),
            }
        }
        if let Some((path, name)) = best(&found, fastsam_rank) {
            if fastsam_rank(&name) != Some(0) {
                self.notes
                    .push(format!("the paper's FastSAM-x was not found; used instead: {name}, {}", path.display()));
            }
            self.fastsam = Some(path);
        }
        if let Some((path, name)) = best(&found, sam2_rank) {
            if sam2_rank(&name) != Some(0) {
                let (name, path) = (name.to_string(), path.display());
                self.notes.push(format!("the paper's SAM 2.1 base_plus was not found; used instead: {name}, {path}"));
            }
            self.sam2 = Some(path);
        }
        self.other_trackers = OtherTracker::among(&found);
        Ok(())
    }
}

/// Finds the scenes of ScanNet in a folder: the folder itself, or the scenes in it or in `scans`.
fn scenes(folder: &Path, missing: &mut Vec<MissingInput>) -> Result<Vec<PathBuf>, Failure> {
    let settings = DatasetSettings::default();
    let can_be_opened = |path: &Path| open_scene(path, &settings).is_ok();
    if can_be_opened(folder) {
        return Ok(vec![folder.to_owned()]);
    }
    let mut paths = entries(folder)?;
    if folder.join("scans").is_dir() {
        paths.extend(entries(&folder.join("scans"))?);
    }
    let split = read_file(&folder.join(VALIDATION_SPLIT), MAX_SPLIT_BYTES).ok();
    let split = split.and_then(|bytes| text_of(bytes).ok());
    let wanted: Option<BTreeSet<&str>> =
        split.as_deref().map(|text| text.lines().map(str::trim).filter(|name| !name.is_empty()).collect());
    let name = |path: &Path| path.file_stem().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    paths.retain(|path| wanted.as_ref().is_none_or(|wanted| wanted.contains(name(path).as_str())));
    paths.retain(|path| can_be_opened(path));
    let there: BTreeSet<String> = paths.iter().map(|path| name(path)).collect();
    let absent: Vec<&str> = wanted.iter().flatten().copied().filter(|name| !there.contains(*name)).collect();
    if let [first, ..] = absent.as_slice() {
        missing.push(MissingInput {
            input: Input::RestOfTheSplit,
            what: format!("{} scenes of {VALIDATION_SPLIT}, starting with {first}", absent.len()),
            published: SCANNET_PAGE,
        });
    }
    Ok(paths)
}

/// Returns a folder's entries, sorted by name.
fn entries(folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    let of_folder = |error: std::io::Error| Failure::input(format!("{}: {error}", folder.display()));
    let mut paths = std::fs::read_dir(folder)
        .map_err(of_folder)?
        .map(|entry| entry.map(|entry| entry.path()).map_err(of_folder))
        .collect::<Result<Vec<_>, _>>()?;
    paths.sort();
    Ok(paths)
}

/// Returns the checkpoint with the lowest rank. If several have the same rank, returns the first by name.
fn best(
    found: &[(PathBuf, Architecture)],
    rank: fn(&Architecture) -> Option<usize>,
) -> Option<(PathBuf, Architecture)> {
    found.iter().filter(|(_, architecture)| rank(architecture).is_some()).min_by_key(|(_, name)| rank(name)).cloned()
}

/// Returns 0 for the paper's FastSAM-x, a larger number for other FastSAMs, `None` for other networks.
fn fastsam_rank(architecture: &Architecture) -> Option<usize> {
    match architecture {
        Architecture::YoloV8Seg { scale, classes: 1, .. } => {
            Some(scale.and_then(|scale| "xlmsn".find(scale)).unwrap_or(5))
        }
        _ => None,
    }
}

/// Returns 0 for the paper's SAM 2.1 base_plus, a larger number for other sizes, `None` for other networks.
fn sam2_rank(architecture: &Architecture) -> Option<usize> {
    match architecture {
        Architecture::Sam2 { size, is_2_1: true, .. } => {
            let sizes = ["base_plus", "large", "small", "tiny"];
            Some(size.and_then(|size| sizes.iter().position(|known| *known == size)).unwrap_or(4))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_inputs_are_listed_with_their_source() {
        let inputs = Inputs::find(None, None, None).unwrap();
        let whats: Vec<&str> = inputs.missing.iter().map(|missing| missing.what.as_str()).collect();
        assert_eq!(whats.len(), 4);
        for (what, name) in whats.iter().zip(["ScanNet", "FastSAM-x.pt", "sam2.1_hiera_base_plus.pt", "MVPd"]) {
            assert!(what.contains(name), "{what}");
        }
        assert!(inputs.missing.iter().all(|missing| missing.published.starts_with("http")));
        let absent = Inputs::find(None, None, Some(Path::new("/nowhere"))).unwrap_err();
        assert!(absent.to_string().contains("/nowhere"), "{absent}");
    }

    #[test]
    fn the_papers_checkpoints_come_first() {
        let yolo = |scale, classes| Architecture::YoloV8Seg { scale, width: 16, depth: 1, classes };
        let sam2 = |size, is_2_1| Architecture::Sam2 { size, is_2_1, width: 96, blocks: 12 };
        let found: Vec<(PathBuf, Architecture)> = [
            ("a", yolo(Some('s'), 1)),
            ("b", yolo(Some('x'), 80)),
            ("c", yolo(Some('x'), 1)),
            ("d", sam2(Some("tiny"), true)),
            ("e", sam2(Some("base_plus"), false)),
            ("f", sam2(Some("large"), true)),
        ]
        .map(|(path, architecture)| (PathBuf::from(path), architecture))
        .to_vec();
        assert_eq!(best(&found, fastsam_rank).unwrap().0, Path::new("c"));
        assert_eq!(best(&found, sam2_rank).unwrap().0, Path::new("f"));
        assert_eq!(best(&found[1..2], fastsam_rank), None);
    }
}
