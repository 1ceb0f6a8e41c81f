//! A run as a recording for robotics viewers such as Foxglove and Rerun: an MCAP file (<https://mcap.dev/spec>).
//!
//! | topic | type | contents |
//! | --- | --- | --- |
//! | `/splatseg/overlay` | `sensor_msgs/msg/CompressedImage` | the overlay of each frame, JPEG |
//! | `/splatseg/segments` | `sensor_msgs/msg/Image`, `16UC1`, or `32SC1` for a frame with an id above 65535 | the id image of each frame |
//! | `/splatseg/camera_info` | `sensor_msgs/msg/CameraInfo` | the camera of each frame |
//! | `/tf` | `tf2_msgs/msg/TFMessage` | `camera`, an optical frame, in `world` |
//! | `/splatseg/points` | `sensor_msgs/msg/PointCloud2` | centres of the Gaussians at the end of the run |
//! | `/splatseg/boxes` | `foxglove.SceneUpdate`, JSON | boxes and ids of the objects, for Foxglove |
//! | `/splatseg/markers` | `visualization_msgs/msg/MarkerArray` | the same, for ROS |
//! | `/splatseg/map` | `nav_msgs/msg/OccupancyGrid` | free space at the end of the run, for Nav2 |
//!
//! The last four need a memory, and the grid also keyframes that show a floor. They come at the end of the file but have
//! earlier times: points and grid have the time of the first frame, and each box has the time of the first frame that shows
//! its object. If z does not point up in the world, the grid is in a frame that is turned for it, and `/tf_static` has that.
//!
//! Ids and poses are final in all messages, also in those of frames before the run found out that two ids are the same
//! object, or that earlier poses were wrong.

mod chunk;
mod compression;
mod recording;
mod records;
mod scene_recording;
mod scene_update;
mod stream_recording;
mod writer;

use crate::error::saved_state;
use crate::ros_messages::{self, CameraPose, IdPixels, PointBytes, ShownObject};
use crate::run_output::written_ids;
use crate::{FrameRecord, OutputError, ResultFolder, RunEnd, RunOutput};
pub use compression::Compression;
use glam::DVec3;
use recording::{Profile, Recording};
pub use scene_recording::{SceneCounts, SceneRecording};
use serde::{Deserialize, Serialize};
use splatseg_geometry::{Intrinsics, RemappedId, SegmentId};
use splatseg_objects::RemapLog;
use splatseg_odometry::PoseState;
use splatseg_places::FloorPlan;
use splatseg_ros::Time;
use std::collections::BTreeMap;
use std::io;
use std::path::PathBuf;
pub use stream_recording::{StreamRecording, StreamRecordingError};

/// Interval between frames without timestamps, nanoseconds: 30 frames per second. It is also the time of the first, as 0
/// means "no time" in ROS.
const FRAME_INTERVAL: i64 = 33_333_333;
/// Up to this number of objects, each message with boxes repeats all earlier boxes, because a viewer that jumps to a
/// time reads only the latest message. Beyond it, this would make the file grow with the square of the number of
/// objects.
const MAX_REPEATED: usize = 300;

/// The recording. It is written at the end, from the images in the folder, so that only a few hundred bytes are stored
/// per frame.
///
/// Times are the timestamps of the frames. A frame without a timestamp comes 1/30 s after the previous frame, or
/// 1/30 s after time 0 if it is the first. The same run gives the same bytes.
#[derive(Debug)]
pub struct McapFile {
    path: PathBuf,
    seen: Seen,
}

/// Data stored about the frames.
#[derive(Debug, Default, Serialize, Deserialize)]
struct Seen {
    frames: Vec<SeenFrame>,
    /// Time at which each object was first seen, nanoseconds.
    objects: BTreeMap<SegmentId, i64>,
}

#[derive(Debug, Serialize, Deserialize)]
struct SeenFrame {
    /// Name of the frame's result files, without folder and extension.
    file_name: String,
    /// Nanoseconds.
    time: i64,
    /// `None` if tracking of the camera was lost.
    pose: Option<CameraPose>,
    camera: Intrinsics,
}

