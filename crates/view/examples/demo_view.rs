//! Plays the synthetic room with its true ids, to look at the page without a network:
//! `cargo run -p splatseg-view --example demo_view -- [FRAMES] [FRAMES_PER_SECOND] [PORT]`.

use splatseg_dataset::{Scene, SyntheticScene, SyntheticSettings};
use splatseg_geometry::{RgbdFrame, SegmentId, SegmentMap};
use splatseg_memory::{MemorySettings, SplatMemory};
use splatseg_objects::object_shapes;
use splatseg_ros::{Header, Point, PoseMessage, PoseStamped, Quaternion, Time, to_cdr};
use splatseg_view::{Channel, ViewFrame, ViewObject, ViewOptions, ViewServer, ViewStatus};
use std::collections::{BTreeMap, BTreeSet};
use std::error::Error;
use std::thread;
use std::time::{Duration, Instant};

/// Objects are measured once in this many frames.
const MEASURE_INTERVAL: usize = 5;
/// Frames during which the camera counts as lost, to show how that looks.
const LOST: std::ops::Range<usize> = 100..110;

/// The room's objects, as the demo knows them.
#[derive(Default)]
struct Seen {
    objects: BTreeMap<SegmentId, ViewObject>,
}

impl Seen {
    fn add(&mut self, segments: &SegmentMap) {
        for id in segments.areas().into_keys().filter(|id| *id != 0) {
            let label = Some(format!("thing {id}"));
            let new = ViewObject { id, label, oriented_box: None, frames: 0, state: None, seen: Vec::new() };
            self.objects.entry(id).or_insert(new).frames += 1;
        }
    }

    fn measure(&mut self, memory: &SplatMemory) {
        for (id, shape) in object_shapes(&memory.map()) {
            if let Some(object) = self.objects.get_mut(&id) {
                object.oriented_box = Some(shape.oriented_box);
            }
        }
    }
}

fn view_frame(number: usize, frame: &RgbdFrame<'_>, segments: &SegmentMap, lost: bool) -> ViewFrame {
    ViewFrame {
        number,
        name: frame.name().to_owned(),
        timestamp: frame.timestamp(),
        color: frame.color().clone().into_owned(),
        segments: segments.clone(),
        intrinsics: *frame.intrinsics(),
        status: ViewStatus {
            dropped: 0,
            is_pose_given: true,
            detail: None,
            delay: Some(Duration::from_millis(40)),
            lines: if lost {
                vec!["The camera is lost: turn it to a place that it has seen.".to_owned()]
            } else {
                Vec::new()
            },
        },
    }
}

/// The pose of the camera as a message.
fn pose_message(frame: &RgbdFrame<'_>, time: u64) -> Result<Vec<u8>, Box<dyn Error>> {
    let position = frame.world_from_camera().translation();
    let header = Header { stamp: Time::from_nanoseconds(i64::try_from(time)?), frame_id: "world".to_owned() };
    let pose = PoseMessage {
        position: Point { x: position.x, y: position.y, z: position.z },
        orientation: Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 },
    };
    Ok(to_cdr(&PoseStamped { header, pose })?)
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut numbers = std::env::args().skip(1);
    let mut number = |default: usize| numbers.next().map_or(Ok(default), |text| text.parse());
    let (frames, rate, port) = (number(300)?, number(10)?, number(8765)?);
    let scene = SyntheticScene::new(SyntheticSettings {
        frames,
        width: 640,
        height: 480,
        speed: "0.4".parse()?,
        ..SyntheticSettings::default()
    })?;
    let mut options = ViewOptions { scene: "synthetic room".to_owned(), ..ViewOptions::default() };
    options.address.set_port(u16::try_from(port)?);
    let server = ViewServer::start(options)?;
    println!("{}\n{}", server.link(), server.foxglove_link());
    let channel = server.add_channel(Channel::of::<PoseStamped>("/splatseg/pose").latched());
    let mut memory = SplatMemory::new(MemorySettings::default(), 0, &mut |_| {})?;
    let (mut seen, mut largest) = (Seen::default(), 0);
    for index in 0..frames {
        let start = Instant::now();
        let frame = scene.read_frame(index)?;
        let segments = scene.read_ground_truth(index)?.ok_or("the room has true ids")?;
        while largest < segments.pixels().iter().copied().max().unwrap_or(0) {
            largest = memory.new_segment()?;
        }
        let lost = LOST.contains(&index);
        seen.add(&segments);
        if !lost {
            memory.update(memory.recall(&frame), &segments, &BTreeSet::new())?;
        }
        if index % MEASURE_INTERVAL == 0 {
            seen.measure(&memory);
        }
        let pose = (!lost).then(|| frame.world_from_camera());
        server.publish_frame(pose, || view_frame(index, &frame, &segments, lost));
        server.publish_objects(seen.objects.values().cloned().collect(), index + 1);
        server.publish_map(&memory.map(), None);
        let time = index as u64 * 33_333_333;
        if server.wants_message(channel) {
            server.publish_message(channel, pose_message(&frame, time)?, time);
        }
        thread::sleep(Duration::from_secs_f64(1.0 / rate as f64).saturating_sub(start.elapsed()));
    }
    println!("{:?}", server.counts());
    Ok(())
}
