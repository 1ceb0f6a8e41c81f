//! Files have the documented layout, which viewers expect.

use super::sample::{
    CODES, COMMON_PROPERTIES, FEATURE_DIM, FRAMES, KINDS, SEGMENTS, crc32, header_length, record_bytes, sample, saved,
};
use splatseg_files::StateBlock;
use splatseg_memory::{MemoryKind, SplatContent, SplatFile};

const USUAL: &str =
    "x y z nx ny nz f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3 radius";
const OWN: [&str; 2] =
    ["vote_id_0 votes_0 vote_id_1 votes_1 vote_id_2 votes_2 vote_id_3 votes_3", "feature_0 feature_1 feature_2"];
const COMMENTS: [&str; 2] = [
    "comment splatseg memory 5 kind evidence segments 4 state 0",
    "comment splatseg memory 5 kind features feature_dim 3 codes 9 segments 4 state 0",
];

fn close(left: f32, right: f32) -> bool {
    (left - right).abs() <= 1e-6
}

/// Reads the header in the way of antimatter15/splat, gsplat.js and similar viewers.
#[test]
fn viewers_find_their_properties() {
    for ((kind, own), comment) in KINDS.into_iter().zip(OWN).zip(COMMENTS) {
        let file = sample(kind, 4);
        let bytes = saved(&file);
        let text = String::from_utf8_lossy(&bytes[..bytes.len().min(10 * 1024)]).into_owned();
        let start = text.find("end_header\n").unwrap() + "end_header\n".len();
        let header: Vec<&str> = text[..start].lines().collect();
        assert_eq!(header[..3], ["ply", "format binary_little_endian 1.0", comment]);
        assert!(header.contains(&"element vertex 4"));
        assert_eq!(header.iter().filter(|line| line.starts_with("element")).count(), 1);
        assert!(header.iter().all(|line| !line.contains("packed_") && !line.contains("codebook_centers")));

        let properties: Vec<(&str, &str)> =
            header.iter().filter_map(|line| line.strip_prefix("property ")?.split_once(' ')).collect();
        let names = format!("{USUAL} last_seen seen_through {own} segment_id");
        assert_eq!(properties.iter().map(|(_, name)| *name).collect::<Vec<_>>(), names.split(' ').collect::<Vec<_>>());
        for (found, name) in &properties {
            let expected = match *name {
                "last_seen" => "uint",
                name if name == "seen_through" || name.contains("_id") => "int",
                _ => "float",
            };
            assert_eq!(*found, expected, "{name}");
        }

        let word = |row: usize, name: &str| -> [u8; 4] {
            let column = properties.iter().position(|(_, found)| *found == name).unwrap();
            bytes[start + 4 * (properties.len() * row + column)..][..4].try_into().unwrap()
        };
        let value = |name: &str| f32::from_le_bytes(word(2, name));
        assert_eq!([value("x"), value("y"), value("nx")], [0.2, -2.0, 0.0]);
        assert!(close(0.5 + 0.282_094_8 * value("f_dc_1"), 254.0 / 255.0));
        assert_eq!(1.0 / (1.0 + (-value("opacity")).exp()), 1.0);
        let radius = file.map.balls.radii[2];
        assert!(["scale_0", "scale_1", "scale_2"].iter().all(|name| close(value(name).exp() / radius, 1.0)));
        assert_eq!(value("radius"), radius);
        assert_eq!(["rot_0", "rot_1", "rot_2", "rot_3"].map(value), [1.0, 0.0, 0.0, 0.0]);
        assert_eq!(u32::from_le_bytes(word(2, "last_seen")), FRAMES - 2);
        assert_eq!(i32::from_le_bytes(word(2, "seen_through")), 255);
        assert_eq!(i32::from_le_bytes(word(2, "segment_id")), 2);
        match &file.content {
            SplatContent::Evidence { votes } => {
                let slots = votes[2].slots();
                assert_eq!(i32::from_le_bytes(word(2, "vote_id_2")), slots[2].0 as i32);
                assert_eq!(value("votes_2"), slots[2].1);
            }
            SplatContent::Features { features, .. } => assert_eq!(value("feature_1"), features[2 * FEATURE_DIM + 1]),
            SplatContent::Arrays { .. } => panic!("not made here"),
        }
        assert_eq!(4 * properties.len(), record_bytes(kind));
        assert_eq!(properties[COMMON_PROPERTIES].1, own.split(' ').next().unwrap());
    }
}

#[test]
fn the_block_after_the_vertices_is_as_documented() {
    for kind in KINDS {
        let mut saved_state = StateBlock::default();
        saved_state.put("memory.crowded", &[], [7u32]);
        let state = saved_state.to_bytes().unwrap();
        let file = SplatFile { saved_state, ..sample(kind, 2) };
        let bytes = saved(&file);
        let block = &bytes[header_length(&bytes) + 2 * record_bytes(kind)..];
        assert_eq!(&block[..8], b"SPLATSEG");
        let number = |at: usize, width: usize| {
            block[at..at + width].iter().rev().fold(0u64, |sum, &byte| sum << 8 | u64::from(byte))
        };
        let kind_number = u64::from(kind == MemoryKind::Features);
        assert_eq!(
            [number(8, 4), number(12, 4), number(16, 4), number(20, 4)],
            [5, kind_number, SEGMENTS as u64, u64::from(FRAMES)]
        );
        let mut end = 24;
        if let SplatContent::Features { codebook, .. } = &file.content {
            assert_eq!([number(24, 4), number(28, 8), number(36, 8), number(44, 4)], [3, 9, 5, 2]);
            assert_eq!(block[48..52], codebook.vector(0)[0].to_le_bytes());
            end = 48 + 4 * CODES * FEATURE_DIM;
        }
        for (index, word) in file.ids.iter().chain(&file.sightings).enumerate() {
            assert_eq!(number(end + 4 * index, 4), u64::from(*word));
        }
        assert_eq!(block[end + 8 * SEGMENTS..][..SEGMENTS], [1, 0, 0, 1]);
        assert_eq!(&block[end + 9 * SEGMENTS..][..state.len()], state);
        assert_eq!(block.len(), end + 9 * SEGMENTS + state.len() + 4);
        assert!(String::from_utf8_lossy(&bytes).contains(&format!(" state {}\n", state.len())));
        assert_eq!(bytes[bytes.len() - 4..], crc32(&bytes[..bytes.len() - 4]).to_le_bytes());
    }
    assert_eq!(crc32(b"123456789"), 0xcbf4_3926);
}
