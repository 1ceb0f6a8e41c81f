//! The head of a file, before its images: tracks, tags and attachments.

use super::ebml::{Elements, id, text, unsigned};
use crate::ros_topics::frame_names::one_line;

/// Nanoseconds of a unit of time, unless the file says otherwise.
const DEFAULT_TIMESTAMP_SCALE: u64 = 1_000_000;
/// Attachment with the calibration.
const CALIBRATION: &str = "calibration.json";
/// Tag with the time by which depth is exposed later than colour, nanoseconds.
const DEPTH_DELAY: &str = "K4A_DEPTH_DELAY_NS";
/// More of these are not those of a recording of images.
const MAX_TRACKS: usize = 64;
const MAX_TAGS: usize = 4096;
/// Maximum length of names and values that are kept, characters.
const MAX_NAME_LENGTH: usize = 60;
/// Offset of the four characters of the format in a BITMAPINFOHEADER.
const FOUR_CC_AT: usize = 16;

/// The use of a track.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Role {
    Color,
    Depth,
    Infrared,
    Other,
}

/// A track as the file describes it.
#[derive(Clone, Debug, Default)]
pub(super) struct TrackEntry {
    pub(super) number: u64,
    uid: u64,
    pub(super) name: String,
    pub(super) codec: String,
    /// Four characters of the format in V_MS/VFW/FOURCC and V_UNCOMPRESSED.
    pub(super) four_cc: Option<[u8; 4]>,
    /// Pixels.
    pub(super) width: u64,
    pub(super) height: u64,
    /// True if Matroska itself compresses or encrypts the blocks.
    pub(super) is_encoded: bool,
}

/// The elements of a segment other than its clusters. What is there twice is read once.
#[derive(Debug, Default)]
pub(super) struct Head {
    timestamp_scale: Option<u64>,
    pub(super) tracks: Option<Vec<TrackEntry>>,
    /// Names and values.
    tags: Option<Vec<(String, String)>>,
    /// The file `calibration.json`, if there are attachments.
    pub(super) calibration: Option<Option<Vec<u8>>>,
    /// Ids of parts, each once, and their offsets in the segment.
    seeks: Vec<(u32, u64)>,
}

impl Head {
    /// Returns true if elements with an id are parts of it.
    pub(super) fn has_part(id: u32) -> bool {
        matches!(id, id::INFO | id::TRACKS | id::TAGS | id::ATTACHMENTS | id::SEEK_HEAD)
    }

    /// Adds the data of a part.
    pub(super) fn add(&mut self, id: u32, data: &[u8]) {
        match id {
            id::INFO if self.timestamp_scale.is_none() => {
                self.timestamp_scale = Elements(data).find(id::TIMESTAMP_SCALE).and_then(unsigned);
            }
            id::TRACKS if self.tracks.is_none() => self.tracks = Some(tracks(data)),
            id::TAGS if self.tags.is_none() => self.tags = Some(tags(data)),
            id::ATTACHMENTS if self.calibration.is_none() => self.calibration = Some(calibration(data)),
            id::SEEK_HEAD => {
                let seeks = Elements(data).filter(|(id, _)| *id == id::SEEK).filter_map(|(_, seek)| {
                    let number = |wanted| Elements(seek).find(wanted).and_then(unsigned);
                    Some((u32::try_from(number(id::SEEK_ID)?).ok()?, number(id::SEEK_POSITION)?))
                });
                for (id, offset) in seeks.filter(|(id, _)| Self::has_part(*id)) {
                    if self.seeks.iter().all(|(known, _)| *known != id) {
                        self.seeks.push((id, offset));
                    }
                }
            }
            _ => {}
        }
    }

    /// Returns where the parts are that have not been read: ids, and offsets in the segment.
    pub(super) fn missing_parts(&self) -> Vec<(u32, u64)> {
        let is_missing = |(id, _): &&(u32, u64)| match *id {
            id::INFO => self.timestamp_scale.is_none(),
            id::TRACKS => self.tracks.is_none(),
            id::TAGS => self.tags.is_none(),
            id::ATTACHMENTS => self.calibration.is_none(),
            // mkvmerge points to a second list at the end.
            _ => false,
        };
        self.seeks.iter().filter(is_missing).copied().collect()
    }

    /// Returns the nanoseconds of a unit of time.
    pub(super) fn timestamp_scale(&self) -> i64 {
        let scale = self.timestamp_scale.filter(|scale| *scale > 0).unwrap_or(DEFAULT_TIMESTAMP_SCALE);
        i64::try_from(scale).unwrap_or(i64::MAX)
    }

    /// Returns the value of a tag.
    pub(super) fn tag(&self, name: &str) -> Option<&str> {
        let tags = self.tags.as_deref().unwrap_or_default();
        tags.iter().find(|(known, _)| known == name).map(|(_, value)| value.as_str())
    }

