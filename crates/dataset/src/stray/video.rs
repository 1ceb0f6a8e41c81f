//! The frames of a recording's video, at the size of depth, and the size that they have in it.

use crate::DatasetError;
use crate::decode::image_size;
use crate::error::COLOR_IMAGE;
use crate::ffmpeg::{Extracted, Extraction};
use crate::own_camera::has_shape;
use std::path::Path;
use tempfile::TempDir;

/// Name of the first frame.
const FIRST: &str = "000000.png";

/// Extracts the frames as `000000.png`, `000001.png`, ... of `size` `(width, height)` to a temporary folder, unturned, as depth is.
/// Returns it, and the size of the video. `program` is `ffmpeg`.
///
/// # Errors
/// [`DatasetError::Field`] if the program is missing or fails; it says how to extract the frames by hand.
/// [`DatasetError::SizesDiffer`] if the video has another shape than depth.
pub(super) fn extract(
    program: &str,
    video: &Path,
    size: (usize, usize),
) -> Result<(TempDir, (usize, usize)), DatasetError> {
    // The first frame tells the size of all.
    let first = run(program, video, &["-frames:v", "1"])?;
    let whole = image_size(&first.folder.path().join(FIRST), COLOR_IMAGE)
        .map_err(|_| DatasetError::NoFrames { path: video.to_owned(), expected: "a video stream" })?;
    if !has_shape(whole, size) {
        return Err(DatasetError::SizesDiffer {
            path: video.to_owned(),
            what: "video",
            found: whole,
            expected: size,
            expected_from: "depth, which shows the same view,",
        });
    }
    let scale = format!("scale={}:{}:flags=area+accurate_rnd+bitexact", size.0, size.1);
    // At the scale of depth, with the same pixels on every machine.
    let frames = run(program, video, &["-vf", &scale])?;
    frames.warn_of_damage(video);
    Ok((frames.folder, whole))
}

fn run(program: &str, video: &Path, after: &[&str]) -> Result<Extracted, DatasetError> {
    let after: Vec<_> = after.iter().map(Into::into).collect();
    let extraction = Extraction {
        program,
        video,
        before: &["-v", "error", "-noautorotate"],
        after: &after,
        names: "%06d.png",
        instead: "images: install ffmpeg, or extract them with `mkdir rgb && ffmpeg -noautorotate -i rgb.mp4 -fps_mode \
                  passthrough -start_number 0 -q:v 2 rgb/%06d.jpg` in the recording's folder",
    };
    extraction.run()
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use crate::ffmpeg::tests::program;

    #[test]
    fn frames_are_written_to_a_folder_that_is_removed() {
        let folder = tempfile::tempdir().unwrap();
        image::RgbImage::new(64, 48).save(folder.path().join("frame.png")).unwrap();
        let script = r#"for last; do true; done; here="$(dirname "$0")"
            cp "$here/frame.png" "$(dirname "$last")/000000.png"; echo "$*" > "$here/log""#;
        let program = program(folder.path(), script);
        let (frames, size) = extract(&program, Path::new("rgb.mp4"), (256, 192)).unwrap();
        assert_eq!(size, (64, 48));
        assert!(frames.path().join("000000.png").is_file());
        let log = std::fs::read_to_string(folder.path().join("log")).unwrap();
        assert!(log.contains("-noautorotate -i rgb.mp4") && log.contains("scale=256:192:flags=area"), "{log}");
        let path = frames.path().to_owned();
        drop(frames);
        assert!(!path.exists());
        let told = extract(&program, Path::new("rgb.mp4"), (256, 144)).unwrap_err().to_string();
        let expected = "rgb.mp4: the video has 64x48 pixels, but depth, which shows the same view, has 256x144";
        assert_eq!(told, expected);
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
