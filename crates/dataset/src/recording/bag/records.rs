//! Records of ROS 1 bags: a header of named fields, and data (<https://wiki.ros.org/Bags/Format/2.0>).

/// Codes of records.
pub(super) mod op {
    pub(in super::super) const MESSAGE: u8 = 2;
    pub(in super::super) const BAG_HEADER: u8 = 3;
    pub(in super::super) const CHUNK: u8 = 5;
    pub(in super::super) const CONNECTION: u8 = 7;
}

/// Bytes of a length.
pub(super) const LENGTH_BYTES: u64 = 4;

/// A record's header.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Header<'a> {
    pub(super) op: u8,
    /// Number of the connection.
    pub(super) connection: Option<u32>,
    /// Recording time, nanoseconds.
    pub(super) time: Option<u64>,
    /// Topic of a connection.
    pub(super) topic: Option<&'a [u8]>,
    /// Compression of a chunk.
    pub(super) compression: Option<&'a [u8]>,
    /// Size of a chunk, unpacked.
    pub(super) size: Option<u32>,
    /// Offset of the index; 0 if the bag was not closed.
    pub(super) index: Option<u64>,
}

impl<'a> Header<'a> {
    /// Parses a header; `None` if it is damaged.
    pub(super) fn parse(bytes: &'a [u8]) -> Option<Self> {
        let mut header = Self::default();
        let mut has_op = false;
        for field in Fields(bytes) {
            let (name, value) = field?;
            match name {
                b"op" => {
                    header.op = *value.first()?;
                    has_op = true;
                }
                b"conn" => header.connection = Some(u32::from_le_bytes(value.try_into().ok()?)),
                b"time" => {
                    let (seconds, nanoseconds) = value.split_first_chunk()?;
                    let seconds = u64::from(u32::from_le_bytes(*seconds));
                    let nanoseconds = u64::from(u32::from_le_bytes(nanoseconds.try_into().ok()?));
                    header.time = Some(seconds * 1_000_000_000 + nanoseconds);
                }
                b"topic" => header.topic = Some(value),
                b"compression" => header.compression = Some(value),
                b"size" => header.size = Some(u32::from_le_bytes(value.try_into().ok()?)),
                b"index_pos" => header.index = Some(u64::from_le_bytes(value.try_into().ok()?)),
                _ => {}
            }
        }
        has_op.then_some(header)
    }
}

/// Fields of a header: names and values. `None` is a damaged one, after which there are no others.
pub(super) struct Fields<'a>(pub(super) &'a [u8]);

impl<'a> Iterator for Fields<'a> {
    type Item = Option<(&'a [u8], &'a [u8])>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.0.is_empty() {
            return None;
        }
        let field = split_at_length(std::mem::take(&mut self.0)).and_then(|(field, rest)| {
            let equals = field.iter().position(|byte| *byte == b'=')?;
            self.0 = rest;
            Some((field.get(..equals)?, field.get(equals + 1..)?))
        });
        Some(field)
    }
}

/// Splits at the length stated in the first four bytes, which are removed.
pub(super) fn split_at_length(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (length, rest) = bytes.split_first_chunk()?;
    rest.split_at_checked(usize::try_from(u32::from_le_bytes(*length)).ok()?)
}

/// Splits a record in memory off the others: its header, its data, and the rest; `None` if it is cut off.
pub(super) fn split_record(bytes: &[u8]) -> Option<(&[u8], &[u8], &[u8])> {
    let (header, rest) = split_at_length(bytes)?;
    let (data, rest) = split_at_length(rest)?;
    Some((header, data, rest))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn field(name: &str, value: &[u8]) -> Vec<u8> {
        let content = [name.as_bytes(), b"=", value].concat();
        [&(content.len() as u32).to_le_bytes(), content.as_slice()].concat()
    }

    #[test]
    fn headers_are_parsed() {
        let bytes = [
            field("conn", &[7, 0, 0, 0]),
            field("op", &[2]),
            field("time", &[1, 0, 0, 0, 5, 0, 0, 0]),
            field("topic", b"/a=b"),
            field("unknown", b""),
        ];
        let expected =
            Header { op: 2, connection: Some(7), time: Some(1_000_000_005), topic: Some(b"/a=b"), ..Header::default() };
        assert_eq!(Header::parse(&bytes.concat()), Some(expected));
        assert_eq!(Header::parse(&bytes[0]), None, "no code");
        assert_eq!(Header::parse(&[field("op", &[2]), field("conn", &[1])].concat()), None, "a number is too short");
        for end in 1..bytes.concat().len() {
            if Header::parse(&bytes.concat()[..end]) == Some(expected) {
                assert!(end >= bytes[..4].concat().len(), "{end}");
            }
        }
        assert_eq!(Header::parse(&[9, 0, 0, 0, b'o']), None);
    }
}
