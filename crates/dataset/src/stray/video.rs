//! The frames of a recording's video, at the size of depth.

use crate::DatasetError;
use crate::ffmpeg::Extraction;
use std::path::Path;
use tempfile::TempDir;

/// Extracts the frames as `000000.png`, `000001.png`, ... of `size` `(width, height)` to a temporary folder, unturned, as depth is.
/// `program` is `ffmpeg`.
///
/// # Errors
/// [`DatasetError::Field`] if the program is missing or fails; it says how to extract the frames by hand.
pub(super) fn extract(program: &str, video: &Path, size: (usize, usize)) -> Result<TempDir, DatasetError> {
    let scale = format!("scale={}:{}:flags=area+accurate_rnd+bitexact", size.0, size.1);
    // Every frame of the video once, at the scale of depth, with the same pixels on every machine.
    let after = ["-fps_mode", "passthrough", "-start_number", "0", "-vf", &scale].map(Into::into);
    let extraction = Extraction {
        program,
        video,
        before: &["-v", "error", "-noautorotate"],
        after: &after,
        names: "%06d.png",
        instead: "images: install ffmpeg, or extract them with `mkdir rgb && ffmpeg -noautorotate -i rgb.mp4 -fps_mode \
                  passthrough -start_number 0 -q:v 2 rgb/%06d.jpg` in the recording's folder",
    };
    Ok(extraction.run()?.0)
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use crate::ffmpeg::tests::program;

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
