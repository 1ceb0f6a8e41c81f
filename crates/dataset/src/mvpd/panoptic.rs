//! MVPd's annotations. One video is selected while reading, because a split's file can have gigabytes.

use crate::DatasetError;
use crate::error::NAMES_IN_MESSAGES;
use serde::de::{DeserializeSeed, Error, IgnoredAny, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};
use std::fmt;
use std::io::Read;
use std::path::Path;

/// One video and its annotations.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct PanopticVideo {
    pub(super) name: String,
    pub(super) images: Vec<ImageEntry>,
    /// Empty if the video has none.
    pub(super) annotations: Vec<FrameAnnotation>,
}

/// One image of a video.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub(super) struct ImageEntry {
    pub(super) file_name: String,
    /// The authors' script can omit it. The file is then named like the colour image.
    pub(super) depth_file_name: Option<String>,
    /// Metres. The published files always have it.
    pub(super) camera_position: Option<[f64; 3]>,
    /// Quaternion w, x, y, z.
    pub(super) camera_rotation: Option<[f64; 4]>,
}

/// The labels of one image.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub(super) struct FrameAnnotation {
    pub(super) file_name: String,
    /// The authors' script can omit them.
    pub(super) segments_info: Option<Vec<SegmentInfo>>,
}

/// One segment of one image.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
pub(super) struct SegmentInfo {
    /// Id in the mask image.
    pub(super) id: u32,
    pub(super) instance_id: Option<u32>,
    /// 1 for a region of several instances.
    #[serde(default)]
    pub(super) iscrowd: u8,
}

/// The video to read, and names for messages.
pub(super) struct VideoChoice<'a> {
    pub(super) annotations: &'a Path,
    pub(super) place: &'a Path,
    pub(super) video: Option<&'a str>,
}

/// Reads the chosen video, or the only one, from an annotation file, no further than necessary.
pub(super) fn read_panoptic(reader: impl Read, choice: &VideoChoice<'_>) -> Result<PanopticVideo, DatasetError> {
    let mut file = PanopticFile { videos: Selection::new(choice.video), annotations: Selection::new(choice.video) };
    let mut deserializer = serde_json::Deserializer::from_reader(reader);
    let read = FileVisitor(&mut file).deserialize(&mut deserializer).and_then(|()| deserializer.end());
    if choice.video.is_none() && file.videos.first_names.len() > 1 {
        return Err(DatasetError::SeveralVideos { path: choice.place.to_owned(), videos: file.videos.first_names });
    }
    match read {
        Err(_) if file.is_complete() => {} // Reading was stopped early on purpose.
        read => read.map_err(|source| DatasetError::Json { path: choice.annotations.to_owned(), source })?,
    }
    let Some((name, video)) = file.videos.kept else {
        return Err(match choice.video {
            Some(video) => DatasetError::NoSuchVideo {
                path: choice.place.to_owned(),
                video: video.to_owned(),
                videos: file.videos.first_names,
            },
            None => DatasetError::NoFrames { path: choice.annotations.to_owned(), expected: "a video in \"videos\"" },
        });
    };
    let annotations = file.annotations.kept.filter(|(annotated, _)| *annotated == name);
    let annotations = annotations.map(|(_, kept)| kept.annotations).unwrap_or_default();
    Ok(PanopticVideo { name, images: video.images, annotations })
}

/// Reads the name and number of images of each video in a file, in file order. Stops after the list of videos.
pub(super) fn read_video_list(reader: impl Read, annotations: &Path) -> Result<Vec<(String, usize)>, DatasetError> {
    let mut list = VideoList { videos: None };
    let mut deserializer = serde_json::Deserializer::from_reader(reader);
    let read = (&mut list).deserialize(&mut deserializer);
    match (list.videos, read) {
        (Some(videos), _) => Ok(videos),
        (None, Err(source)) => Err(DatasetError::Json { path: annotations.to_owned(), source }),
        (None, Ok(())) => {
            Err(DatasetError::NoFrames { path: annotations.to_owned(), expected: "a video in \"videos\"" })
        }
    }
}

/// Names and image counts of a file's videos, once the list has been read.
struct VideoList {
    videos: Option<Vec<(String, usize)>>,
}

impl<'de> DeserializeSeed<'de> for &mut VideoList {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_map(self)
    }
}

impl<'de> Visitor<'de> for &mut VideoList {
    type Value = ();

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("an object with \"videos\"")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        while let Some(key) = map.next_key::<String>()? {
            if key == "videos" {
                let entries: Vec<ListedVideo> = map.next_value()?;
                let named = |entry: ListedVideo| {
                    let name = name_of([entry.video_name, entry.video_id]).map_err(A::Error::custom)?;
                    Ok((name, entry.images.len()))
                };
                self.videos = Some(entries.into_iter().map(named).collect::<Result<_, A::Error>>()?);
                return Err(A::Error::custom("the rest is not needed"));
            }
            map.next_value::<IgnoredAny>()?;
        }
        Ok(())
    }
}

/// An entry of `"videos"`, reduced to its name and number of images.
#[derive(Deserialize)]
struct ListedVideo {
    video_name: Option<NameOrNumber>,
    video_id: Option<NameOrNumber>,
    /// Only counted, without storing each entry.
    images: Vec<IgnoredAny>,
}

