//! `docs/dev/DEPENDENCIES.md` lists exactly the direct dependencies.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

fn read(path: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path);
    fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// The keys of `[workspace.dependencies]` except the workspace's own crates.
fn dependencies() -> BTreeSet<String> {
    let manifest = read("Cargo.toml");
    let table = manifest.split("[workspace.dependencies]").nth(1).unwrap().split("\n[").next().unwrap();
    let names = table.lines().filter_map(|line| line.split_once(" = ")).map(|(name, _)| name.to_owned());
    names.filter(|name| !name.starts_with("splatseg")).collect()
}

/// The first cells of the document's first table.
fn documented() -> BTreeSet<String> {
    let document = read("docs/dev/DEPENDENCIES.md");
    let section = document.split("\n## ").nth(1).unwrap();
    section.lines().filter_map(|line| line.strip_prefix("| `")?.split('`').next()).map(str::to_owned).collect()
}

#[test]
fn every_dependency_is_explained() {
    let (used, documented) = (dependencies(), documented());
    assert!(used.len() > 20, "only {used:?} found in Cargo.toml");
    let missing: Vec<_> = used.difference(&documented).collect();
    let gone: Vec<_> = documented.difference(&used).collect();
    assert!(
        missing.is_empty() && gone.is_empty(),
        "docs/dev/DEPENDENCIES.md lacks {missing:?} and has {gone:?} too many"
    );
}
