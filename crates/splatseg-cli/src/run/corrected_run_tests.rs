//! Runs in which a frame brings a correction of earlier poses and ids, with a scripted source of poses and a scripted
//! method.

use super::saved_run::SavedRun;
use super::{OverwritePolicy, RunJob, execute_with};
use crate::Failure;
use glam::DVec3;
use serde_json::Value;
use splatseg::settings::MethodSettings;
use splatseg::summary::Summary;
use splatseg::{Pipeline, Settings};
use splatseg_dataset::{Scene, read_segments_png};
use splatseg_geometry::{
    CameraFrame, FrameAnchor, KeyframeId, MapCorrection, Pose, RemappedId, RgbdFrame, SegmentId, Segmentation,
};
use splatseg_memory::SplatMemory;
use splatseg_odometry::{CameraPose, KeyframePlace, PoseInput, PoseSource, PoseSourceError, PoseUpdate};
use splatseg_output::draw_overlay;
use splatseg_tracking::{FastSamSplat, FrameOutput, Method, TrackingError};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

const ROOM: &str = "synthetic:frames=18,width=64,height=48,objects=6";
/// Frames that show ids a second time, under other numbers.
const DOUBLED: std::ops::Range<usize> = 5..9;
/// The frame that closes the loop.
const LOOP: usize = 12;
/// The doubles' numbers are larger by this.
const OFFSET: SegmentId = 1000;
/// Frames per keyframe.
const PER_KEYFRAME: usize = 4;
/// The keyframe that moves.
const MOVED: KeyframeId = 1;

fn number(name: &str) -> usize {
    name.trim_start_matches("frame-").parse().unwrap()
}

fn moved() -> Pose {
    Pose::from_translation(DVec3::new(0.1, 0.0, 0.02))
}

/// The pose of a keyframe at a frame.
fn keyframe_pose(keyframe: KeyframeId, frame: usize) -> Pose {
    let pose = Pose::from_translation(DVec3::new(f64::from(keyframe), 0.0, 0.0));
    if keyframe == MOVED && frame >= LOOP { moved() * pose } else { pose }
}

/// Given poses, of which those of keyframe [`MOVED`] are corrected at [`LOOP`].
#[derive(Default)]
struct ScriptedPoses {
    frame: usize,
}

impl PoseSource for ScriptedPoses {
    fn pose(&mut self, frame: &CameraFrame<'_>, input: PoseInput<'_>) -> Result<PoseUpdate, PoseSourceError> {
        self.frame = number(frame.name());
        let keyframe = (self.frame / PER_KEYFRAME) as KeyframeId;
        let world_from_keyframe = keyframe_pose(keyframe, self.frame);
        let new_from_old = BTreeMap::from([(MOVED, moved())]);
        Ok(PoseUpdate {
            anchor: FrameAnchor { keyframe, world_from_keyframe, ..FrameAnchor::default() },
            correction: (self.frame == LOOP).then(|| MapCorrection { new_from_old, joined: vec![(0, 3)] }),
            ..CameraPose::given(*input.given.unwrap()).into()
        })
    }

    fn keyframes(&self) -> BTreeMap<KeyframeId, KeyframePlace> {
        let place = |keyframe| KeyframePlace { world_from_keyframe: keyframe_pose(keyframe, self.frame), part: 0 };
        (0..5).map(|keyframe| (keyframe, place(keyframe))).collect()
    }
}

/// A method that shows half of the pixels of some frames under other ids, and fails at a frame.
struct ScriptedMethod {
    method: FastSamSplat,
    fails_at: Option<usize>,
}

impl Method for ScriptedMethod {
    fn name(&self) -> &str {
        "scripted"
    }

    fn process(&mut self, frame: &RgbdFrame, found: &Segmentation) -> Result<FrameOutput, TrackingError> {
        let number = number(frame.name());
        if self.fails_at == Some(number) {
            return Err(TrackingError::TooManyMasks { found: 0, limit: 0 });
        }
        let mut output = self.method.process(frame, found)?;
        if DOUBLED.contains(&number) {
            let width = output.segments.width();
            for (index, id) in output.segments.pixels_mut().iter_mut().enumerate() {
                if *id > 0 && index % width > width / 2 {
                    *id += OFFSET;
                }
            }
        }
        Ok(output)
    }

    fn correct_map(&mut self, _: &MapCorrection) -> Vec<RemappedId> {
        (1..60).map(|id| RemappedId { from: id + OFFSET, into: id }).collect()
    }

    fn memory(&self) -> Option<&SplatMemory> {
        self.method.memory()
    }
}

/// A run to `out`, which fails at a frame.
fn run(out: &Path, resume: Option<SavedRun>, fails_at: Option<usize>) -> Result<Summary, Failure> {
    let mut settings = Settings::default();
    settings.run.save_every = 3;
    let file = |extension: &str| Some(out.with_extension(extension));
    let job = RunJob {
        scene: PathBuf::from(ROOM),
        out: out.to_owned(),
        existing: if resume.is_some() { OverwritePolicy::Resume } else { OverwritePolicy::Keep },
        settings,
        save_memory: None,
        load_memory: None,
        resume,
        save_coco: file("json"),
        save_mcap: file("mcap"),
        networks: Arc::default(),
    };
    execute_with(&job, |job, scene| Ok(pipeline(job, scene, fails_at)))
}