/// Returns the first of an entry's names.
fn name_of(names: [Option<NameOrNumber>; 2]) -> Result<String, &'static str> {
    match names.into_iter().flatten().next() {
        Some(NameOrNumber::Name(name)) => Ok(name),
        Some(NameOrNumber::Number(number)) => Ok(number.to_string()),
        None => Err("an entry has neither `video_name` nor `video_id`"),
    }
}

/// A video's name or number. The authors write the name as `video_name` and a number as `video_id`, but their format
/// page uses `video_id` for the name.
#[derive(Deserialize)]
#[serde(untagged)]
enum NameOrNumber {
    Name(String),
    Number(u64),
}

/// An entry of a list that belongs to a video.
trait VideoEntry {
    /// Takes the values of `video_name` and `video_id` out of the entry.
    fn names(&mut self) -> [Option<NameOrNumber>; 2];
}

/// An entry of `"videos"`.
#[derive(Deserialize)]
struct Video {
    video_name: Option<NameOrNumber>,
    video_id: Option<NameOrNumber>,
    images: Vec<ImageEntry>,
}

impl VideoEntry for Video {
    fn names(&mut self) -> [Option<NameOrNumber>; 2] {
        [self.video_name.take(), self.video_id.take()]
    }
}

/// An entry of `"annotations"`.
#[derive(Deserialize)]
struct VideoAnnotations {
    video_name: Option<NameOrNumber>,
    video_id: Option<NameOrNumber>,
    annotations: Vec<FrameAnnotation>,
}

impl VideoEntry for VideoAnnotations {
    fn names(&mut self) -> [Option<NameOrNumber>; 2] {
        [self.video_name.take(), self.video_id.take()]
    }
}

/// Selects one entry of a list.
struct Selection<'a, T> {
    /// Name of the video to keep; `None` keeps the first entry.
    wanted: Option<&'a str>,
    kept: Option<(String, T)>,
    /// For messages.
    first_names: Vec<String>,
}

impl<'a, T: VideoEntry> Selection<'a, T> {
    fn new(wanted: Option<&'a str>) -> Self {
        Self { wanted, kept: None, first_names: Vec::new() }
    }

    /// Keeps an entry if it belongs to the wanted video, otherwise drops it.
    fn consider(&mut self, mut entry: T) -> Result<(), &'static str> {
        let name = name_of(entry.names())?;
        if self.first_names.len() < NAMES_IN_MESSAGES {
            self.first_names.push(name.clone());
        }
        if self.kept.is_none() && self.wanted.is_none_or(|wanted| wanted == name) {
            self.kept = Some((name, entry));
        }
        Ok(())
    }
}

/// The selected parts of the file.
struct PanopticFile<'a> {
    videos: Selection<'a, Video>,
    annotations: Selection<'a, VideoAnnotations>,
}

impl PanopticFile<'_> {
    /// Returns true if the rest of the file is irrelevant.
    fn is_complete(&self) -> bool {
        self.videos.wanted.is_some() && self.videos.kept.is_some() && self.annotations.kept.is_some()
    }

    /// Returns true if enough names are known for the error that a video must be chosen.
    fn is_ambiguous(&self) -> bool {
        self.videos.wanted.is_none() && self.videos.first_names.len() == NAMES_IN_MESSAGES
    }
}

/// Deserializer of the whole file.
struct FileVisitor<'a, 'b>(&'a mut PanopticFile<'b>);

impl<'de> DeserializeSeed<'de> for FileVisitor<'_, '_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_map(self)
    }
}

impl<'de> Visitor<'de> for FileVisitor<'_, '_> {
    type Value = ();

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("an object with \"videos\" and \"annotations\"")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        while let Some(key) = map.next_key::<String>()? {
            match key.as_str() {
                "videos" => map.next_value_seed(Entries { file: self.0, list: |file| &mut file.videos })?,
                "annotations" => map.next_value_seed(Entries { file: self.0, list: |file| &mut file.annotations })?,
                _ => drop(map.next_value::<IgnoredAny>()?),
            }
        }
        Ok(())
    }
}

/// Deserializer of a list, one entry at a time.
struct Entries<'a, 'b, T> {
    file: &'a mut PanopticFile<'b>,
    list: for<'c> fn(&'c mut PanopticFile<'b>) -> &'c mut Selection<'b, T>,
}

impl<'de, T: VideoEntry + Deserialize<'de>> DeserializeSeed<'de> for Entries<'_, '_, T> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_seq(self)
    }
}

impl<'de, T: VideoEntry + Deserialize<'de>> Visitor<'de> for Entries<'_, '_, T> {
    type Value = ();

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("a list with an entry for each video")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut entries: A) -> Result<(), A::Error> {
        while let Some(entry) = entries.next_element::<T>()? {
            (self.list)(self.file).consider(entry).map_err(A::Error::custom)?;
            if self.file.is_complete() || self.file.is_ambiguous() {
                return Err(A::Error::custom("the rest is not needed"));
            }
        }
        Ok(())
    }
}
