//! Every relative link of every document leads to a file, and to a heading if it names one.

use std::fs;
use std::path::{Path, PathBuf};

/// Folders with documents; deeper ones are searched, except build outputs.
const FOLDERS: [&str; 9] = [".", "docs", "crates", "python", "ros", "xtask", "fuzz", "training", "tools"];

/// Adds the documents of a folder and those below it. The folder at the top is not searched further.
pub fn documents(folder: &Path, is_top: bool, found: &mut Vec<PathBuf>) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for entry in entries {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() {
            if !is_top && name != "target" && !name.starts_with('.') {
                documents(&path, false, found);
            }
        } else if name.ends_with(".md") {
            found.push(path);
        }
    }
}

/// The targets of `[text](target)`.
pub fn targets(text: &str) -> Vec<&str> {
    let ends = text.match_indices("](").map(|(at, _)| &text[at + 2..]);
    ends.filter_map(|rest| rest.split([')', '\n', ' ']).next()).collect()
}

/// The name of a heading in links: lower case, spaces as hyphens, no punctuation.
fn anchor(heading: &str) -> String {
    let kept = heading.trim().chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
    kept.collect::<String>().to_lowercase().replace(' ', "-")
}

fn has_heading(text: &str, wanted: &str) -> bool {
    text.lines().filter_map(|line| line.strip_prefix('#')).any(|line| anchor(line.trim_start_matches('#')) == wanted)
}

#[test]
fn links_lead_somewhere() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut found = Vec::new();
    for folder in FOLDERS {
        documents(&root.join(folder), folder == ".", &mut found);
    }
    assert!(found.len() > 30, "only {} documents found", found.len());
    let mut wrong = Vec::new();
    for document in &found {
        let text = fs::read_to_string(document).unwrap();
        for target in targets(&text).into_iter().filter(|target| !target.contains(':')) {
            let (file, heading) = target.split_once('#').unwrap_or((target, ""));
            let path = if file.is_empty() { document.clone() } else { document.parent().unwrap().join(file) };
            let is_good = match heading {
                "" => path.exists(),
                heading => fs::read_to_string(&path).is_ok_and(|text| has_heading(&text, heading)),
            };
            if !is_good {
                wrong.push(format!("{}: {target}", document.display()));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn headings_are_found_by_their_names_in_links() {
    assert!(has_heading("# The `map`, saved\n", "the-map-saved"));
    assert!(!has_heading("The map\n", "the-map"));
    assert_eq!(targets("[a](b.md#c) and ![d](e.png)"), ["b.md#c", "e.png"]);
}