    /// Returns the time by which depth is exposed later than colour, nanoseconds.
    pub(super) fn depth_delay(&self) -> i64 {
        self.tag(DEPTH_DELAY).and_then(|value| value.trim().parse().ok()).unwrap_or_default()
    }

    /// Returns true if it is that of a recording of Azure Kinect, or of another camera in its layout.
    pub(super) fn is_kinect(&self) -> bool {
        let is_tagged = self.tags.iter().flatten().any(|(name, _)| name.starts_with("K4A_"));
        is_tagged || self.tracks.iter().flatten().any(|track| self.role(track) == Role::Depth)
    }

    /// Returns the use of a track, by its name, or by the tag that names it.
    pub(super) fn role(&self, track: &TrackEntry) -> Role {
        let is_tagged = |tag: &str| self.tag(tag).is_some_and(|uid| uid.trim().parse() == Ok(track.uid));
        match track.name.as_str() {
            "COLOR" => Role::Color,
            "DEPTH" => Role::Depth,
            // The latter in files of early versions.
            "IR" | "DEPTH_IR" => Role::Infrared,
            _ if is_tagged("K4A_COLOR_TRACK") => Role::Color,
            _ if is_tagged("K4A_DEPTH_TRACK") => Role::Depth,
            _ if is_tagged("K4A_IR_TRACK") => Role::Infrared,
            _ => Role::Other,
        }
    }

    /// Describes the camera, for people.
    pub(super) fn camera(&self) -> Option<String> {
        let facts =
            [("K4A_DEVICE_SERIAL_NUMBER", "serial number"), ("K4A_COLOR_MODE", "colour"), ("K4A_DEPTH_MODE", "depth")];
        let fact = |(tag, what): (&str, &str)| Some(format!("{what} {}", self.tag(tag)?));
        let mut facts: Vec<String> = facts.into_iter().filter_map(fact).collect();
        let delay = self.depth_delay();
        if delay != 0 {
            facts.push(format!("depth {:.3} ms after colour", delay as f64 * 1e-6));
        }
        (!facts.is_empty()).then(|| facts.join(", "))
    }
}

fn tracks(data: &[u8]) -> Vec<TrackEntry> {
    let entries = Elements(data).filter(|(id, _)| *id == id::TRACK_ENTRY).take(MAX_TRACKS);
    entries.map(|(_, data)| track(data)).collect()
}

fn track(data: &[u8]) -> TrackEntry {
    let mut track = TrackEntry::default();
    let (mut private, mut color_space): (&[u8], &[u8]) = (&[], &[]);
    for (id, data) in Elements(data) {
        match id {
            id::TRACK_NUMBER => track.number = unsigned(data).unwrap_or_default(),
            id::TRACK_UID => track.uid = unsigned(data).unwrap_or_default(),
            id::NAME => track.name = one_line(&text(data)).chars().take(MAX_NAME_LENGTH).collect(),
            id::CODEC_ID => track.codec = one_line(&text(data)).chars().take(MAX_NAME_LENGTH).collect(),
            id::CODEC_PRIVATE => private = data,
            id::CONTENT_ENCODINGS => track.is_encoded = true,
            id::VIDEO => {
                for (id, data) in Elements(data) {
                    match id {
                        id::PIXEL_WIDTH => track.width = unsigned(data).unwrap_or_default(),
                        id::PIXEL_HEIGHT => track.height = unsigned(data).unwrap_or_default(),
                        id::UNCOMPRESSED_FOUR_CC => color_space = data,
                        _ => {}
                    }
                }
            }
            _ => {}
        }
    }
    track.four_cc = match track.codec.as_str() {
        "V_MS/VFW/FOURCC" => private.get(FOUR_CC_AT..).and_then(|rest| rest.first_chunk().copied()),
        "V_UNCOMPRESSED" => color_space.first_chunk().copied(),
        _ => None,
    };
    track
}

/// Returns the names and values of all tags.
fn tags(data: &[u8]) -> Vec<(String, String)> {
    let tags = Elements(data).filter(|(id, _)| *id == id::TAG).flat_map(|(_, tag)| Elements(tag));
    let simple = tags.filter(|(id, _)| *id == id::SIMPLE_TAG).take(MAX_TAGS);
    let pair = |(_, data): (u32, &[u8])| {
        let name = Elements(data).find(id::TAG_NAME)?;
        let short = |data| one_line(&text(data)).chars().take(MAX_NAME_LENGTH).collect();
        Some((short(name), short(Elements(data).find(id::TAG_STRING)?)))
    };
    simple.filter_map(pair).collect()
}

/// Returns the attached calibration.
fn calibration(data: &[u8]) -> Option<Vec<u8>> {
    let mut files = Elements(data).filter(|(id, _)| *id == id::ATTACHED_FILE).map(|(_, file)| Elements(file));
    let file = files.find(|file| file.clone().find(id::FILE_NAME).is_some_and(|name| text(name) == CALIBRATION))?;
    file.find(id::FILE_DATA).map(<[u8]>::to_vec)
}
