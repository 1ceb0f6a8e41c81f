//! The documentation's site has every page of `docs/`. That links are good is tested in `links.rs`.

use crate::links::{documents, targets};
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

/// The pages that a page of `docs/` links to, relative to `docs/`; each once.
fn listed(page: &str, text: &str) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    for target in targets(text).into_iter().filter(|target| target.ends_with(".md") && !target.contains(':')) {
        assert!(found.insert(target.to_owned()), "{page} has {target} twice");
    }
    found
}

#[test]
fn the_site_has_every_page() {
    let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs");
    let mut files = Vec::new();
    documents(&docs, false, &mut files);
    let relative = |path: &Path| path.strip_prefix(&docs).unwrap().to_string_lossy().replace('\\', "/");
    let mut pages: BTreeSet<String> = files.iter().map(|path| relative(path)).collect();
    assert!(pages.len() > 20, "only {} pages found", pages.len());
    pages.remove("SUMMARY.md");
    let read = |name: &str| fs::read_to_string(docs.join(name)).unwrap();
    let in_summary = listed("docs/SUMMARY.md", &read("SUMMARY.md"));
    assert_eq!(in_summary, pages, "docs/SUMMARY.md does not list exactly the pages of docs/");
    // The first page lists the others, too, and documents elsewhere.
    let on_first_page = listed("docs/README.md", &read("README.md"));
    pages.remove("README.md");
    let missing: Vec<_> = pages.difference(&on_first_page).collect();
    assert!(missing.is_empty(), "docs/README.md lacks {missing:?}");
}
