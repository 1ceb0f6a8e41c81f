//! The header of an OpenEXR file: attributes, each a name, a type, a length and that many bytes.
//!
//! Follows "OpenEXR File Layout" (openexr.com). Files of several parts, tiles and deep data are refused.

use super::DepthFile;
use crate::DatasetError;
use crate::text::shortened;

/// Flags of the version field for tiles, deep data and several parts.
const UNSUPPORTED: [(u32, &str); 3] = [(0x200, "tiles"), (0x800, "deep data"), (0x1000, "several parts")];
/// Names and attributes that the standard knows have at most 255 letters.
const MAX_NAME_BYTES: usize = 256;
/// A header has some tens of attributes and channels.
const MAX_ENTRIES: usize = 1024;

/// Compression of the pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Compression {
    None,
    Rle,
    /// zlib, of `lines` rows at once.
    Zip {
        lines: usize,
    },
}

impl Compression {
    fn of(code: u8) -> Result<Self, &'static str> {
        match code {
            0 => Ok(Self::None),
            1 => Ok(Self::Rle),
            2 => Ok(Self::Zip { lines: 1 }),
            3 => Ok(Self::Zip { lines: 16 }),
            4 => Err("PIZ"),
            5 => Err("PXR24"),
            6 => Err("B44"),
            7 => Err("B44A"),
            8 => Err("DWAA"),
            9 => Err("DWAB"),
            _ => Err("unknown"),
        }
    }

    /// Returns the number of rows in a block.
    pub(super) fn lines(self) -> usize {
        match self {
            Self::None | Self::Rle => 1,
            Self::Zip { lines } => lines,
        }
    }
}

/// Type of the numbers in a channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PixelType {
    Uint,
    Half,
    Float,
}

impl PixelType {
    pub(super) fn bytes(self) -> usize {
        match self {
            Self::Half => 2,
            Self::Uint | Self::Float => 4,
        }
    }
}

/// A channel of the image.
#[derive(Clone, Debug)]
pub(super) struct Channel {
    name: String,
    pixel_type: PixelType,
}

/// The fields of the header.
pub(super) struct Header {
    /// `(width, height)`.
    pub(super) size: (usize, usize),
    pub(super) compression: Compression,
    /// The depth.
    pub(super) pixel_type: PixelType,
    /// Bytes of the channels before depth in a row, and of all channels.
    pub(super) bytes_before: usize,
    pub(super) row_bytes: usize,
    /// Row number of the first row.
    pub(super) first_row: i32,
    /// Where the table of blocks starts.
    pub(super) table_start: usize,
}

/// Attributes that matter.
#[derive(Default)]
struct Attributes {
    channels: Option<Vec<Channel>>,
    compression: Option<Compression>,
    window: Option<[i32; 4]>,
}

/// Reads the header.
pub(super) fn read_header(file: &DepthFile<'_>) -> Result<Header, DatasetError> {
    let mut reader = Reader { file, at: 4 };
    let version = reader.u32("the version")?;
    if version & 0xFF != 2 {
        return Err(file.wrong("version of OpenEXR", (version & 0xFF).to_string(), "2"));
    }
    if let Some((_, what)) = UNSUPPORTED.iter().find(|(flag, _)| version & flag != 0) {
        return Err(file.wrong("kind of OpenEXR file", *what, "one part with scan lines"));
    }
    let attributes = read_attributes(&mut reader)?;
    let missing = |what: &str| file.wrong("header", format!("no {what}"), "one");
    let channels = attributes.channels.ok_or_else(|| missing("list of channels"))?;
    let compression = attributes.compression.ok_or_else(|| missing("compression"))?;
    let [left, top, right, bottom] = attributes.window.ok_or_else(|| missing("data window"))?;
    let side = |first: i32, last: i32| usize::try_from(i64::from(last) - i64::from(first) + 1).unwrap_or(0);
    let size = file.check_size((side(left, right), side(top, bottom)))?;
    let depth = depth_channel(&channels).ok_or_else(|| {
        let names: Vec<&str> = channels.iter().map(|channel| channel.name.as_str()).collect();
        file.wrong("channels", shortened(&names.join(", ")), "one channel, or one named Z or depth")
    })?;
    let row_bytes = |channels: &[Channel]| {
        let bytes = |channel: &Channel| channel.pixel_type.bytes().saturating_mul(size.0);
        channels.iter().map(bytes).fold(0, usize::saturating_add)
    };
    let pixel_type = channels[depth].pixel_type;
    if pixel_type == PixelType::Uint {
        return Err(file.wrong("numbers", "32-bit integers", "half or float"));
    }
    let (bytes_before, row_bytes) = (row_bytes(&channels[..depth]), row_bytes(&channels));
    let (first_row, table_start) = (top, reader.at);
    Ok(Header { size, compression, pixel_type, bytes_before, row_bytes, first_row, table_start })
}

