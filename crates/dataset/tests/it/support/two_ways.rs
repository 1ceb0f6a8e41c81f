//! A recording read from its file and as a stream of messages: the frames must be the same.

use super::warnings::with_warnings;
use mcap::records::{Record, op};
use splatseg_dataset::{
    DatasetError, DatasetSettings, FrameMatcher, MatchLimits, RecordingScene, Scene, read_messages,
};
use splatseg_geometry::{CameraFrame, Pose};
use std::fs;
use std::path::Path;
use std::time::Duration;

/// The content of a recording.
pub struct Found {
    pub frames: Vec<(CameraFrame<'static>, Option<Pose>)>,
    pub sources: Vec<String>,
    /// Without the path.
    pub warnings: Vec<String>,
}

/// Reads a recording of these bytes in both ways, and checks that frames and sources are the same. Warnings and errors are
/// those of the file; its path is `a.mcap` in them.
pub fn read(bytes: &[u8], settings: &DatasetSettings) -> Result<Found, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    fs::write(&path, bytes).unwrap();
    read_path(&path, settings)
}

/// Like [`read`], for a file or folder.
pub fn read_path(path: &Path, settings: &DatasetSettings) -> Result<Found, String> {
    let place = path.display().to_string();
    let without_path = |text: String| text.replace(&place, "a.mcap");
    let (scene, warnings) = with_warnings(|| RecordingScene::open(path, settings));
    let (streamed, sources, undecided) = streamed(path, settings);
    let scene = match scene {
        Ok(scene) => scene,
        Err(error) => {
            assert!(streamed.is_empty(), "a stream has {} frames, the recording: {error}", streamed.len());
            return Err(without_path(error.to_string()));
        }
    };
    assert_eq!(undecided.map(|error| error.to_string()), None);
    let read = |index| scene.read_recorded(index).unwrap();
    let frames: Vec<_> = (0..scene.frame_count()).map(read).map(|read| (read.frame, read.world_from_camera)).collect();
    assert_eq!(frames.len(), streamed.len());
    for (index, (recorded, streamed)) in frames.iter().zip(&streamed).enumerate() {
        assert_eq!(recorded.0, streamed.0, "frame {index}");
        assert_eq!(recorded.1, streamed.1, "pose of frame {index}");
    }
    assert_eq!(sources, scene.sources());
    let warnings = warnings.into_iter().map(without_path).collect();
    Ok(Found { frames, sources, warnings })
}

type Streamed = (Vec<(CameraFrame<'static>, Option<Pose>)>, Vec<String>, Option<DatasetError>);

fn streamed(path: &Path, settings: &DatasetSettings) -> Streamed {
    let limits = MatchLimits { complete: 1000, waiting: 1000, ..MatchLimits::default() };
    let mut matcher = FrameMatcher::new(settings, limits).unwrap();
    let _ = read_messages(path, &mut |message| {
        matcher.feed(message.topic, message.type_name, message.data, message.recorded);
        Ok(())
    });
    matcher.flush();
    let mut frames = Vec::new();
    while let Some(frame) = matcher.take(Duration::ZERO) {
        let frame = frame.read().unwrap();
        frames.push((frame.frame, frame.world_from_camera));
    }
    let undecided =
        matcher.undecided().map(|error| DatasetError::Other { scene: String::new(), source: error.to_string().into() });
    (frames, matcher.sources().to_vec(), undecided)
}

/// Returns the message whose data lie at some bytes of an uncompressed recording, to damage it.
pub fn places_of_messages(bytes: &[u8], topic: &str) -> Vec<std::ops::Range<usize>> {
    let (mut places, mut channel) = (Vec::new(), None);
    find(bytes, 8, bytes.len() - 8, topic, &mut channel, &mut places);
    places
}

fn find(
    bytes: &[u8],
    mut at: usize,
    end: usize,
    topic: &str,
    channel: &mut Option<u16>,
    places: &mut Vec<std::ops::Range<usize>>,
) {
    while at + 9 < end {
        let len = u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
        let body = at + 9..at + 9 + len;
        match mcap::parse_record(bytes[at], &bytes[body.clone()]) {
            Ok(Record::Channel(found)) if found.topic == topic => *channel = Some(found.id),
            Ok(Record::Message { header, data }) if Some(header.channel_id) == *channel => {
                places.push(body.end - data.len()..body.end);
            }
            Ok(Record::Chunk { data, .. }) => find(bytes, body.end - data.len(), body.end, topic, channel, places),
            _ if bytes[at] == op::DATA_END => return,
            _ => {}
        }
        at = body.end;
    }
}