impl McapFile {
    /// The first bytes of the MCAP files written here: each has one of these.
    pub const STARTS: &'static [&'static [u8]] = recording::STARTS;

    /// A file to be written to `path` at the end of the run, replacing any existing file. Its folder must exist.
    pub fn new(path: PathBuf) -> Self {
        Self { path, seen: Seen::default() }
    }

    fn write(&self, end: &RunEnd<'_>, folder: &dyn ResultFolder) -> Result<(), OutputError> {
        let mut recording =
            Recording::create(&self.path, Profile::Mixed, Compression::Lz4).map_err(|source| self.error(source))?;
        for (position, frame) in self.seen.frames.iter().enumerate() {
            let overlay = folder.path_of(&format!("overlay/{}.jpg", frame.file_name));
            let overlay = std::fs::read(&overlay).map_err(|source| OutputError::Read { path: overlay, source })?;
            let segments = written_ids(folder, &frame.file_name)?;
            let ids = IdPixels::new(&segments);
            let correction = end.pose_corrections.get(position).and_then(Option::as_ref);
            let pose = frame.pose.map(|pose| pose.corrected(correction));
            write_frame(&mut recording, (frame, pose), &overlay, (segments.size(), &ids))
                .map_err(|source| self.error(source))?;
        }
        self.write_map(&mut recording, end).and_then(|()| recording.finish()).map_err(|source| self.error(source))
    }

    /// Writes the points and boxes of the final map, if there is one.
    fn write_map(&self, recording: &mut Recording, end: &RunEnd<'_>) -> io::Result<()> {
        let (Some(map), Some(SeenFrame { time: first, .. })) = (end.map, self.seen.frames.first()) else {
            return Ok(());
        };
        let points = PointBytes::of(&map);
        if map.origin != DVec3::ZERO {
            let stamp = Time::from_nanoseconds(*first);
            recording.write("/tf_static", *first, &ros_messages::map_origin(stamp, map.origin))?;
        }
        recording.write("/splatseg/points", *first, &points.message(Time::from_nanoseconds(*first))?)?;
        if let Some(plan) = end.plan {
            write_plan(recording, *first, plan)?;
        }
        let times = self.seen.first_times(end.remaps);
        let first_seen = |id: &SegmentId| times.get(id).copied().unwrap_or(*first);
        let objects = &end.objects.objects;
        let mut shown: Vec<ShownObject> =
            objects.iter().filter_map(|object| ShownObject::new(first_seen(&object.id), object)).collect();
        shown.sort_by_key(|object| (object.first_seen, object.id));
        write_boxes(recording, &shown)
    }

    fn error(&self, source: io::Error) -> OutputError {
        OutputError::Io { path: self.path.clone(), source }
    }
}

impl Seen {
    /// The time of a frame, nanoseconds.
    fn time_of(&self, record: &FrameRecord) -> i64 {
        let nanoseconds = match (record.frame.timestamp(), self.frames.last()) {
            (Some(time), _) => i64::try_from(time.as_nanos()).unwrap_or(i64::MAX),
            (None, Some(latest)) => latest.time.saturating_add(FRAME_INTERVAL),
            (None, None) => FRAME_INTERVAL,
        };
        // ROS counts seconds with 32 bits.
        Time::from_nanoseconds(nanoseconds).nanoseconds()
    }

    /// Time at which each object was first seen under any of its ids, nanoseconds.
    fn first_times(&self, remaps: &RemapLog) -> BTreeMap<SegmentId, i64> {
        let mut times = self.objects.clone();
        for (_, RemappedId { from, into }) in remaps.entries() {
            if let Some(time) = times.remove(from) {
                let first = times.entry(*into).or_insert(time);
                *first = time.min(*first);
            }
        }
        times
    }

    /// Records the next frame.
    fn add(&mut self, record: &FrameRecord) {
        let time = self.time_of(record);
        self.frames.push(SeenFrame {
            file_name: record.file_name.clone(),
            time,
            pose: (record.pose_state != PoseState::Lost).then(|| CameraPose::new(record.frame.world_from_camera())),
            camera: *record.frame.intrinsics(),
        });
        for object in &record.objects {
            if object.is_new() {
                self.objects.insert(object.id, time);
            }
        }
    }
}

/// Writes the messages of a frame, with its final pose, its overlay and the size and bytes of its id image.
fn write_frame(
    recording: &mut Recording,
    (frame, pose): (&SeenFrame, Option<CameraPose>),
    overlay: &[u8],
    (size, ids): ((usize, usize), &IdPixels),
) -> io::Result<()> {
    let (time, stamp) = (frame.time, Time::from_nanoseconds(frame.time));
    if let Some(pose) = pose {
        recording.write("/tf", time, &ros_messages::camera_pose(stamp, pose))?;
    }
    recording.write("/splatseg/camera_info", time, &ros_messages::camera_info(stamp, &frame.camera)?)?;
    recording.write("/splatseg/overlay", time, &ros_messages::overlay(stamp, overlay))?;
    recording.write("/splatseg/segments", time, &ros_messages::id_image(stamp, size, ids)?)
}

/// Writes the boxes of objects, which are sorted by time: one message per time, with the objects first seen then and,
/// up to [`MAX_REPEATED`], all earlier ones.
fn write_boxes(recording: &mut Recording, shown: &[ShownObject]) -> io::Result<()> {
    let mut before = 0;
    for new in shown.chunk_by(|left, right| left.first_seen == right.first_seen) {
        let (Some(object), until) = (new.first(), before + new.len()) else { continue };
        let objects = if until <= MAX_REPEATED { shown.get(..until).unwrap_or(new) } else { new };
        recording.write_scene_update("/splatseg/boxes", object.first_seen, &scene_update::scene_update(objects))?;
        recording.write("/splatseg/markers", object.first_seen, &ros_messages::markers(objects))?;
        before = until;
    }
    Ok(())
}

