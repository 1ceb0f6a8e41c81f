//! SAM 2.1 as a tracker, with the miniature network.

use splatseg_geometry::{Click, Image, Intrinsics, Mask, Pose, Prompt, RgbdFrame, SegmentId};
use splatseg_models::checkpoint::Checkpoint;
use splatseg_models::device::DeviceName;
use splatseg_models::sam2::{Sam2Error, Sam2Network, Weights};
use splatseg_test_scenes::shared;
use splatseg_tracking::{Sam2Tracker, Sam2TrackerSettings, Tracker, TrackerError};
use std::path::PathBuf;
use std::sync::Arc;

/// Returns the path of the miniature network's weights. Without `../shared`, prints a message and returns `None`.
fn weights(test: &str) -> Option<PathBuf> {
    shared("golden/sam2/sam2_mini.pt", test)
}

fn network(test: &str) -> Option<Arc<Sam2Network>> {
    let weights = Checkpoint::open(&weights(test)?).unwrap();
    Some(Arc::new(Sam2Network::load(&weights, Some(128), &DeviceName::Cpu.open().unwrap()).unwrap()))
}

fn frame(index: usize, (width, height): (usize, usize)) -> RgbdFrame<'static> {
    let camera = Intrinsics { fx: 50.0, fy: 50.0, cx: 1.0, cy: 1.0, width, height };
    let bright = |column: usize| if (20 + index..50 + index).contains(&column) { [200, 40, 40] } else { [30, 60, 90] };
    let color = Image::from_fn(width, height, |column, _| bright(column));
    RgbdFrame::new(index.to_string(), color, Image::filled(width, height, 1.0), camera, Pose::IDENTITY).unwrap()
}

const SIZE: (usize, usize) = (96, 64);

fn square(from: usize, to: usize) -> Mask {
    Mask::from_fn(SIZE.0, SIZE.1, |column, row| (from..to).contains(&column) && (10..50).contains(&row))
}

#[test]
fn tracks_are_prompted_followed_corrected_and_removed() {
    let Some(network) = network("tracks_are_prompted_followed_corrected_and_removed") else { return };
    let mut tracker = Sam2Tracker::new(network, Sam2TrackerSettings::default()).unwrap();
    assert_eq!(tracker.name(), "sam2");
    assert!(tracker.track(&frame(0, SIZE)).unwrap().is_empty());
    let thin = Mask::empty(SIZE.0, SIZE.1);
    let prompts = [(9, Prompt::Mask(square(20, 50))), (5, Prompt::Mask(thin)), (3, Prompt::Mask(square(60, 90)))];
    let prompted = tracker.prompt(&prompts).unwrap();
    assert_eq!(prompted.iter().map(|(id, _)| *id).collect::<Vec<_>>(), [9, 5, 3]);
    assert!(prompted[0].1.iou(&square(20, 50)) > 0.8 && prompted[1].1.is_empty());
    let tracked = tracker.track(&frame(1, SIZE)).unwrap();
    assert_eq!(tracked.iter().map(|(id, _)| *id).collect::<Vec<_>>(), [3, 9], "an empty prompt makes no track");
    assert!(tracked.iter().all(|(_, mask)| (mask.width(), mask.height()) == SIZE));
    let clicks = vec![Click { x: 30.0, y: 30.0, positive: true }, Click { x: 70.0, y: 30.0, positive: false }];
    let correction = Prompt::Points { bounding_box: None, clicks };
    assert_eq!(tracker.prompt(&[(9, correction.clone()), (12, correction)]).unwrap().len(), 2);
    tracker.remove(3);
    tracker.remove(3);
    assert_eq!(tracker.track(&frame(2, SIZE)).unwrap().iter().map(|(id, _)| *id).collect::<Vec<_>>(), [9, 12]);
}

/// A network that reports every tracked object as absent.
struct Blind(Checkpoint);

impl Weights for Blind {
    fn names(&self) -> Vec<String> {
        self.0.names()
    }

    fn shape(&self, name: &str) -> Option<Vec<usize>> {
        self.0.shape(name)
    }

