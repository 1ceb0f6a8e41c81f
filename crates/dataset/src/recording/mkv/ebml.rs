//! EBML, the encoding of Matroska (RFC 8794 and RFC 9559): elements of an id, a size and data, one inside the other.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};

/// Ids of elements, with the bits that say their length.
pub(super) mod id {
    pub(in super::super) const EBML: u32 = 0x1A45_DFA3;
    pub(in super::super) const SEGMENT: u32 = 0x1853_8067;
    pub(in super::super) const SEEK_HEAD: u32 = 0x114D_9B74;
    pub(in super::super) const SEEK: u32 = 0x4DBB;
    pub(in super::super) const SEEK_ID: u32 = 0x53AB;
    pub(in super::super) const SEEK_POSITION: u32 = 0x53AC;
    pub(in super::super) const INFO: u32 = 0x1549_A966;
    pub(in super::super) const TIMESTAMP_SCALE: u32 = 0x002A_D7B1;
    pub(in super::super) const TRACKS: u32 = 0x1654_AE6B;
    pub(in super::super) const TRACK_ENTRY: u32 = 0xAE;
    pub(in super::super) const TRACK_NUMBER: u32 = 0xD7;
    pub(in super::super) const TRACK_UID: u32 = 0x73C5;
    pub(in super::super) const NAME: u32 = 0x536E;
    pub(in super::super) const CODEC_ID: u32 = 0x86;
    pub(in super::super) const CODEC_PRIVATE: u32 = 0x63A2;
    pub(in super::super) const VIDEO: u32 = 0xE0;
    pub(in super::super) const PIXEL_WIDTH: u32 = 0xB0;
    pub(in super::super) const PIXEL_HEIGHT: u32 = 0xBA;
    pub(in super::super) const UNCOMPRESSED_FOUR_CC: u32 = 0x002E_B524;
    pub(in super::super) const CONTENT_ENCODINGS: u32 = 0x6D80;
    pub(in super::super) const ATTACHMENTS: u32 = 0x1941_A469;
    pub(in super::super) const ATTACHED_FILE: u32 = 0x61A7;
    pub(in super::super) const FILE_NAME: u32 = 0x466E;
    pub(in super::super) const FILE_DATA: u32 = 0x465C;
    pub(in super::super) const TAGS: u32 = 0x1254_C367;
    pub(in super::super) const TAG: u32 = 0x7373;
    pub(in super::super) const SIMPLE_TAG: u32 = 0x67C8;
    pub(in super::super) const TAG_NAME: u32 = 0x45A3;
    pub(in super::super) const TAG_STRING: u32 = 0x4487;
    pub(in super::super) const CLUSTER: u32 = 0x1F43_B675;
    pub(in super::super) const TIMESTAMP: u32 = 0xE7;
    pub(in super::super) const SIMPLE_BLOCK: u32 = 0xA3;
    pub(in super::super) const BLOCK_GROUP: u32 = 0xA0;
    pub(in super::super) const BLOCK: u32 = 0xA1;
}

/// Maximum length of an id and a size.
const MAX_HEADER_BYTES: usize = 12;
/// Bytes read at once: the headers of small blocks lie together, those of images far apart.
const WINDOW_BYTES: usize = 4096;

/// The start of an element.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Header {
    pub(super) id: u32,
    /// Length of its data; `None` if it was not known when it was written.
    pub(super) size: Option<u64>,
    /// Length of id and size.
    pub(super) length: usize,
}

impl Header {
    /// Parses the start of an element; `None` if it is none, or is cut off.
    pub(super) fn parse(bytes: &[u8]) -> Option<Self> {
        let id_length = bytes.first()?.leading_zeros() as usize + 1;
        let id = bytes.get(..id_length).filter(|id| id.len() <= 4)?;
        let (size, size_length) = variable_number(bytes.get(id_length..)?)?;
        let id = id.iter().fold(0, |id, byte| id << 8 | u32::from(*byte));
        Some(Self { id, size, length: id_length + size_length })
    }
}

/// Parses a number of variable length. Returns it, `None` if all its bits are set, and its length.
pub(super) fn variable_number(bytes: &[u8]) -> Option<(Option<u64>, usize)> {
    let length = bytes.first()?.leading_zeros() as usize + 1;
    let bytes = bytes.get(..length).filter(|bytes| bytes.len() <= 8)?;
    let bits = 7 * length as u32;
    let mask = (1_u64 << bits) - 1;
    let number = bytes.iter().fold(0_u64, |number, byte| number << 8 | u64::from(*byte)) & mask;
    Some(((number != mask).then_some(number), length))
}

/// The elements in some bytes: id and data. Ends at one that is damaged or cut off.
#[derive(Clone, Debug)]
pub(super) struct Elements<'a>(pub(super) &'a [u8]);

impl<'a> Iterator for Elements<'a> {
    type Item = (u32, &'a [u8]);

    fn next(&mut self) -> Option<Self::Item> {
        let header = Header::parse(self.0)?;
        let rest = self.0.get(header.length..)?;
        let size = header.size.map_or(Some(rest.len()), |size| usize::try_from(size).ok())?;
        let (data, rest) = rest.split_at_checked(size)?;
        self.0 = rest;
        Some((header.id, data))
    }
}

impl<'a> Elements<'a> {
    /// Returns the data of the first element with an id.
    pub(super) fn find(mut self, wanted: u32) -> Option<&'a [u8]> {
        self.find_map(|(id, data)| (id == wanted).then_some(data))
    }
}

