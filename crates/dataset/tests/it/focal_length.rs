//! The focal lengths of recorded cameras are estimated from their images.

use splatseg_dataset::{DatasetSettings, Format, open_scene};
use splatseg_geometry::{CowImage, Image};
use splatseg_imaging::estimated_focal_length;
use splatseg_test_scenes::shared;

/// The middle of an image: `share` of each side.
fn middle(image: &CowImage<'_, [u8; 3]>, share: f64) -> Image<[u8; 3]> {
    let [width, height] = [image.width(), image.height()].map(|side| (side as f64 * share) as usize);
    let (left, top) = ((image.width() - width) / 2, (image.height() - height) / 2);
    Image::from_fn(width, height, |column, row| image[(left + column, top + row)])
}

/// Estimates the cameras of recordings, of which `share` of each side of the images is seen, and compares them with the
/// truth. Returns the number of estimates, or `None` without recordings.
fn compare_recorded(share: f64, test: &str) -> Option<usize> {
    let mut estimates = 0;
    for (scene, long_sides) in [
        ("data/tum-rpy-dev", 258.65 / 320.0),
        ("data/kitchen-dev", 525.8 / 640.0),
        ("data/hololens-dev", 293.67 / 320.0),
        ("data/rooms/dev-a", 288.935 / 320.0),
        ("data/rooms/dev-b", 288.935 / 320.0),
    ] {
        let folder = shared(scene, test)?;
        let settings =
            DatasetSettings::default().with(|settings| (settings.format, settings.fx) = (Format::Images, Some(300.0)));
        let frames = open_scene(folder.join("color"), &settings).unwrap();
        let image = |index: usize| Some(middle(frames.read_recorded(index).ok()?.frame.color(), share));
        let found = estimated_focal_length(frames.frame_count(), &image);
        let truth = long_sides / share;
        println!("{scene}, {share} of the image: {truth:.3} long sides, estimated {found:?}");
        if let Some(found) = found {
            let error = (found.long_sides / truth).ln();
            assert!(error.abs() < 2.0 * found.deviation, "{scene}, {share}: {found:?}");
            estimates += 1;
        }
    }
    Some(estimates)
}

#[test]
fn recorded_cameras_are_estimated() {
    if let Some(estimates) = compare_recorded(1.0, "recorded_cameras_are_estimated") {
        assert_eq!(estimates, 5);
    }
}

/// The middle of the images stands for a longer lens. Images of 224×168, of cameras that move far from frame to frame, need
/// not tell it.
#[test]
fn recorded_cameras_with_longer_lenses_are_estimated_or_not_known() {
    compare_recorded(0.7, "recorded_cameras_with_longer_lenses_are_estimated_or_not_known");
}