fn pipeline(job: &RunJob, scene: &Arc<dyn Scene>, fails_at: Option<usize>) -> Pipeline {
    let MethodSettings::FastsamSplat(method) = &job.settings.method else { panic!("another default method") };
    let method = match &job.resume {
        Some(saved) => {
            let memory = SplatMemory::load(saved.memory(), method.memory.clone()).unwrap();
            FastSamSplat::with_memory(method.clone(), memory)
        }
        None => FastSamSplat::new(method.clone(), 0, &mut |_| {}),
    };
    let method = ScriptedMethod { method: method.unwrap(), fails_at };
    let objects = job.resume.as_ref().map(SavedRun::objects).unwrap_or_default();
    let builder = Pipeline::builder(&job.settings).scene(scene).objects(objects);
    builder.poses(Box::<ScriptedPoses>::default()).method(Box::new(method)).build().unwrap()
}

fn read_json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

/// Every file of a run and beside it, without those that contain times or the order of writing.
fn files(out: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = BTreeMap::new();
    let mut folders = vec![out.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                files.insert(path.strip_prefix(out).unwrap().to_owned(), fs::read(&path).unwrap());
            }
        }
    }
    files.remove(Path::new("manifest.jsonl")).unwrap();
    files.remove(Path::new("summary.json")).unwrap();
    for extension in ["json", "mcap"] {
        files.insert(PathBuf::from(extension), fs::read(out.with_extension(extension)).unwrap());
    }
    files
}

/// Lines of a run's `poses.txt`, as numbers.
fn poses(out: &Path) -> Vec<Vec<f64>> {
    let text = fs::read_to_string(out.join("poses.txt")).unwrap();
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    lines.map(|line| line.split(' ').map(|number| number.parse().unwrap()).collect()).collect()
}

#[test]
fn all_results_have_the_final_ids_and_poses() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let summary = run(&out, None, None).unwrap();
    assert!(summary.error.is_none() && summary.remapped_ids == 59, "{:?}", summary.error);
    let settings = Settings::default();
    let scene = splatseg_dataset::open_scene(Path::new(ROOM), &settings.dataset).unwrap();
    for frame in 0..18 {
        let ids = read_segments_png(&out.join(format!("segments/frame-{frame:06}.png"))).unwrap();
        assert!(ids.pixels().iter().all(|id| *id < OFFSET), "frame {frame}");
        // The overlay shows the final ids too.
        let color = scene.read_frame(frame).unwrap();
        let expected = draw_overlay(color.color(), &ids).unwrap();
        let overlay = image::open(out.join(format!("overlay/frame-{frame:06}.jpg"))).unwrap().to_rgb8();
        let pairs = expected.pixels().iter().flatten().zip(overlay.as_raw());
        let difference: i64 = pairs.map(|(one, other)| (i64::from(*one) - i64::from(*other)).abs()).sum();
        assert!(difference < 12 * overlay.as_raw().len() as i64, "frame {frame}: {difference}");
    }
    let list = read_json(&out.join("objects.json"));
    for object in list["objects"].as_array().unwrap() {
        assert!(object["id"].as_u64() < Some(OFFSET.into()), "{object}");
        assert!(object["frames"].as_u64() <= Some(18), "{object}");
        assert!(object["crop"].is_null() || out.join(object["crop"].as_str().unwrap()).exists(), "{object}");
    }
    for crop in fs::read_dir(out.join("objects")).unwrap() {
        assert!(crop.unwrap().file_name().len() < 8, "the crop of a joined id");
    }
    let tracks = read_json(&out.with_extension("json"));
    assert!(tracks["annotations"].as_array().unwrap().iter().all(|mask| mask["track_id"].as_u64() < Some(1000)));
    for (frame, line) in poses(&out).iter().enumerate() {
        let given = scene.read_frame(frame).unwrap().world_from_camera().translation();
        let expected = if (4..8).contains(&frame) { given + moved().translation() } else { given };
        assert!(DVec3::from_slice(&line[1..4]).distance(expected) < 1e-5, "frame {frame}");
    }
}

#[test]
fn a_stopped_run_with_a_correction_goes_on_to_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let whole = folder.path().join("whole");
    run(&whole, None, None).unwrap();
    let out = folder.path().join("out");
    // Before the doubled ids, among them, before the correction, and after it: then earlier images are rewritten twice.
    let mut stops = [4, 7, 11, 14].into_iter().map(Some).chain([None]);
    let mut resume = None;
    loop {
        let stop = stops.next().unwrap();
        let ended = run(&out, resume.take(), stop);
        assert_eq!(ended.is_ok(), stop.is_none(), "stop {stop:?}");
        if stop.is_none() {
            break;
        }
        resume = SavedRun::open(&out).unwrap();
        assert!(resume.is_some());
    }
    let (expected, found) = (files(&whole), files(&out));
    assert_eq!(found.keys().collect::<Vec<_>>(), expected.keys().collect::<Vec<_>>());
    for (path, bytes) in &expected {
        assert!(found[path] == *bytes, "{} differs", path.display());
    }
    let [whole, out] = [&whole, &out].map(|out| read_json(&out.join("summary.json")));
    for key in ["remapped_ids", "segments", "rgb_id_images", "frames"] {
        assert_eq!(whole[key], out[key], "{key}");
    }
}
