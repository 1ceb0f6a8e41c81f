//! Videos without depth, e.g. of a telephone or a webcam: their frames are extracted by `ffmpeg`, and depth is predicted.

use crate::ffmpeg::Extraction;
use crate::files::open_file;
use crate::{DatasetError, DatasetSettings, FolderScene};
use std::io::Read;
use std::path::{Path, PathBuf};

/// Layout, for messages.
pub(crate) const LAYOUT: &str = "a video file without depth (.mp4, .mov, .mkv, .webm, .avi), read with ffmpeg; depth is predicted (--depth-weights)";

/// So many bytes tell the kind of a file.
const HEAD_BYTES: u64 = 16;

/// Returns true for a video in a usual container: MP4 and QuickTime, Matroska and WebM, or AVI.
pub(crate) fn looks_like(path: &Path) -> bool {
    let mut head = Vec::new();
    if !path.is_file() || open_file(path).is_ok_and(|file| file.take(HEAD_BYTES).read_to_end(&mut head).is_err()) {
        return false;
    }
    let is_mp4 = head.get(4..8) == Some(b"ftyp");
    let is_matroska = head.starts_with(&[0x1A, 0x45, 0xDF, 0xA3]);
    let is_avi = head.starts_with(b"RIFF") && head.get(8..12) == Some(b"AVI ");
    is_mp4 || is_matroska || is_avi
}

/// Extracts the frames and lists them. Uses only `fx` to `cy`, `max_pixels`, and what selects frames of `settings`. Poses are
/// those of `NAME.poses.txt` beside `NAME.mp4`, if there is such a file.
///
/// # Errors
/// If `ffmpeg` is missing or cannot decode the video, or the poses cannot be assigned.
pub(crate) fn open(path: &Path, settings: &DatasetSettings) -> Result<FolderScene, DatasetError> {
    open_with("ffmpeg", path, settings)
}

fn open_with(program: &str, path: &Path, settings: &DatasetSettings) -> Result<FolderScene, DatasetError> {
    settings.validate()?;
    // Large frames are reduced while they are extracted, which saves time and disk.
    let area = settings.max_pixels;
    let scale = format!(
        "scale='trunc(iw*min(1,sqrt({area}/(iw*ih))))':-1:flags=area+accurate_rnd+bitexact,showinfo=checksum=0"
    );
    let mut after: Vec<_> = ["-map", "0:v:0", "-q:v", "2", "-vf", &scale].map(Into::into).into();
    if let Some(most) = settings.max_frames {
        let needed = settings.start.saturating_add(most.saturating_mul(settings.stride));
        after.extend(["-frames:v".into(), needed.to_string().into()]);
    }
    let extraction = Extraction {
        program,
        video: path,
        before: &["-v", "info"],
        after: &after,
        names: "%06d.jpg",
        instead: "images: install ffmpeg, or give a folder of the video's images",
    };
    let extracted = extraction.run()?;
    extracted.warn_of_damage(path);
    let times = times_in(&extracted.messages);
    FolderScene::of_video(path, &poses_beside(path), extracted.folder, &times, settings)
}

/// The list of poses beside a video.
fn poses_beside(path: &Path) -> PathBuf {
    path.with_extension("poses.txt")
}

/// The times of the frames, seconds, in what `ffmpeg`'s filter `showinfo` writes.
fn times_in(messages: &str) -> Vec<f64> {
    let time = |line: &str| {
        let (_, after) = line.split_once(" pts_time:")?;
        after.split_whitespace().next()?.parse::<f64>().ok().filter(|time| time.is_finite())
    };
    messages.lines().filter(|line| line.contains("showinfo")).filter_map(time).collect()
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use crate::ffmpeg::tests::program;
    use crate::{Format, Scene};
    use std::time::Duration;

    /// A program that writes three images and their times as ffmpeg does.
    fn stand_in(folder: &Path) -> String {
        image::RgbImage::from_pixel(64, 48, image::Rgb([90, 80, 70])).save(folder.join("frame.jpg")).unwrap();
        let script = r#"for last; do true; done
            here="$(dirname "$0")"; to="$(dirname "$last")"; echo "$*" > "$here/log"
            for n in 0 1 2; do cp "$here/frame.jpg" "$to/00000$n.jpg"
            echo "[Parsed_showinfo_1 @ 0x5] n:   $n pts:   $n pts_time:0.$n   duration: 1" >&2; done"#;
        program(folder, script)
    }

    fn open(folder: &Path, settings: &DatasetSettings) -> Result<FolderScene, DatasetError> {
        let video = folder.join("walk.mp4");
        std::fs::write(&video, b"\0\0\0\x20ftypisom").unwrap();
        assert!(looks_like(&video));
        open_with(&stand_in(folder), &video, settings)
    }

    #[test]
    fn frames_have_times_no_depth_and_a_guessed_camera() {
        let folder = tempfile::tempdir().unwrap();
        let scene = open(folder.path(), &DatasetSettings::default()).unwrap();
        assert_eq!((scene.name(), scene.frame_count(), scene.format()), ("walk", 3, Some(Format::Video)));
        assert!(!scene.has_depth() && !scene.has_poses());
        let frame = scene.read_recorded(2).unwrap().frame;
        assert_eq!(frame.timestamp(), Some(Duration::from_millis(200)));
        assert!(frame.depth().pixels().iter().all(|depth| *depth == 0.0));
        let camera = frame.intrinsics();
        assert!((camera.fx - 55.43).abs() < 0.01 && camera.fx == camera.fy, "60 degrees across: {camera:?}");
        assert!(scene.sources().iter().any(|source| source.contains("60 degrees")), "{:?}", scene.sources());
    }

    #[test]
    fn settings_give_the_camera_and_select_frames() {
        let folder = tempfile::tempdir().unwrap();
        let settings = DatasetSettings::default().with(|settings| {
            (settings.fx, settings.start, settings.stride, settings.max_frames) = (Some(70.0), 4, 3, Some(2));
        });
        let scene = open(folder.path(), &settings).unwrap();
        assert!(scene.read_recorded(0).unwrap().frame.intrinsics().fx == 70.0 && scene.sources().is_empty());
        let log = std::fs::read_to_string(folder.path().join("log")).unwrap();
        assert!(log.contains("-frames:v 10") && log.contains("sqrt(2100000/(iw*ih))"), "{log}");
    }

    #[test]
    fn poses_beside_the_video_are_assigned_by_time() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("walk.poses.txt"), "0.1 1 2 3 0 0 0 1\n0.2 1 2 4 0 0 0 1\n").unwrap();
        let scene = open(folder.path(), &DatasetSettings::default()).unwrap();
        let z = |index| scene.read_recorded(index).unwrap().world_from_camera.map(|pose| pose.translation().z);
        assert_eq!([z(0), z(1), z(2)], [None, Some(3.0), Some(4.0)]);
    }

    #[test]
    fn without_ffmpeg_it_is_told_what_to_do() {
        let missing = open_with("/nothing/ffmpeg", Path::new("walk.mp4"), &DatasetSettings::default());
        let told = missing.map(|_| ()).unwrap_err().to_string();
        assert!(told.contains("install ffmpeg, or give a folder") && !told.contains('\n'), "{told}");
    }
}
