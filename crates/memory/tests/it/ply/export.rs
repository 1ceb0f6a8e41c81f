//! Export of memories for other programs.

use super::sample::{SEGMENTS, features, sample, with_content};
use glam::{DVec3, Vec3};
use splatseg_geometry::MapGaussian;
use splatseg_memory::{ExportedForm, MemoryKind, SplatContent, Votes, write_exported};

const GAUSSIAN: MapGaussian = MapGaussian {
    mean: Vec3::new(1.0, -2.0, 3.5),
    radius: 0.25,
    color: [255, 0, 128],
    segment_id: 77,
    confidence: 0.5,
};

fn written(form: ExportedForm, gaussians: &[MapGaussian]) -> (String, Vec<u8>) {
    written_at(DVec3::ZERO, form, gaussians)
}

fn written_at(origin: DVec3, form: ExportedForm, gaussians: &[MapGaussian]) -> (String, Vec<u8>) {
    let mut bytes = Vec::new();
    write_exported(form, origin, gaussians, &mut bytes).unwrap();
    let end = b"end_header\n";
    let body = bytes.windows(end.len()).position(|window| window == end).unwrap() + end.len();
    let rest = bytes.split_off(body);
    (String::from_utf8(bytes).unwrap(), rest)
}

#[test]
fn points_have_a_place_a_colour_and_a_segment() {
    let (header, body) = written(ExportedForm::Points, &[GAUSSIAN, GAUSSIAN]);
    assert_eq!(
        header,
        "ply\nformat binary_little_endian 1.0\ncomment exported by splatseg\nelement vertex 2\nproperty float x\nproperty \
         float y\nproperty float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nproperty int \
         segment_id\nend_header\n"
    );
    let vertex = [&1f32.to_le_bytes()[..], &(-2f32).to_le_bytes(), &3.5f32.to_le_bytes(), &[255, 0, 128, 77, 0, 0, 0]];
    assert_eq!(body, [vertex.concat(), vertex.concat()].concat());
}

#[test]
fn far_points_are_doubles_and_far_gaussians_state_their_origin() {
    let far = DVec3::new(500_000.0, 5_400_000.0, -16.0);
    let (header, body) = written_at(far, ExportedForm::Points, &[GAUSSIAN]);
    assert!(header.contains("element vertex 1\nproperty double x\nproperty double y\nproperty double z\n"), "{header}");
    let place = [500_001.0, 5_399_998.0, -12.5f64].map(f64::to_le_bytes).concat();
    assert_eq!(body, [&place[..], &[255, 0, 128, 77, 0, 0, 0]].concat());
    let (header, body) = written_at(far, ExportedForm::Gaussians, &[GAUSSIAN]);
    assert!(header.contains("comment exported by splatseg\ncomment origin 500000 5400000 -16\nelement"), "{header}");
    assert_eq!(body, written(ExportedForm::Gaussians, &[GAUSSIAN]).1);
}

#[test]
fn gaussians_have_the_values_of_the_saved_memory() {
    let file = sample(MemoryKind::Evidence, 5);
    let gaussians: Vec<MapGaussian> = file.gaussians().collect();
    let (header, body) = written(ExportedForm::Gaussians, &gaussians);
    let names: Vec<&str> = header.lines().filter_map(|line| line.strip_prefix("property ")).collect();
    let floats = body.as_chunks::<{ 4 * 18 }>().0;
    assert_eq!((names.len(), floats.len()), (18, 5));
    assert_eq!((names[6], names[9], names[17]), ("float f_dc_0", "float opacity", "int segment_id"));
    // The first 17 properties are bitwise equal to those of the memory's own file.
    let path = tempfile::tempdir().unwrap();
    let path = path.path().join("a.ply");
    file.save(&path).unwrap();
    let saved = std::fs::read(&path).unwrap();
    let start = saved.windows(11).position(|window| window == b"end_header\n").unwrap() + 11;
    let record = super::sample::record_bytes(MemoryKind::Evidence);
    for (index, vertex) in floats.iter().enumerate() {
        assert_eq!(vertex[..4 * 17], saved[start + index * record..][..4 * 17]);
        assert_eq!(vertex[4 * 17..], file.segment_ids[index].to_le_bytes());
    }
}

#[test]
fn confidence_is_the_share_of_votes_for_the_shown_segment() {
    let mut file = sample(MemoryKind::Evidence, 4);
    let slots = [
        [(3, 6.0), (1, 2.0), (0, 0.0), (0, 0.0)],
        // Less than one vote in total.
        [(3, 0.4), (0, 0.0), (0, 0.0), (0, 0.0)],
        [(0, 1.0), (3, 1.0), (2, 2.0), (0, 0.0)],
        [(0, 0.0); 4],
    ];
    file.content = SplatContent::Evidence { votes: slots.map(Votes::from_slots).to_vec() };
    file.segment_ids = vec![3, 3, 2, 0];
    let confidence: Vec<f32> = file.gaussians().map(|gaussian| gaussian.confidence).collect();
    assert_eq!(confidence, [0.75, 0.4, 0.5, 0.0]);
    let features = sample(MemoryKind::Features, 20);
    assert!(features.gaussians().all(|gaussian| (0.0..=1.0).contains(&gaussian.confidence)));
    assert!(features.gaussians().all(|gaussian| gaussian.segment_id as usize <= SEGMENTS));
}

#[test]
fn confidence_of_features_is_their_length_and_an_id_has_confidence_1() {
    let mut file = sample(MemoryKind::Features, 3);
    let SplatContent::Features { features: values, .. } = &mut file.content else { panic!("a memory of features") };
    *values = [[0.3, 0.4, 0.0], [0.0; 3], [1.0, 1.0, 0.0]].concat();
    let confidence: Vec<f32> = file.gaussians().map(|gaussian| gaussian.confidence).collect();
    assert_eq!(confidence, [0.5, 0.0, 1.0]);
    let mut file = with_content(features(3, 1), 3);
    file.segment_ids = vec![2, 0, 1];
    assert_eq!(file.gaussians().map(|gaussian| gaussian.confidence).collect::<Vec<_>>(), [1.0, 0.0, 1.0]);
}