/// Returns the index of the only channel, or of the only one that is named as depth, without regard to its layer.
fn depth_channel(channels: &[Channel]) -> Option<usize> {
    if channels.len() == 1 {
        return Some(0);
    }
    let is_depth = |channel: &&Channel| {
        let name = channel.name.rsplit('.').next().unwrap_or_default();
        name.eq_ignore_ascii_case("z") || name.eq_ignore_ascii_case("depth")
    };
    let only = channels.iter().filter(is_depth).count() == 1;
    channels.iter().position(|channel| is_depth(&channel)).filter(|_| only)
}

fn read_attributes(reader: &mut Reader<'_>) -> Result<Attributes, DatasetError> {
    let mut attributes = Attributes::default();
    for _ in 0..MAX_ENTRIES {
        let name = reader.name()?;
        if name.is_empty() {
            return Ok(attributes);
        }
        reader.name()?;
        let len = reader.u32("the length of an attribute")? as usize;
        let file = reader.file;
        let start = reader.at;
        let value = reader.bytes(&name, len)?;
        match name.as_str() {
            "channels" => attributes.channels = Some(read_channels(&mut Reader { file, at: start })?),
            "compression" => {
                let compression = Compression::of(value.first().copied().unwrap_or(u8::MAX));
                attributes.compression =
                    Some(compression.map_err(|found| file.wrong("compression", found, "none, RLE, ZIPS or ZIP"))?);
            }
            "dataWindow" => {
                let window: Option<[i32; 4]> = super::numbers(value, i32::from_le_bytes).try_into().ok();
                attributes.window =
                    Some(window.ok_or_else(|| file.wrong("data window", format!("{len} bytes"), "16"))?);
            }
            _ => {}
        }
    }
    Err(reader.file.wrong("header", format!("more than {MAX_ENTRIES} attributes"), "fewer"))
}

fn read_channels(reader: &mut Reader<'_>) -> Result<Vec<Channel>, DatasetError> {
    let mut channels = Vec::new();
    for _ in 0..MAX_ENTRIES {
        let name = reader.name()?;
        if name.is_empty() {
            return Ok(channels);
        }
        let pixel_type = match reader.u32("a channel")? {
            0 => PixelType::Uint,
            1 => PixelType::Half,
            2 => PixelType::Float,
            other => return Err(reader.file.wrong("type of a channel", other.to_string(), "0, 1 or 2")),
        };
        reader.bytes("a channel", 4)?;
        let sampling = (reader.u32("a channel")?, reader.u32("a channel")?);
        if sampling != (1, 1) {
            let found = format!("{}x{}", sampling.0, sampling.1);
            return Err(reader.file.wrong("sampling of a channel", found, "1x1"));
        }
        channels.push(Channel { name, pixel_type });
    }
    Err(reader.file.wrong("channels", format!("more than {MAX_ENTRIES}"), "fewer"))
}

/// A position in the file.
struct Reader<'a> {
    file: &'a DepthFile<'a>,
    at: usize,
}

impl<'a> Reader<'a> {
    fn bytes(&mut self, what: &str, len: usize) -> Result<&'a [u8], DatasetError> {
        let bytes = self.file.slice(what, self.at, len)?;
        self.at += len;
        Ok(bytes)
    }

    fn u32(&mut self, what: &str) -> Result<u32, DatasetError> {
        let bytes = self.bytes(what, 4)?;
        Ok(bytes.iter().rev().fold(0, |number, byte| number << 8 | u32::from(*byte)))
    }

    /// Reads text that ends with a zero.
    fn name(&mut self) -> Result<String, DatasetError> {
        let rest = self.file.bytes.get(self.at..).unwrap_or_default();
        let len = rest.iter().take(MAX_NAME_BYTES).position(|byte| *byte == 0);
        let len = len.ok_or_else(|| self.file.wrong("header", "no end of a name", "a zero"))?;
        let name = String::from_utf8_lossy(&rest[..len]).into_owned();
        self.at += len + 1;
        Ok(name)
    }
}
