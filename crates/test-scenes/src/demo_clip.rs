//! The clip of `splatseg demo`.

use std::fs;
use std::path::{Path, PathBuf};

/// The folder of the clip, a rendered scene in ScanNet's exported layout.
pub fn demo_clip() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../splatseg-cli/demo")
}

/// Copies subfolders of the clip (`color`, `depth`, `pose`, `intrinsic`, `instance-filt`) to a folder, which is made if
/// it is missing: all files whose names are not numbers, and those with numbers below `frames`.
pub fn copy_demo_clip(parts: &[&str], frames: usize, folder: &Path) {
    for part in parts {
        fs::create_dir_all(folder.join(part)).unwrap();
        for entry in fs::read_dir(demo_clip().join(part)).unwrap() {
            let path = entry.unwrap().path();
            let number: Option<usize> = path.file_stem().unwrap().to_str().unwrap().parse().ok();
            if number.is_none_or(|number| number < frames) {
                fs::copy(&path, folder.join(part).join(path.file_name().unwrap())).unwrap();
            }
        }
    }
}