/// Returns the unsigned number in an element's data.
pub(super) fn unsigned(data: &[u8]) -> Option<u64> {
    (data.len() <= 8).then(|| data.iter().fold(0, |number, byte| number << 8 | u64::from(*byte)))
}

/// Returns the text in an element's data, which may be padded with zeros.
pub(super) fn text(data: &[u8]) -> String {
    let end = data.iter().position(|byte| *byte == 0).unwrap_or(data.len());
    String::from_utf8_lossy(data.get(..end).unwrap_or_default()).into_owned()
}

/// A file of which small parts are read, mostly in order.
#[derive(Debug)]
pub(super) struct FileWindow {
    file: File,
    pub(super) bytes: u64,
    /// Offset of the window in the file.
    start: u64,
    window: Vec<u8>,
}

impl FileWindow {
    /// Reads a file of a number of bytes.
    pub(super) fn new(file: File, bytes: u64) -> Self {
        Self { file, bytes, start: 0, window: Vec::new() }
    }

    /// Returns the bytes at an offset: `count` of them, at most [`WINDOW_BYTES`], or fewer at the end of the file.
    pub(super) fn peek(&mut self, at: u64, count: usize) -> std::io::Result<&[u8]> {
        let end = self.start + self.window.len() as u64;
        let needed_end = at.saturating_add(count as u64).min(self.bytes);
        if at < self.start || needed_end > end {
            self.window = self.read(at, WINDOW_BYTES as u64)?;
            self.start = at;
        }
        let window = self.window.get((at - self.start) as usize..).unwrap_or_default();
        Ok(window.get(..count).unwrap_or(window))
    }

    /// Returns the header of the element at an offset; `None` if it is damaged or cut off.
    pub(super) fn header(&mut self, at: u64) -> std::io::Result<Option<Header>> {
        Ok(Header::parse(self.peek(at, MAX_HEADER_BYTES)?))
    }

    /// Reads bytes at an offset, fewer at the end of the file.
    pub(super) fn read(&mut self, at: u64, count: u64) -> std::io::Result<Vec<u8>> {
        let count = count.min(self.bytes.saturating_sub(at));
        let mut bytes = Vec::new();
        self.file.seek(SeekFrom::Start(at))?;
        (&mut self.file).take(count).read_to_end(&mut bytes)?;
        Ok(bytes)
    }

    /// Returns the offset of the next four bytes of an element's id at an offset or later.
    pub(super) fn find(&mut self, id: u32, mut at: u64) -> std::io::Result<Option<u64>> {
        const PART_BYTES: u64 = 1 << 20;
        let id = id.to_be_bytes();
        while at < self.bytes {
            let part = self.read(at, PART_BYTES)?;
            if let Some(found) = part.windows(id.len()).position(|window| window == id) {
                return Ok(Some(at + found as u64));
            }
            if part.len() < id.len() {
                break;
            }
            // The id may lie across the end.
            at += (part.len() - (id.len() - 1)) as u64;
            if (part.len() as u64) < PART_BYTES {
                break;
            }
        }
        Ok(None)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_are_parsed() {
        let header = |bytes: &[u8]| Header::parse(bytes).map(|header| (header.id, header.size, header.length));
        assert_eq!(header(&[0xA3, 0x81, 7]), Some((0xA3, Some(1), 2)));
        assert_eq!(header(&[0x1A, 0x45, 0xDF, 0xA3, 0x40, 0x02]), Some((id::EBML, Some(2), 6)));
        assert_eq!(
            header(&[0x1F, 0x43, 0xB6, 0x75, 0x01, 255, 255, 255, 255, 255, 255, 255]),
            Some((id::CLUSTER, None, 12))
        );
        assert_eq!(header(&[0xA3, 0xFF]), Some((0xA3, None, 2)));
        for damaged in [&[][..], &[0xA3], &[0, 0, 0, 0, 0, 0, 0, 0, 0, 0], &[0xA3, 0], &[0x1A, 0x45], &[0xA3, 0x41]] {
            assert_eq!(header(damaged), None, "{damaged:?}");
        }
    }

    #[test]
    fn elements_end_at_one_that_is_cut_off() {
        let bytes = [0x83, 0x81, 1, 0x86, 0x82, b'a', 0, 0xD7, 0x84, 1];
        let found: Vec<_> = Elements(&bytes).collect();
        assert_eq!(found, [(0x83, &[1][..]), (0x86, b"a\0")]);
        assert_eq!(text(Elements(&bytes).find(id::CODEC_ID).unwrap()), "a");
        assert_eq!((unsigned(&[1, 2]), unsigned(&[]), unsigned(&[1; 9])), (Some(258), Some(0), None));
    }

    #[test]
    fn an_id_is_found_across_the_border_of_what_is_read_at_once() {
        let mut file = tempfile::tempfile().unwrap();
        let mut bytes = vec![0; (1 << 20) - 2];
        bytes.extend(id::CLUSTER.to_be_bytes());
        std::io::Write::write_all(&mut file, &bytes).unwrap();
        let mut window = FileWindow::new(file, bytes.len() as u64);
        assert_eq!(window.find(id::CLUSTER, 5).unwrap(), Some((1 << 20) - 2));
        assert_eq!(window.find(id::CLUSTER, 1 << 20).unwrap(), None);
        assert_eq!(window.peek((1 << 20) - 2, 9).unwrap(), id::CLUSTER.to_be_bytes());
    }
}
