//! `docs/SETTINGS.md` agrees with the declarations of the settings.

use std::path::Path;

#[test]
fn the_document_is_up_to_date() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/SETTINGS.md");
    let document = std::fs::read_to_string(&path).unwrap_or_default();
    let expected = splatseg::settings::markdown();
    let differs = document.trim_end() != expected.trim_end();
    assert!(!differs, "{} is not up to date: splatseg settings > docs/SETTINGS.md", path.display());
}
