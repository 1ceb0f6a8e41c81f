//! Paths in `summary.json`, which are relative to its folder: so it can be read from any folder, and results can be moved
//! together with their recording.

use std::path::{Component, Path, PathBuf};

/// Returns a path that was given relative to the current folder as one relative to `folder`. Absolute paths, and paths of
/// nothing that exists, such as `synthetic:frames=60`, stay as they are. A video in a folder or archive, `PLACE:VIDEO`,
/// has the path of its place.
pub(crate) fn relative_to(folder: &Path, path: &Path) -> PathBuf {
    if path.is_absolute() {
        return path.to_owned();
    }
    if let (false, Some((place, video))) = (path.exists(), path.to_str().and_then(|text| text.rsplit_once(':'))) {
        let mut text = relative_to(folder, Path::new(place)).into_os_string();
        text.push(format!(":{video}"));
        return text.into();
    }
    let (Ok(to), Ok(from)) = (path.canonicalize(), folder.canonicalize()) else { return path.to_owned() };
    let (to, from): (Vec<Component<'_>>, Vec<Component<'_>>) = (to.components().collect(), from.components().collect());
    let shared = to.iter().zip(&from).take_while(|(one, other)| one == other).count();
    // On Windows, files on two drives have no relative path.
    if shared == 0 {
        return to.iter().collect();
    }
    let up = std::iter::repeat_n(Component::ParentDir, from.len() - shared);
    up.chain(to[shared..].iter().copied()).collect()
}

/// Reverses [`relative_to`]. What does not exist there stays as it is.
pub(crate) fn resolved(folder: &Path, path: &Path) -> PathBuf {
    if path.is_absolute() {
        return path.to_owned();
    }
    let joined = joined(folder, path);
    let place = joined.to_str().and_then(|text| text.rsplit_once(':')).map(|(place, _)| Path::new(place));
    if joined.exists() || place.is_some_and(Path::exists) { joined } else { path.to_owned() }
}

/// Joins a folder and a relative path. Leading `..` take away the folder's last parts, unless these are links or `..`.
fn joined(folder: &Path, path: &Path) -> PathBuf {
    let (mut start, mut rest) = (folder.to_owned(), path.components());
    while rest.clone().next() == Some(Component::ParentDir)
        && matches!(start.components().next_back(), Some(Component::Normal(_)))
        && !start.is_symlink()
    {
        start.pop();
        rest.next();
    }
    start.join(rest.as_path())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn a_path_survives_the_way_into_a_summary_and_back() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().canonicalize().unwrap();
        fs::create_dir_all(root.join("rooms/kitchen")).unwrap();
        fs::create_dir_all(root.join("results/out")).unwrap();
        let out = root.join("results/out");
        // Tests share the current folder, so that the paths are relative to it.
        let here = std::env::current_dir().unwrap().canonicalize().unwrap();
        let up: PathBuf = here.components().skip(1).map(|_| Component::ParentDir).collect();
        let given = |path: &str| up.join(root.join(path).strip_prefix("/").unwrap());
        let kept = relative_to(&out, &given("rooms/kitchen"));
        assert_eq!(kept, Path::new("../../rooms/kitchen"));
        assert_eq!(resolved(&out, &kept), root.join("rooms/kitchen"));
        let mut video = given("rooms/kitchen").into_os_string();
        video.push(":7");
        let kept = relative_to(&out, Path::new(&video));
        assert_eq!(kept, Path::new("../../rooms/kitchen:7"));
        assert_eq!(resolved(&out, &kept), root.join("rooms/kitchen:7"));
        for same in [root.join("rooms/kitchen"), "synthetic:frames=60".into(), "nowhere/kitchen".into()] {
            assert_eq!((relative_to(&out, &same), resolved(&out, &same)), (same.clone(), same));
        }
    }
}
