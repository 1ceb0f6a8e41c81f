//! Names of objects: what is kept, found, joined, saved and refused.

use proptest::prelude::*;
use splatseg_geometry::RemappedId;
use splatseg_objects::{NameError, ObjectName, ObjectNames};

fn name(label: &str, embedding: &[f32]) -> ObjectName {
    ObjectName { label: Some(label.to_owned()), embedding: embedding.to_vec() }
}

fn kitchen() -> ObjectNames {
    let mut names = ObjectNames::default();
    names.set(3, name("Red mug", &[1.0, 0.0]), 10.0).unwrap();
    names.set(4, name("blue mug", &[0.0, 2.0]), 20.0).unwrap();
    names.set(9, ObjectName { label: None, embedding: vec![-1.0, 0.5] }, 5.0).unwrap();
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
fn damaged_text_is_an_error() {
    let saved = String::from_utf8(kitchen().to_bytes()).unwrap();
    let damaged = |from: &str, to: &str| {
        assert!(saved.contains(from), "{saved}");
        ObjectNames::from_bytes(saved.replacen(from, to, 1).as_bytes()).unwrap_err().to_string()
    };
    assert!(damaged("\"id\":4", "\"id\":3").contains("object 3 occurs twice"));
    assert!(damaged("\"id\":3", "\"id\":0").contains("object 0"));
    assert!(damaged("\"score\":10.0", "\"score\":-1").contains("score"));
    assert!(damaged("AACAPwAAAAA=", "AACAPwAAAA==").contains("half a number"));
    assert!(damaged("AACAPwAAAAA=", "%%").contains("not Base64"));
    assert!(damaged("AACAPwAAAAA=", "AACAPw==").contains("has 2 numbers"));
    for end in 0..saved.len() {
        assert!(ObjectNames::from_bytes(&saved.as_bytes()[..end]).is_err(), "the first {end} bytes");
    }
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
            names.set(id, ObjectName { label, embedding }, score + f64::from(id)).unwrap();
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
