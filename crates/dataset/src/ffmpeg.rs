//! Extraction of a video's frames by the program `ffmpeg`. No decoder of H.264 or HEVC is part of this project.

use crate::DatasetError;
use crate::plausibility::warn_once;
use std::ffi::OsString;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use tempfile::TempDir;

/// Letters of `ffmpeg`'s message that are repeated.
const MESSAGE_LETTERS: usize = 300;

/// How frames are extracted.
pub(crate) struct Extraction<'a> {
    /// The program, `ffmpeg`.
    pub(crate) program: &'a str,
    pub(crate) video: &'a Path,
    /// Arguments before `-i`.
    pub(crate) before: &'a [&'a str],
    /// Arguments after the video.
    pub(crate) after: &'a [OsString],
    /// The name of the images, e.g. `%06d.png`.
    pub(crate) names: &'a str,
    /// A way for the user to do without the program.
    pub(crate) instead: &'a str,
}

impl Extraction<'_> {
    /// Extracts the frames to a temporary folder, and returns it with what the program wrote to its error output.
    ///
    /// # Errors
    /// [`DatasetError::Field`] if the program is missing or fails; it says what to do instead.
    pub(crate) fn run(&self) -> Result<(TempDir, String), DatasetError> {
        let io_error = |source| DatasetError::Io { path: std::env::temp_dir(), source };
        let folder = tempfile::Builder::new().prefix("splatseg-frames").tempdir().map_err(io_error)?;
        let mut command = Command::new(self.program);
        command.args(["-nostdin", "-nostats", "-hide_banner"]).args(self.before).arg("-i").arg(self.video);
        command.args(self.after).arg(folder.path().join(self.names));
        let started = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn();
        if started.is_ok() {
            warn_once(format!("{}: decoding with {}, which may take minutes", self.video.display(), self.program));
        }
        let output = started.and_then(Child::wait_with_output);
        let failed = |found: String| DatasetError::Field {
            path: self.video.to_owned(),
            field: "colour".to_owned(),
            found,
            expected: self.instead.to_owned(),
        };
        match output {
            Err(error) => Err(failed(format!("a video, and {} cannot be started ({error})", self.program))),
            Ok(output) if !output.status.success() => {
                let message = String::from_utf8_lossy(&output.stderr);
                // The reason comes last.
                let lines: Vec<&str> = message.lines().filter(|line| !line.trim().is_empty()).collect();
                let last = lines[lines.len().saturating_sub(3)..].join("; ");
                let message: String = last.chars().take(MESSAGE_LETTERS).collect();
                Err(failed(format!("a video that {} cannot decode ({message})", self.program)))
            }
            Ok(output) => Ok((folder, String::from_utf8_lossy(&output.stderr).into_owned())),
        }
    }
}

#[cfg(all(test, unix))]
pub(crate) mod tests {
    use std::os::unix::fs::PermissionsExt;
    use std::path::Path;

    /// Writes a program that takes the place of ffmpeg.
    pub(crate) fn program(folder: &Path, script: &str) -> String {
        let path = folder.join("ffmpeg");
        std::fs::write(&path, format!("#!/bin/sh\n{script}\n")).unwrap();
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
        path.display().to_string()
    }
}
