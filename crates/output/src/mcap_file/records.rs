//! Records of an MCAP file as bytes: <https://mcap.dev/spec#records>.

use std::collections::BTreeMap;
use std::io;

/// First byte of each kind of record.
pub(super) mod code {
    pub const HEADER: u8 = 0x01;
    pub const FOOTER: u8 = 0x02;
    pub const SCHEMA: u8 = 0x03;
    pub const CHANNEL: u8 = 0x04;
    pub const MESSAGE: u8 = 0x05;
    pub const CHUNK: u8 = 0x06;
    pub const MESSAGE_INDEX: u8 = 0x07;
    pub const CHUNK_INDEX: u8 = 0x08;
    pub const STATISTICS: u8 = 0x0B;
    pub const SUMMARY_OFFSET: u8 = 0x0E;
    pub const DATA_END: u8 = 0x0F;
}

/// The content of a record, in the order in which its fields are added. Numbers are little-endian.
#[derive(Debug, Default)]
pub(super) struct Fields(Vec<u8>);

impl Fields {
    pub(super) fn u8(mut self, value: u8) -> Self {
        self.0.push(value);
        self
    }

    pub(super) fn u16(mut self, value: u16) -> Self {
        self.0.extend(value.to_le_bytes());
        self
    }

    pub(super) fn u32(mut self, value: u32) -> Self {
        self.0.extend(value.to_le_bytes());
        self
    }

    pub(super) fn u64(mut self, value: u64) -> Self {
        self.0.extend(value.to_le_bytes());
        self
    }

    /// Adds bytes with their number before them.
    pub(super) fn bytes(self, bytes: &[u8]) -> io::Result<Self> {
        let mut fields = self.u32(length(bytes.len())?);
        fields.0.extend(bytes);
        Ok(fields)
    }

    /// Adds the bytes that belong to the numbers of a map, with the number of bytes before them.
    pub(super) fn map(self, map: &BTreeMap<u16, u64>) -> io::Result<Self> {
        let fields = self.u32(length(map.len() * 10)?);
        Ok(map.iter().fold(fields, |fields, (key, value)| fields.u16(*key).u64(*value)))
    }

    /// Returns the record: its kind, its length and these fields.
    pub(super) fn record(self, code: u8) -> Vec<u8> {
        self.start_of_record(code, 0)
    }

    /// As [`Self::record`], for a record with `more` bytes behind these fields.
    pub(super) fn start_of_record(self, code: u8, more: usize) -> Vec<u8> {
        let length = (self.0.len() + more) as u64;
        [&[code], &length.to_le_bytes()[..], &self.0].concat()
    }
}

/// A length of which MCAP stores 32 bits.
fn length(bytes: usize) -> io::Result<u32> {
    let wrong =
        |_| io::Error::new(io::ErrorKind::InvalidInput, format!("{bytes} bytes in one field of an MCAP record"));
    u32::try_from(bytes).map_err(wrong)
}
