//! The tracks of a recording as topics, and their blocks as messages of ROS.

use super::head::{Head, Role, TrackEntry};
use splatseg_ros::{CdrError, CompressedImage, Header, Image, Message, Time, to_cdr};
use std::collections::BTreeSet;

/// A track.
#[derive(Clone, Debug)]
pub(super) struct Track {
    pub(super) number: u64,
    pub(super) role: Role,
    /// Name of its topic, that of the track with a slash.
    pub(super) topic: String,
    /// Name of the coordinate frame of its images.
    pub(super) frame: String,
    /// `(width, height)`, pixels.
    pub(super) size: (u64, u64),
    pub(super) content: Content,
}

/// Content of a track's blocks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Content {
    /// Files in JPEG.
    Jpeg,
    /// Rows of pixels, in ROS's encoding.
    Raw { encoding: &'static str, is_big_endian: bool, bytes_per_pixel: u32 },
    /// Something else: Matroska's name of it.
    Other(String),
}

/// Returns the tracks that a file describes.
pub(super) fn tracks_of(head: &Head) -> Vec<Track> {
    let mut topics = BTreeSet::new();
    let mut track = |entry: &TrackEntry| {
        let role = head.role(entry);
        let name = match role {
            Role::Color => "COLOR".to_owned(),
            Role::Depth => "DEPTH".to_owned(),
            Role::Infrared => "IR".to_owned(),
            Role::Other if entry.name.is_empty() => format!("track_{}", entry.number),
            Role::Other => entry.name.clone(),
        };
        let is_new = topics.insert(name.clone());
        let topic = if is_new { format!("/{name}") } else { format!("/{name}_{}", entry.number) };
        Track {
            number: entry.number,
            role: if is_new { role } else { Role::Other },
            topic,
            frame: name,
            size: (entry.width, entry.height),
            content: Content::of(entry, role),
        }
    };
    head.tracks.iter().flatten().map(&mut track).collect()
}

impl Content {
    fn of(entry: &TrackEntry, role: Role) -> Self {
        let raw = |encoding, is_big_endian, bytes_per_pixel| Self::Raw { encoding, is_big_endian, bytes_per_pixel };
        let other = |format: Option<[u8; 4]>| {
            let format = format.map_or_else(String::new, |format| format!(" {}", format.escape_ascii()));
            Self::Other(format!("{}{format}", entry.codec))
        };
        if entry.is_encoded {
            return Self::Other(format!("{}, compressed or encrypted by Matroska", entry.codec));
        }
        let is_depth = role == Role::Depth;
        match entry.four_cc.as_ref() {
            None if entry.codec == "V_MJPEG" => Self::Jpeg,
            Some(b"MJPG") => Self::Jpeg,
            Some(b"b16g") if is_depth => raw("16UC1", true, 2),
            Some(b"b16g") if role == Role::Infrared => raw("mono16", true, 2),
            // As ffmpeg writes it on other machines.
            Some(b"Y1\0\x10") if is_depth => raw("16UC1", false, 2),
            Some(b"YUY2") if !is_depth => raw("yuv422_yuy2", false, 2),
            Some(b"BGRA") if !is_depth => raw("bgra8", false, 4),
            // One byte for each pixel of the luma, whose rows are the first.
            Some(b"NV12") if !is_depth => raw("nv12", false, 1),
            format => other(format.copied()),
        }
    }
}

impl Track {
    /// Returns the type of its messages, empty if they are not read.
    pub(super) fn type_name(&self) -> &'static str {
        match self.content {
            Content::Jpeg => CompressedImage::INTERFACE.name,
            Content::Raw { .. } => Image::INTERFACE.name,
            Content::Other(_) => "",
        }
    }

    /// Returns the encoding of its messages.
    pub(super) fn encoding(&self) -> &str {
        match &self.content {
            Content::Jpeg | Content::Raw { .. } => "cdr",
            Content::Other(codec) if codec.is_empty() => "none",
            Content::Other(codec) => codec,
        }
    }

    /// Returns true if its blocks are images that can be read.
    pub(super) fn is_read(&self) -> bool {
        !matches!(self.content, Content::Other(_))
    }

    /// Returns the message of an image. `stamp` is its time, nanoseconds.
    ///
    /// # Errors
    /// If it is too large for a message.
    pub(super) fn message(&self, stamp: i64, data: &[u8]) -> Result<Vec<u8>, CdrError> {
        let header = Header { stamp: Time::from_nanoseconds(stamp), frame_id: self.frame.clone() };
        let side = |side: u64| u32::try_from(side).unwrap_or(u32::MAX);
        match self.content {
            Content::Jpeg => to_cdr(&CompressedImage { header, format: "jpeg", data }),
            Content::Raw { encoding, is_big_endian, bytes_per_pixel } => to_cdr(&Image {
                header,
                height: side(self.size.1),
                width: side(self.size.0),
                encoding,
                is_bigendian: u8::from(is_big_endian),
                step: side(self.size.0).saturating_mul(bytes_per_pixel),
                data,
            }),
            Content::Other(_) => Ok(Vec::new()),
        }
    }

    /// Describes it, for people.
    pub(super) fn text(&self) -> String {
        let what = match &self.content {
            Content::Jpeg => "jpeg",
            Content::Raw { encoding, .. } => encoding,
            Content::Other(codec) => codec,
        };
        format!("{} ({what})", self.topic.trim_start_matches('/'))
    }
}
