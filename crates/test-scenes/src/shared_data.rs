//! Data that are too large for the repository, or may not be redistributed: `shared`, beside the checkout.

use std::io::Write;
use std::path::{Path, PathBuf};

/// Reports on a line of its own that a test is skipped; `.ci/run` lists these lines. Not with `println!`, whose output
/// the test runner hides when a test passes.
pub fn skipped(test: &str, reason: &str) {
    let _ = std::io::stderr().write_all(format!("\nskipped: {test}: {reason}\n").as_bytes());
}

/// The folder with the shared data. If there is none, reports that `test` is skipped and returns `None`.
pub fn shared_folder(test: &str) -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared");
    if !folder.exists() {
        skipped(test, "../shared is not here");
        return None;
    }
    Some(folder)
}

/// A file or folder of the shared data, e.g. `data/rooms/dev-a`. If it is missing, reports that `test` is skipped and
/// returns `None`.
pub fn shared(path: &str, test: &str) -> Option<PathBuf> {
    let found = shared_folder(test)?.join(path);
    if !found.exists() {
        skipped(test, &format!("../shared/{path} is not here"));
        return None;
    }
    Some(found)
}
