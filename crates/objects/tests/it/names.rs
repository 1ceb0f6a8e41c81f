//! Names of objects: what is kept, found, joined, saved and refused.

use proptest::prelude::*;
use splatseg_files::StateBlock;
use splatseg_geometry::RemappedId;
use splatseg_objects::{NameError, ObjectName, ObjectNames};

fn name(label: &str, embedding: &[f32]) -> ObjectName {
    ObjectName { label: Some(label.to_owned()), embedding: embedding.to_vec(), ..ObjectName::default() }
}

fn kitchen() -> ObjectNames {
    let mut names = ObjectNames::default();
    names.set(3, name("Red mug", &[1.0, 0.0]), 10.0).unwrap();
    names.set(4, name("blue mug", &[0.0, 2.0]), 20.0).unwrap();
    names.set(9, ObjectName { label: None, embedding: vec![-1.0, 0.5], ..ObjectName::default() }, 5.0).unwrap();
    names.set(11, name("  table ", &[]), 5.0).unwrap();
    names
}

#[test]
fn objects_are_found_by_label_and_by_embedding() {
    let names = kitchen();
    assert_eq!(names.find_label("MUG"), [3, 4]);
    assert_eq!((names.label(11), names.label(9)), (Some("table"), None));
    let found = names.find(&[0.1, 5.0]).unwrap();
    assert_eq!(found.iter().map(|(id, _)| *id).collect::<Vec<_>>(), [4, 9, 3]);
    assert!((found[0].1 - 0.9998).abs() < 1e-4, "{found:?}");
    assert!(names.find(&[0.0, 0.0]).unwrap().iter().all(|(_, similarity)| *similarity == 0.0));
}

#[test]
fn unusable_names_are_refused_and_the_earlier_name_stays() {
    let mut names = kitchen();
    let before = names.clone();
    let length = NameError::Length { found: 3, expected: 2 };
    assert_eq!(names.set(3, name("cup", &[1.0, 2.0, 3.0]), 90.0), Err(length.clone()));
    assert_eq!(names.find(&[1.0, 2.0, 3.0]), Err(length));
    let error = names.set(3, name("cup", &[1.0, f32::NAN]), 90.0).unwrap_err();
    assert_eq!(error.to_string(), "the embedding's number 1 is NaN, expected a finite number");
    assert!(matches!(names.set(3, name("two\nlines", &[]), 90.0), Err(NameError::Label { .. })));
    assert!(matches!(names.set(3, name(&"long ".repeat(300), &[]), 90.0), Err(NameError::Label { .. })));
    assert_eq!(
        names.set(20, name("wall", &vec![0.5; 1 << 24]), 1.0),
        Err(NameError::Length { found: 1 << 24, expected: 2 })
    );
    assert_eq!(names, before);
    // Without embeddings, any length is fine, but not any size.
    let mut names = ObjectNames::default();
    assert_eq!(names.set(1, name("wall", &vec![0.5; 1 << 24]), 1.0), Err(NameError::TooLarge));
    names.set(1, name("wall", &[1.0; 3]), 1.0).unwrap();
    names.forget(1);
    names.set(1, name("wall", &[1.0; 5]), 1.0).unwrap();
}

#[test]
fn joined_ids_keep_the_name_from_the_better_view() {
    let mut names = kitchen();
    names.remap(&[RemappedId { from: 4, into: 3 }, RemappedId { from: 11, into: 12 }]);
    assert_eq!((names.label(3), names.label(4)), (Some("blue mug"), None));
    assert_eq!((names.label(11), names.label(12)), (None, Some("table")));
    names.remap(&[RemappedId { from: 9, into: 3 }]);
    assert_eq!(names.label(3), Some("blue mug"));
    // A better view that led to no name does not delete one.
    names.set(15, ObjectName::default(), 900.0).unwrap();
    names.remap(&[RemappedId { from: 15, into: 3 }]);
    assert_eq!(names.label(3), Some("blue mug"));
}

#[test]
fn damaged_names_are_an_error() {
    let saved = kitchen().to_bytes();
    let block = StateBlock::from_bytes(&saved).unwrap();
    let damaged = |change: fn(&mut StateBlock)| {
        let mut block = block.clone();
        change(&mut block);
        ObjectNames::from_bytes(&block.to_bytes().unwrap()).unwrap_err().to_string()
    };
    assert!(damaged(|block| block.put("id", &[], [3u32, 3, 9, 11])).contains("object 3 occurs twice"));
    assert!(damaged(|block| block.put("id", &[], [0u32, 4, 9, 11])).contains("object 0"));
    assert!(damaged(|block| block.put("id", &[], [3u32])).contains("score: found"));
    assert!(damaged(|block| block.put("score", &[], [-1.0f64; 4])).contains("score"));
    assert!(damaged(|block| block.put_json("labels.json", &["a"])).contains("labels.json: found 1 entries"));
    assert!(damaged(|block| block.put("embedding", &[2], [0.0f32; 4])).contains("embedding: found 2 entries"));
    assert!(damaged(|block| block.put("embedding", &[2], [f32::NAN; 6])).contains("expected a finite number"));
    assert!(damaged(|block| block.put("embedding", &[], [0.0f32; 6])).contains("with two axes"));
    for end in 0..saved.len() {
        assert!(ObjectNames::from_bytes(&saved[..end]).is_err(), "the first {end} bytes");
    }
}

#[test]
fn names_of_maps_of_version_4_are_read() {
    let read = |text: &str| {
        let mut block = StateBlock::default();
        block.put(StateBlock::OLD_TEXT, &[], text.bytes());
        ObjectNames::from_bytes(&block.to_bytes().unwrap())
    };
    let text = r#"[{"id":3,"label":"Red mug","embedding":"AACAPwAAAAA=","score":10.0},{"id":4,"score":2.5}]"#;
    let names = read(text).unwrap();
    assert_eq!((names.label(3), names.embedding(3), names.label(4)), (Some("Red mug"), &[1.0, 0.0][..], None));
    assert_eq!(ObjectNames::from_bytes(&names.to_bytes()), Ok(names));
    let error = |from: &str, to: &str| read(&text.replacen(from, to, 1)).unwrap_err().to_string();
    assert!(error("\"id\":4", "\"id\":3").contains("object 3 occurs twice"));
    assert!(error("AACAPwAAAAA=", "AACAPwAAAA==").contains("half a number"));
    assert!(error("AACAPwAAAAA=", "%%").contains("not Base64"));
    assert!(error("]", "").contains("damaged"));
}

proptest! {
    #[test]
    fn saved_names_read_back(
        labels in prop::collection::btree_map(1u32..100, (prop::option::of("[a-z äß\"\\\\]{0,12}"), any::<bool>()), 0..20),
        numbers in prop::array::uniform4(-1e30f32..1e30),
        score in 0f64..1e9,
    ) {
        let mut names = ObjectNames::default();
        for (id, (label, embedded)) in labels {
            let embedding = if embedded { numbers.to_vec() } else { Vec::new() };
            names.set(id, ObjectName { label, embedding, ..ObjectName::default() }, score + f64::from(id)).unwrap();
        }
        let saved = names.to_bytes();
        let read = ObjectNames::from_bytes(&saved).unwrap();
        prop_assert_eq!(&read, &names);
        prop_assert_eq!(read.to_bytes(), saved);
    }

    #[test]
    fn no_bytes_panic(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        let _ = ObjectNames::from_bytes(&bytes);
    }
}
