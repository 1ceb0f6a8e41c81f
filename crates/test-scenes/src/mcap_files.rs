//! Recordings with compressed chunks, for the crate `mcap`, which reads no compressed ones here.

use lz4_flex::frame::FrameDecoder;
use mcap::records::{Record, op};
use std::io::Read;

/// Returns an MCAP file with the records of the data section of `file`, those of its chunks unpacked and without
/// chunks. Asserts that sizes and CRCs of the chunks are true.
pub fn without_chunks(file: &[u8]) -> Vec<u8> {
    let mut plain = mcap::MAGIC.to_vec();
    let mut rest = &file[mcap::MAGIC.len()..];
    loop {
        let length = u64::from_le_bytes(rest[1..9].try_into().unwrap()) as usize;
        let (record, after) = rest.split_at(9 + length);
        match mcap::parse_record(record[0], &record[9..]).unwrap() {
            Record::Chunk { header, data } => {
                let content = unpacked(&header.compression, &data);
                assert_eq!(content.len() as u64, header.uncompressed_size);
                assert_eq!(crc32fast::hash(&content), header.uncompressed_crc);
                plain.extend(content);
            }
            Record::MessageIndex(_) => {}
            Record::DataEnd(_) => break,
            _ => plain.extend(record),
        }
        rest = after;
    }
    // The end of the data and a footer, without CRCs and a summary.
    for (code, length) in [(op::DATA_END, 4_u64), (op::FOOTER, 20)] {
        plain.push(code);
        plain.extend(length.to_le_bytes());
        plain.resize(plain.len() + length as usize, 0);
    }
    plain.extend(mcap::MAGIC);
    plain
}

fn unpacked(compression: &str, data: &[u8]) -> Vec<u8> {
    let mut content = Vec::new();
    match compression {
        "" => content.extend(data),
        "lz4" => _ = FrameDecoder::new(data).read_to_end(&mut content).unwrap(),
        other => panic!("{other}"),
    }
    content
}