/// Writes the grid of a plan, and its frame if that is not the world's.
fn write_plan(recording: &mut Recording, time: i64, plan: &FloorPlan) -> io::Result<()> {
    let stamp = Time::from_nanoseconds(time);
    if let Some(transform) = ros_messages::plan_transform(stamp, plan, ros_messages::WORLD) {
        recording.write("/tf_static", time, &transform)?;
    }
    recording.write("/splatseg/map", time, &ros_messages::occupancy_grid(stamp, plan, ros_messages::WORLD)?)
}

impl RunOutput for McapFile {
    fn name(&self) -> &'static str {
        "mcap"
    }

    fn add_frame(&mut self, record: &FrameRecord, _: &mut dyn ResultFolder) -> Result<(), OutputError> {
        // ROS counts seconds with 32 bits.
        if let Some(time) = record.frame.timestamp().filter(|time| time.as_secs() > i32::MAX as u64) {
            let name = record.frame.name();
            let wrong = format!("frame {name}: its time of {time:?} is after 2038, where times in ROS 2 end");
            return Err(self.error(io::Error::new(io::ErrorKind::InvalidInput, wrong)));
        }
        self.seen.add(record);
        Ok(())
    }

    fn frame_state(&self, record: &FrameRecord) -> Result<Vec<u8>, OutputError> {
        let new: Vec<SegmentId> =
            record.objects.iter().filter(|object| object.is_new()).map(|object| object.id).collect();
        saved_state("MCAP file", &(self.seen.frames.last(), new))
    }

    fn save(&mut self, _: &mut dyn ResultFolder) -> Result<Vec<u8>, OutputError> {
        saved_state("MCAP file", &())
    }

    fn restore(&mut self, frames: &[String], saved: &[u8]) -> serde_json::Result<()> {
        let () = serde_json::from_slice(saved)?;
        let frames: Vec<(SeenFrame, Vec<SegmentId>)> =
            frames.iter().map(|frame| serde_json::from_str(frame)).collect::<Result<_, _>>()?;
        for (frame, new) in frames {
            self.seen.objects.extend(new.into_iter().map(|id| (id, frame.time)));
            self.seen.frames.push(frame);
        }
        Ok(())
    }

    fn finish(&mut self, end: &RunEnd<'_>, folder: &mut dyn ResultFolder) -> Result<(), OutputError> {
        self.write(end, folder)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Quat, Vec3};
    use splatseg_geometry::{FrameAnchor, Image, Intrinsics, Pose, RgbdFrame};
    use splatseg_objects::OrientedBox;
    use splatseg_ros::{MarkerArray, from_cdr};
    use std::time::Duration;

    #[test]
    fn boxes_are_repeated_while_there_are_few() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("boxes.mcap");
        let shown = |index: usize| ShownObject {
            id: index as SegmentId + 1,
            // Two at a time.
            first_seen: index as i64 / 2,
            frames: 1,
            label: None,
            label_score: None,
            label_alternatives: Vec::new(),
            oriented_box: OrientedBox { center: DVec3::ZERO, size: Vec3::ONE, rotation: Quat::IDENTITY },
        };
        let shown: Vec<ShownObject> = (0..MAX_REPEATED + 3).map(shown).collect();
        let mut recording = Recording::create(&path, Profile::Mixed, Compression::None).unwrap();
        write_boxes(&mut recording, &shown).unwrap();
        recording.finish().unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let messages = mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap);
        let counts: Vec<usize> = messages
            .filter(|message| message.channel.topic == "/splatseg/markers")
            .map(|message| from_cdr::<MarkerArray<'_>>(&message.data).unwrap().markers.len() / 2)
            .collect();
        let expected: Vec<usize> = (2..=MAX_REPEATED).step_by(2).chain([2, 1]).collect();
        assert_eq!(counts, expected);
    }

    #[test]
    fn frames_without_a_time_follow_the_frame_before() {
        let mut seen = Seen::default();
        let mut time = |timestamp: Option<Duration>| {
            let camera = Intrinsics { fx: 1.0, fy: 1.0, cx: 0.0, cy: 0.0, width: 1, height: 1 };
            let images = (Image::filled(1, 1, [0; 3]), Image::filled(1, 1, 1.0));
            let frame = RgbdFrame::new("0", images.0, images.1, camera, Pose::IDENTITY).unwrap();
            let (frame, segments) = (frame.with_timestamp(timestamp), Image::filled(1, 1, 0));
            let record = FrameRecord {
                number: 0,
                index: 0,
                pose_state: PoseState::Given,
                file_name: "0".to_owned(),
                frame,
                segments,
                regions: None,
                objects: Vec::new(),
                anchor: FrameAnchor::default(),
                remapped: Vec::new(),
            };
            seen.add(&record);
            seen.frames.last().unwrap().time
        };
        let found =
            [None, None, Some(Duration::from_secs(1_700_000_000)), None, Some(Duration::MAX), None].map(&mut time);
        let (late, end) = (1_700_000_000_000_000_000, i64::from(i32::MAX));
        assert_eq!(found[..4], [FRAME_INTERVAL, 2 * FRAME_INTERVAL, late, late + FRAME_INTERVAL]);
        assert!(found[4..].iter().all(|time| time / 1_000_000_000 == end), "{found:?}");
    }
}