    fn read(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, Sam2Error> {
        let mut values = self.0.read(name, shape)?;
        if name == "sam_mask_decoder.pred_obj_score_head.layers.2.bias" {
            values[0] -= 50.0;
        }
        Ok(values)
    }
}

#[test]
fn resting_tracks_have_empty_masks_until_they_are_prompted() {
    let Some(file) = weights("resting_tracks_have_empty_masks_until_they_are_prompted") else { return };
    let blind = Blind(Checkpoint::open(&file).unwrap());
    let network = Sam2Network::load(&blind, Some(64), &DeviceName::Cpu.open().unwrap()).unwrap();
    let settings = Sam2TrackerSettings::default().with(|settings| settings.max_absent_frames = Some(2));
    let mut tracker = Sam2Tracker::new(network, settings).unwrap();
    tracker.track(&frame(0, SIZE)).unwrap();
    tracker.prompt(&[(9, Prompt::Mask(square(20, 50))), (4, Prompt::Mask(square(60, 90)))]).unwrap();
    let nothing = || Mask::empty(SIZE.0, SIZE.1);
    for index in 1..6 {
        assert_eq!(tracker.track(&frame(index, SIZE)).unwrap(), [(4, nothing()), (9, nothing())]);
    }
    let prompted = tracker.prompt(&[(9, Prompt::Mask(square(20, 50)))]).unwrap();
    assert!(prompted[0].1.iou(&square(20, 50)) > 0.8);
    assert_eq!(tracker.track(&frame(6, SIZE)).unwrap(), [(4, nothing()), (9, nothing())]);
}

#[test]
fn too_many_resting_objects_are_forgotten_longest_resting_first() {
    let Some(file) = weights("too_many_resting_objects_are_forgotten_longest_resting_first") else { return };
    let blind = Blind(Checkpoint::open(&file).unwrap());
    let network = Sam2Network::load(&blind, Some(64), &DeviceName::Cpu.open().unwrap()).unwrap();
    let settings = Sam2TrackerSettings::default()
        .with(|settings| (settings.max_absent_frames, settings.max_resting_objects) = (Some(1), 3));
    let mut tracker = Sam2Tracker::new(network, settings).unwrap();
    let ids = |tracked: Vec<(SegmentId, Mask)>| tracked.into_iter().map(|(id, _)| id).collect::<Vec<_>>();
    for index in 0..6 {
        tracker.track(&frame(index, SIZE)).unwrap();
        tracker.prompt(&[(10 - index as SegmentId, Prompt::Mask(square(20, 50)))]).unwrap();
    }
    assert_eq!(ids(tracker.track(&frame(6, SIZE)).unwrap()), [5, 6, 7], "the three prompted last");
    tracker.prompt(&[(10, Prompt::Mask(square(20, 50)))]).unwrap();
    assert_eq!(ids(tracker.track(&frame(7, SIZE)).unwrap()), [5, 6, 10], "followed again, then resting");
}

#[test]
fn objects_rest_only_where_they_are_prompted_again() {
    let given = Sam2TrackerSettings::default().with(|settings| settings.max_absent_frames = Some(7));
    for prompts_lost_objects in [false, true] {
        assert_eq!(given.resolved(prompts_lost_objects), given);
    }
    let left_out = Sam2TrackerSettings::default();
    assert_eq!(left_out.resolved(false).max_absent_frames, Some(0));
    assert!(left_out.resolved(true).max_absent_frames > Some(0));
}

#[test]
fn errors_of_the_network_are_reported() {
    let Some(network) = network("errors_of_the_network_are_reported") else { return };
    let none = Sam2TrackerSettings::default().with(|settings| settings.objects_per_chunk = 0);
    let error = Sam2Tracker::new(Arc::clone(&network), none).unwrap_err();
    assert_eq!(error.to_string(), "the tracker sam2: objects_per_chunk is 0, but it must be at least 1");
    let mut tracker = Sam2Tracker::new(network, Sam2TrackerSettings::default()).unwrap();
    let prompt = [(1, Prompt::click(4.0, 4.0))];
    assert!(matches!(tracker.prompt(&prompt), Err(TrackerError::Sam2(Sam2Error::NoFrame))));
    tracker.track(&frame(0, SIZE)).unwrap();
    assert!(tracker.prompt(&[(1, Prompt::click(400.0, 4.0))]).is_err());
    assert!(matches!(tracker.track(&frame(1, (64, 64))), Err(TrackerError::Sam2(Sam2Error::FrameSize { .. }))));
    assert!(tracker.track(&frame(1, SIZE)).unwrap().is_empty());
}
