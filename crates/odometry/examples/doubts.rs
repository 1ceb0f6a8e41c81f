//! Prints what the checks of the input say about a scene, and how long they take.
//!
//! `doubts SCENE [WIDTHxHEIGHT] [POSES] [DEPTH]`: POSES states the poses otherwise before they are checked, as
//! `world-to-camera`, `wxyz`, `centimetres` or `-`; DEPTH is a factor of all depth, or `late=N` to give each frame the
//! depth of N frames before, or `right=N` to move depth by N pixels.

use splatseg_dataset::{DatasetSettings, FrameStream, GroundTruth, PoseConvention, QuaternionOrder, open_scene};
use splatseg_geometry::{CameraFrame, Image, Pose};
use splatseg_odometry::{PoseInput, PoseMode, PoseSource, TrackedPoses};
use splatseg_settings::Choice;
use std::collections::VecDeque;
use std::error::Error;
use std::time::{Duration, Instant};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let argument = |number: usize| arguments.get(number).map(String::as_str).filter(|text| *text != "-");
    let path = argument(0).ok_or("doubts SCENE [WIDTHxHEIGHT] [POSES] [DEPTH]")?;
    let resize = argument(1).map(str::parse).transpose()?;
    let settings = DatasetSettings::default().with(|settings| settings.resize = resize);
    let stated = DatasetSettings::default().with(|settings| match argument(2) {
        Some("wxyz") => settings.quaternion_order = QuaternionOrder::Wxyz,
        Some("centimetres") => settings.pose_scale = 0.01,
        Some(name) => settings.pose_convention = PoseConvention::from_name(name).unwrap_or_default(),
        None => {}
    });
    let stated = stated.pose_format();
    let mut change = DepthChange::new(argument(3));
    let mut poses = TrackedPoses::new(PoseMode::Auto);
    let (mut total, mut longest, mut count) = (Duration::ZERO, Duration::ZERO, 0);
    for streamed in FrameStream::open(open_scene(path, &settings)?, &settings, GroundTruth::Skip)? {
        let streamed = streamed?;
        let given: Option<Pose> = streamed.world_from_camera.map(|pose| stated.stated(&pose));
        let Some(frame) = change.of(streamed.frame)? else { continue };
        let started = Instant::now();
        let update = poses.pose(&frame, PoseInput::new(count, given.as_ref()))?;
        let time = started.elapsed();
        (total, longest, count) = (total + time, longest.max(time), count + 1);
        for doubt in update.doubts {
            println!("frame {count}: {:?}: {}", doubt.kind, doubt.text);
        }
    }
    for doubt in poses.finish() {
        println!("end: {:?}: {}", doubt.kind, doubt.text);
    }
    println!("{path}: {count} frames, {total:.1?} in all, {longest:.1?} the longest");
    Ok(())
}

/// A change of the depth of all frames.
struct DepthChange {
    factor: f32,
    late: usize,
    right: usize,
    waiting: VecDeque<Image<f32>>,
}

impl DepthChange {
    fn new(text: Option<&str>) -> Self {
        let of = |name: &str| text.and_then(|text| text.strip_prefix(name)?.parse().ok()).unwrap_or(0);
        let factor = text.and_then(|text| text.parse().ok()).unwrap_or(1.0);
        Self { factor, late: of("late="), right: of("right="), waiting: VecDeque::new() }
    }

    fn of(&mut self, frame: CameraFrame<'static>) -> Result<Option<CameraFrame<'static>>, Box<dyn Error>> {
        let own = frame.depth();
        let depth = Image::from_fn(own.width(), own.height(), |column, row| {
            column.checked_sub(self.right).map_or(0.0, |from| own[(from, row)] * self.factor)
        });
        self.waiting.push_back(depth);
        if self.waiting.len() <= self.late {
            return Ok(None);
        }
        let depth = self.waiting.pop_front().ok_or("no depth")?;
        let color = frame.color().clone().into_owned();
        let changed = CameraFrame::new(frame.name(), color, depth, *frame.intrinsics())?;
        Ok(Some(changed.with_timestamp(frame.timestamp())))
    }
}
