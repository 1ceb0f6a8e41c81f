//! `method_preset = "paper"` has the values of the last column of `docs/PAPER.md`, and no others.

use splatseg::settings::{MethodPreset, entries};
use std::collections::BTreeMap;
use std::path::Path;

/// Choices of a run, not departures from the paper: rows of the table use them to name a part of the paper.
const CHOICES: [&str; 4] = ["method", "segmenter", "prompts", "tracker"];

/// Returns the paper's values by setting: the first alternative in each cell of the last column.
fn documented() -> BTreeMap<String, String> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/PAPER.md");
    let text = std::fs::read_to_string(&path).unwrap().replace(r"\|", " ");
    let mut values = BTreeMap::new();
    for line in text.lines().filter(|line| line.starts_with("| ")) {
        let cell = line.trim_matches('|').split('|').nth(5).unwrap_or_default();
        let first = cell.split(" or ").next().unwrap_or_default();
        for assignment in first.split(", ") {
            if let Some((key, value)) = assignment.split_once(" = ") {
                let plain = |text: &str| text.trim().trim_matches(',').trim_matches('`').to_owned();
                let (key, value) = (plain(key), plain(value));
                if !CHOICES.contains(&key.as_str()) {
                    let before = values.insert(key.clone(), value.clone());
                    assert!(before.is_none_or(|before| before == value), "{key} has two values");
                }
            }
        }
    }
    values
}

#[test]
fn the_papers_preset_matches_the_document() {
    let documented = documented();
    assert!(documented.len() > 30, "{documented:?}");
    for (key, expected) in &documented {
        let entry = entries().into_iter().find(|entry| entry.field.key() == *key);
        let entry = entry.unwrap_or_else(|| panic!("there is no setting {key}"));
        let default = MethodPreset::Paper.default_of(key).or(entry.field.default).unwrap_or_default();
        assert_eq!(default.trim_matches('"'), expected, "{key} with method_preset = paper");
    }
    for entry in entries() {
        let key = entry.field.key();
        if MethodPreset::Paper.default_of(&key).is_some() {
            assert!(documented.contains_key(&key), "docs/PAPER.md has no row for {key}");
        }
    }
}
