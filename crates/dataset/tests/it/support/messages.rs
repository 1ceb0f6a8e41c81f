//! The messages in a recording, in file order.

use mcap::records::{Record, op};
use std::collections::BTreeMap;
use std::io::Read;
use std::time::Duration;

/// A message, as received from a topic.
#[derive(Clone)]
pub struct Received {
    pub topic: String,
    pub type_name: String,
    pub data: Vec<u8>,
    pub at: Duration,
}

/// Returns the messages in a recording.
pub fn messages(file: &[u8]) -> Vec<Received> {
    let mut reader = Reader::default();
    reader.records(&file[8..file.len() - 8]);
    reader.messages
}

#[derive(Default)]
struct Reader {
    schemas: BTreeMap<u16, String>,
    channels: BTreeMap<u16, (String, u16)>,
    messages: Vec<Received>,
}

impl Reader {
    fn records(&mut self, mut bytes: &[u8]) {
        while bytes.len() > 9 {
            let (code, len) = (bytes[0], u64::from_le_bytes(bytes[1..9].try_into().unwrap()) as usize);
            let body = &bytes[9..9 + len];
            bytes = &bytes[9 + len..];
            match mcap::parse_record(code, body) {
                Ok(Record::Schema { header, .. }) => _ = self.schemas.insert(header.id, header.name),
                Ok(Record::Channel(channel)) => {
                    self.channels.insert(channel.id, (channel.topic, channel.schema_id));
                }
                Ok(Record::Message { header, data }) => {
                    let (topic, schema) = self.channels[&header.channel_id].clone();
                    let (type_name, at) = (self.schemas[&schema].clone(), Duration::from_nanos(header.log_time));
                    self.messages.push(Received { topic, type_name, data: data.into_owned(), at });
                }
                Ok(Record::Chunk { header, data }) => self.records(&unpacked(&header.compression, &data)),
                _ if code == op::DATA_END => return,
                _ => {}
            }
        }
    }
}

fn unpacked(compression: &str, data: &[u8]) -> Vec<u8> {
    let mut content = Vec::new();
    match compression {
        "zstd" => _ = ruzstd::decoding::StreamingDecoder::new(data).unwrap().read_to_end(&mut content).unwrap(),
        "lz4" => _ = lz4_flex::frame::FrameDecoder::new(data).read_to_end(&mut content).unwrap(),
        _ => content.extend_from_slice(data),
    }
    content
}
