//! SAM 2.1 as a tracker, with the miniature network.

use splatseg_geometry::{Image, Intrinsics, Mask, Pose, RgbdFrame};
use splatseg_models::checkpoint::Checkpoint;
use splatseg_models::device::DeviceName;
use splatseg_models::sam2::{Click, Prompt, Sam2Error, Sam2Network};
use splatseg_tracking::{Sam2Tracker, Sam2TrackerSettings, Tracker, TrackerError};
use std::path::PathBuf;
use std::sync::Arc;

/// The miniature network, or `None`, with a line that says so, without `../shared`.
fn network(test: &str) -> Option<Arc<Sam2Network>> {
    let file = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/golden/sam2/sam2_mini.pt");
    if !file.exists() {
        // Not `println!`, whose output the test runner hides when a test passes.
        let line = format!("\nskipped: {test}: ../shared is not here\n");
        let _ = std::io::Write::write_all(&mut std::io::stderr(), line.as_bytes());
        return None;
    }
    let weights = Checkpoint::open(&file).unwrap();
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
