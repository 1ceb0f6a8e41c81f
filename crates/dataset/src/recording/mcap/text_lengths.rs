//! Checks of string lengths in records, before the `mcap` crate allocates the stated sizes.

use mcap::records::op;

/// Returns true if every string in a schema, channel or chunk record ends within the record. Other records have no strings
/// that are read here.
pub(super) fn fit(code: u8, body: &[u8]) -> bool {
    match code {
        // Id; name, encoding.
        op::SCHEMA => body.get(2..).and_then(after_text).and_then(after_text).is_some(),
        // Id, schema; topic, encoding, and the metadata: keys and values, preceded by their length in bytes.
        op::CHANNEL => {
            let metadata = body.get(4..).and_then(after_text).and_then(after_text);
            metadata.and_then(split_at_length).is_some_and(|(pairs, _)| are_pairs(pairs))
        }
        // Times, size and CRC; the name of the compression.
        op::CHUNK => body.get(28..).and_then(after_text).is_some(),
        _ => true,
    }
}

/// Splits at the length stated in the first four bytes, which are removed.
fn split_at_length(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (length, rest) = bytes.split_first_chunk()?;
    rest.split_at_checked(usize::try_from(u32::from_le_bytes(*length)).ok()?)
}

fn after_text(bytes: &[u8]) -> Option<&[u8]> {
    split_at_length(bytes).map(|(_, after)| after)
}

/// Returns true if the bytes are pairs of strings.
fn are_pairs(mut bytes: &[u8]) -> bool {
    while !bytes.is_empty() {
        let Some(rest) = after_text(bytes).and_then(after_text) else { return false };
        bytes = rest;
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(length: u32, content: &[u8]) -> Vec<u8> {
        [&length.to_le_bytes(), content].concat()
    }

    #[test]
    fn texts_must_end_in_their_record() {
        let schema = |name: u32, encoding: u32| [vec![1, 0], text(name, b"Image"), text(encoding, b"ros2msg")].concat();
        assert!(fit(op::SCHEMA, &schema(5, 7)));
        for (name, encoding) in [(0x6e00_0000, 7), (u32::MAX, 7), (5, 8), (17, 7)] {
            assert!(!fit(op::SCHEMA, &schema(name, encoding)), "{name} {encoding}");
        }
        let channel = |topic: u32, metadata: u32, key: u32| {
            let pairs = [text(key, b"key"), text(5, b"value")].concat();
            [vec![1, 0, 1, 0], text(topic, b"/tf"), text(3, b"cdr"), text(metadata, &pairs)].concat()
        };
        assert!(fit(op::CHANNEL, &channel(3, 16, 3)));
        for (topic, metadata, key) in [(4 << 20, 16, 3), (3, 17, 3), (3, 15, 3), (3, 16, 0x6e00_0000), (3, 16, 4)] {
            assert!(!fit(op::CHANNEL, &channel(topic, metadata, key)), "{topic} {metadata} {key}");
        }
        for cut in 0..schema(5, 7).len() {
            assert!(!fit(op::SCHEMA, &schema(5, 7)[..cut]), "{cut}");
        }
        let chunk = |name: u32| [vec![0; 28], text(name, b"zstd")].concat();
        assert!(fit(op::CHUNK, &chunk(4)) && !fit(op::CHUNK, &chunk(5)) && !fit(op::CHUNK, &[0; 28]));
        assert!(fit(op::MESSAGE, &[]));
    }
}
