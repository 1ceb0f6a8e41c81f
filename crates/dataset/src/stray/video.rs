//! Extraction of a video's frames by the program `ffmpeg`. No decoder of HEVC is part of this project.

use crate::DatasetError;
use crate::plausibility::warn_once;
use std::path::Path;
use std::process::{Command, Stdio};
use tempfile::TempDir;

/// Letters of `ffmpeg`'s message that are repeated.
const MESSAGE_LETTERS: usize = 300;

/// Extracts the frames as `000000.png`, `000001.png`, ... of `size` `(width, height)` to a temporary folder, unturned, as depth is.
/// `program` is `ffmpeg`.
///
/// # Errors
/// [`DatasetError::Field`] if the program is missing or fails; it says how to extract the frames by hand.
pub(super) fn extract(program: &str, video: &Path, size: (usize, usize)) -> Result<TempDir, DatasetError> {
    let io_error = |source| DatasetError::Io { path: std::env::temp_dir(), source };
    let folder = tempfile::Builder::new().prefix("splatseg-frames").tempdir().map_err(io_error)?;
    warn_once(format!("{}: decoding with {program}, which may take minutes", video.display()));
    let mut command = Command::new(program);
    command.args(["-nostdin", "-v", "error", "-noautorotate", "-i"]).arg(video);
    // Every frame of the video once, at the scale of depth, with the same pixels on every machine.
    command.args(["-fps_mode", "passthrough", "-start_number", "0", "-vf"]);
    command.arg(format!("scale={}:{}:flags=area+accurate_rnd+bitexact", size.0, size.1));
    command.arg(folder.path().join("%06d.png"));
    let output = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).output();
    let failed = |found: String| DatasetError::Field {
        path: video.to_owned(),
        field: "colour".to_owned(),
        found,
        expected:
            "images: install ffmpeg, or extract them with `mkdir rgb && ffmpeg -noautorotate -i rgb.mp4 -fps_mode \
                   passthrough -start_number 0 -q:v 2 rgb/%06d.jpg` in the recording's folder"
                .to_owned(),
    };
    match output {
        Err(error) => Err(failed(format!("a video, and {program} cannot be started ({error})"))),
        Ok(output) if !output.status.success() => {
            let message = String::from_utf8_lossy(&output.stderr);
            let message: String = message.trim().replace('\n', "; ").chars().take(MESSAGE_LETTERS).collect();
            Err(failed(format!("a video that {program} cannot decode ({message})")))
        }
        Ok(_) => Ok(folder),
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    /// Writes a program that takes the place of ffmpeg.
    fn program(folder: &Path, script: &str) -> String {
        let path = folder.join("ffmpeg");
        std::fs::write(&path, format!("#!/bin/sh\n{script}\n")).unwrap();
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
        path.display().to_string()
    }

    #[test]
    fn frames_are_written_to_a_folder_that_is_removed() {
        let folder = tempfile::tempdir().unwrap();
        let script =
            r#"for last; do true; done; touch "$(dirname "$last")/000000.png"; echo "$*" > "$(dirname "$0")/log""#;
        let frames = extract(&program(folder.path(), script), Path::new("rgb.mp4"), (256, 192)).unwrap();
        assert!(frames.path().join("000000.png").is_file());
        let log = std::fs::read_to_string(folder.path().join("log")).unwrap();
        assert!(log.contains("-noautorotate -i rgb.mp4") && log.contains("scale=256:192:flags=area"), "{log}");
        let path = frames.path().to_owned();
        drop(frames);
        assert!(!path.exists());
    }

    #[test]
    fn without_ffmpeg_it_is_told_how_to_extract_frames() {
        let folder = tempfile::tempdir().unwrap();
        let told = |program: &str| extract(program, Path::new("rgb.mp4"), (4, 3)).unwrap_err().to_string();
        let missing = told(&folder.path().join("nothing").display().to_string());
        assert!(missing.contains("cannot be started") && missing.contains("-q:v 2 rgb/%06d.jpg"), "{missing}");
        let failed = told(&program(folder.path(), "echo 'moov atom not found' >&2; exit 1"));
        assert!(failed.contains("cannot decode (moov atom not found)") && !failed.contains('\n'), "{failed}");
    }
}
