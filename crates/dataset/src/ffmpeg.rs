//! Extraction of a video's frames by the program `ffmpeg`. No decoder of H.264 or HEVC is part of this project.

use crate::DatasetError;
use crate::listing::names_in;
use crate::plausibility::warn_once;
use crate::text::shortened;
use std::ffi::OsString;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use tempfile::TempDir;

/// Letters of `ffmpeg`'s message that are repeated.
const MESSAGE_LETTERS: usize = 300;
/// Writes every frame of a video once. The second name is that of versions before 5.1.
const FPS_MODES: [&str; 2] = ["-fps_mode", "-vsync"];
/// The error of versions that do not know the first one.
const UNKNOWN_OPTION: &str = "Unrecognized option 'fps_mode'";
/// Messages about a damaged video, in lower case. `ffmpeg` decodes as much of it as it can, and exits with success.
const DAMAGE: [&str; 4] =
    ["partial file", "invalid nal unit size", "error while decoding", "error submitting packet to decoder"];

/// How frames are extracted: each once, numbered from 0.
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

/// Frames that were extracted.
pub(crate) struct Extracted {
    /// The folder with them.
    pub(crate) folder: TempDir,
    /// The standard error of `ffmpeg`.
    pub(crate) messages: String,
}

impl Extracted {
    /// Warns of a video that is damaged, with the number of its frames.
    pub(crate) fn warn_of_damage(&self, video: &Path) {
        let is_damage = |line: &&str| {
            let line = line.to_ascii_lowercase();
            DAMAGE.iter().any(|damage| line.contains(damage))
        };
        if let Some(line) = self.messages.lines().find(is_damage) {
            let frames = names_in(self.folder.path()).len();
            let line = shortened(line);
            let video = video.display();
            warn_once(format!("{video}: the video is cut off or damaged ({line}): {frames} frames were decoded"));
        }
    }
}

impl Extraction<'_> {
    /// Extracts the frames to a temporary folder.
    ///
    /// # Errors
    /// [`DatasetError::Field`] if the program is missing or fails; it says what to do instead.
    pub(crate) fn run(&self) -> Result<Extracted, DatasetError> {
        let io_error = |source| DatasetError::Io { path: std::env::temp_dir(), source };
        let folder = tempfile::Builder::new().prefix("splatseg-frames").tempdir().map_err(io_error)?;
        let [mode, old_mode] = FPS_MODES;
        let mut output = self.output(folder.path(), mode);
        if output.as_ref().is_ok_and(|output| String::from_utf8_lossy(&output.stderr).contains(UNKNOWN_OPTION)) {
            output = self.output(folder.path(), old_mode);
        }
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
            Ok(output) => Ok(Extracted { folder, messages: String::from_utf8_lossy(&output.stderr).into_owned() }),
        }
    }

    /// Runs the program. `mode` is the name of its option to write every frame once.
    fn output(&self, folder: &Path, mode: &str) -> std::io::Result<Output> {
        let mut command = Command::new(self.program);
        command.args(["-nostdin", "-nostats", "-hide_banner"]).args(self.before).arg("-i").arg(self.video);
        command.args([mode, "passthrough", "-start_number", "0"]).args(self.after).arg(folder.join(self.names));
        let started = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn();
        if started.is_ok() {
            warn_once(format!("{}: decoding with {}, which may take minutes", self.video.display(), self.program));
        }
        started.and_then(Child::wait_with_output)
    }
}

#[cfg(all(test, unix))]
pub(crate) mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    /// Writes a program that takes the place of ffmpeg.
    pub(crate) fn program(folder: &Path, script: &str) -> String {
        let path = folder.join("ffmpeg");
        std::fs::write(&path, format!("#!/bin/sh\n{script}\n")).unwrap();
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
        path.display().to_string()
    }

    #[test]
    fn versions_that_do_not_know_an_option_are_called_with_its_old_name() {
        let folder = tempfile::tempdir().unwrap();
        let script = r#"echo "$*" >> "$(dirname "$0")/log"
            case "$*" in *-fps_mode*) echo "Unrecognized option 'fps_mode'." >&2; exit 1;; esac"#;
        let program = program(folder.path(), script);
        let video = Path::new("old.mp4");
        let extraction = Extraction { program: &program, video, before: &[], after: &[], names: "%d.png", instead: "" };
        assert!(extraction.run().is_ok());
        let log = std::fs::read_to_string(folder.path().join("log")).unwrap();
        let calls: Vec<&str> = log.lines().collect();
        assert!(calls.len() == 2 && calls[1].contains("-i old.mp4 -vsync passthrough -start_number 0"), "{log}");
    }
}
