//! The paths that a command reads, so that it does not write there.

use super::Failure;
use splatseg::Settings;
use std::path::{Component, Path, PathBuf};

/// The files and folders that a command reads, with symbolic links resolved.
#[derive(Clone, Debug, Default)]
pub struct InputPaths {
    paths: Vec<InputPath>,
}

#[derive(Clone, Debug)]
struct InputPath {
    /// Description of the input, e.g. `the scene`.
    what: &'static str,
    /// Its path with symbolic links resolved.
    real: PathBuf,
}

impl InputPaths {
    /// Returns the inputs that the settings name.
    pub fn of(settings: &Settings) -> Self {
        let mut inputs = Self::default();
        for input in settings.input_files() {
            inputs.add(input.what, input.path);
        }
        inputs
    }

    /// Adds a scene, if it has files.
    pub fn add_scene(&mut self, scene: &Path) {
        match scene.to_str().and_then(|text| text.rsplit_once(':')) {
            // A video in a folder or archive.
            Some((place, _)) if !scene.exists() => self.add("the scene", Path::new(place)),
            _ => self.add("the scene", scene),
        }
    }

    /// Adds a file or folder, if it exists.
    pub fn add(&mut self, what: &'static str, path: &Path) {
        if let Ok(real) = path.canonicalize() {
            self.paths.push(InputPath { what, real });
        }
    }

    /// Checks that results in this folder cannot touch an input.
    ///
    /// # Errors
    /// If the folder is an input, is inside one or contains one.
    pub fn check_output_folder(&self, out: &Path) -> Result<(), Failure> {
        let real = real_path(out);
        for input in &self.paths {
            let place = match (real.starts_with(&input.real), input.real.starts_with(&real)) {
                (true, true) => "is",
                (true, false) => "is inside",
                (false, true) => "contains",
                (false, false) => continue,
            };
            return Err(Failure::input(format!(
                "{}: --out {place} {}, {}: choose a folder apart from all inputs",
                out.display(),
                input.what,
                input.real.display()
            )));
        }
        Ok(())
    }

    /// Checks that an output file is not an input.
    ///
    /// # Errors
    /// If it is an input.
    pub fn check_output_file(&self, file: &Path) -> Result<(), Failure> {
        let real = real_path(file);
        match self.paths.iter().find(|input| input.real == real) {
            Some(input) => Err(Failure::input(format!("{}: is {}: choose another file", file.display(), input.what))),
            None => Ok(()),
        }
    }
}

/// Resolves symbolic links in the part of a path that exists.
pub fn real_path(path: &Path) -> PathBuf {
    let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let parts: Vec<Component<'_>> = absolute.components().collect();
    for existing in (0..=parts.len()).rev() {
        if let Ok(mut real) = parts[..existing].iter().collect::<PathBuf>().canonicalize() {
            for part in &parts[existing..] {
                match part {
                    Component::ParentDir => {
                        real.pop();
                    }
                    Component::CurDir => {}
                    part => real.push(part),
                }
            }
            return real;
        }
    }
    absolute
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_that_does_not_exist_yet_is_resolved_as_far_as_possible() {
        let folder = tempfile::tempdir().unwrap();
        let real = folder.path().canonicalize().unwrap();
        assert_eq!(real_path(&folder.path().join("a/../b/c")), real.join("b/c"));
        #[cfg(unix)]
        {
            std::fs::create_dir(folder.path().join("to")).unwrap();
            std::os::unix::fs::symlink("to", folder.path().join("link")).unwrap();
            assert_eq!(real_path(&folder.path().join("link/new")), real.join("to/new"));
        }
    }

    #[test]
    fn folders_beside_an_input_are_allowed() {
        let folder = tempfile::tempdir().unwrap();
        let scene = folder.path().join("scene");
        std::fs::create_dir(&scene).unwrap();
        let mut inputs = InputPaths::default();
        inputs.add_scene(Path::new(&format!("{}:video", scene.display())));
        inputs.check_output_folder(&folder.path().join("scene2")).unwrap();
        for (out, place) in [("scene", "is the scene"), ("scene/a/out", "inside"), (".", "contains")] {
            let error = inputs.check_output_folder(&folder.path().join(out)).unwrap_err().to_string();
            assert!(error.contains(place), "{error}");
        }
    }
}
