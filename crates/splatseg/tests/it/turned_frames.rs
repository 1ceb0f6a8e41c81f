//! Frames of a camera that is held sideways.

use glam::DMat4;
use splatseg::dataset::{RecordedFrame, open_scene};
use splatseg::geometry::{CameraFrame, Mask, Pose, QuarterTurn, ScoredMask, Segmentation};
use splatseg::odometry::{CameraPose, PoseInput, PoseSource, PoseSourceError, PoseUpdate};
use splatseg::segmenter::SegmenterError;
use splatseg::{Pipeline, Segmenter, Settings};
use std::f64::consts::FRAC_PI_2;
use std::sync::{Arc, Mutex};

const SIZE: (usize, usize) = (64, 48);

/// Finds one thing, the upper third of the image, and notes the sizes of the frames it gets.
struct UpperThird {
    prefers_upright: bool,
    sizes: Arc<Mutex<Vec<(usize, usize)>>>,
}

impl Segmenter for UpperThird {
    fn name(&self) -> &str {
        "upper-third"
    }

    fn prefers_upright(&self) -> bool {
        self.prefers_upright
    }

    fn segment(&mut self, frame: &CameraFrame) -> Result<Segmentation, SegmenterError> {
        let (width, height) = (frame.width(), frame.height());
        self.sizes.lock().unwrap().push((width, height));
        let mask = Mask::from_fn(width, height, |_, row| 3 * row < height);
        Ok(vec![ScoredMask { mask, score: 1.0 }].into())
    }
}

/// The poses that come with the frames, of a camera whose images are turned to the right from the first frame on.
struct HeldSideways;

impl PoseSource for HeldSideways {
    fn pose(&mut self, _: &CameraFrame<'_>, input: PoseInput<'_>) -> Result<PoseUpdate, PoseSourceError> {
        Ok(PoseUpdate { turn: QuarterTurn::Left, ..CameraPose::given(*input.given.unwrap()).into() })
    }
}

/// The sizes of the frames that the segmenter got, and whether the top left and the top right pixel show what it found.
fn run(
    rotate: &str,
    prefers_upright: bool,
    poses: Option<Box<dyn PoseSource>>,
) -> (Vec<(usize, usize)>, Vec<[bool; 2]>) {
    let settings: Settings = toml::from_str(&format!("rotate = \"{rotate}\"")).unwrap();
    let sizes = Arc::default();
    let segmenter = UpperThird { prefers_upright, sizes: Arc::clone(&sizes) };
    let mut builder = Pipeline::builder(&settings).segmenter(Box::new(segmenter));
    if let Some(poses) = poses {
        builder = builder.poses(poses);
    }
    let mut pipeline = builder.build().unwrap();
    let scene = open_scene("synthetic:frames=3,width=64,height=48", &settings.dataset).unwrap();
    let shown = (0..3).map(|index| {
        let segments = pipeline.step(&scene.read_frame(index).unwrap()).unwrap().output.segments;
        [(2, 2), (SIZE.0 - 3, 2)].map(|pixel| segments[pixel] != 0)
    });
    let shown = shown.collect();
    (sizes.lock().unwrap().clone(), shown)
}

#[test]
fn what_is_found_in_a_turned_frame_is_turned_back() {
    let (upright, turned) = (SIZE, (SIZE.1, SIZE.0));
    assert_eq!(run("0", true, None), (vec![upright; 3], vec![[true, true]; 3]));
    // Turned clockwise, the left third of the frame is on top.
    assert_eq!(run("90", true, None), (vec![turned; 3], vec![[true, false]; 3]));
    assert_eq!(run("270", true, None), (vec![turned; 3], vec![[false, true]; 3]));
    assert_eq!(run("180", true, None), (vec![upright; 3], vec![[false, false]; 3]));
    assert_eq!(run("90", false, None), (vec![upright; 3], vec![[true, true]; 3]));
}

#[test]
fn a_turn_that_is_found_holds_from_the_next_frame_on() {
    let (sizes, shown) = run("auto", true, Some(Box::new(HeldSideways)));
    assert_eq!(sizes, [SIZE, (SIZE.1, SIZE.0), (SIZE.1, SIZE.0)]);
    assert_eq!(shown[0], [true, true]);
    assert!(shown[2][1]);
    assert_eq!(run("0", true, Some(Box::new(HeldSideways))).0, [SIZE; 3]);
}

#[test]
fn a_world_with_a_known_up_tells_the_turn_with_the_first_frame() {
    let settings = Settings::default();
    let scene = open_scene("synthetic:frames=3,width=64,height=48", &settings.dataset).unwrap();
    let sizes = Arc::default();
    let segmenter = UpperThird { prefers_upright: true, sizes: Arc::clone(&sizes) };
    let builder = Pipeline::builder(&settings).segmenter(Box::new(segmenter)).scene(&scene);
    let mut pipeline = builder.build().unwrap();
    let held = Pose::from_matrix(DMat4::from_rotation_z(FRAC_PI_2)).unwrap();
    let turns = (0..3).map(|index| {
        let RecordedFrame { frame, world_from_camera } = scene.read_recorded(index).unwrap();
        let frame = frame.turned(QuarterTurn::Left).at(world_from_camera.unwrap() * held);
        pipeline.step(&frame).unwrap().turn
    });
    assert_eq!(turns.collect::<Vec<_>>(), [QuarterTurn::None, QuarterTurn::Right, QuarterTurn::Right]);
    // Frames are segmented as the frame before was held.
    assert_eq!(*sizes.lock().unwrap(), [(SIZE.1, SIZE.0), SIZE, SIZE]);
}
