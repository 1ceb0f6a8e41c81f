//! The affinity segmenter on frames whose border is cropped: the masks of what remains do not change.

use splatseg_dataset::{DatasetSettings, FrameStream, GroundTruth, Scene, open_scene};
use splatseg_geometry::{CameraFrame, Candidate, Image, Ratio, best_assignment};
use splatseg_segmenter::{AffinityNetwork, AffinitySegmenter, AffinitySettings, AffinityWeights, Segmenter};
use splatseg_test_scenes::{room, shared};
use std::collections::BTreeMap;

/// Most pixels cropped. The interior without them is common to all crops.
const MOST: usize = 8;
/// Segments with fewer pixels in the common interior are left out: the segmenter drops them by their area.
const MIN_AREA: u64 = 100;

/// A frame without `border` pixels on each side.
fn cropped(frame: &CameraFrame<'_>, border: usize) -> CameraFrame<'static> {
    let (color, depth) = (frame.color().crop_border(border), frame.depth().crop_border(border));
    CameraFrame::new(frame.name(), color, depth, frame.intrinsics().cropped(border)).unwrap()
}

/// The segment of each pixel of the common interior, from 1; 0 without one. `border` has been cropped.
fn interior(segmenter: &mut AffinitySegmenter, frame: &CameraFrame<'_>, border: usize) -> Image<u64> {
    let frame = cropped(frame, border);
    let mut segments = Image::filled(frame.width(), frame.height(), 0);
    for (index, scored) in segmenter.segment(&frame).unwrap().masks.iter().enumerate() {
        scored.mask.pixel_indices().for_each(|pixel| segments.pixels_mut()[pixel] = index as u64 + 1);
    }
    segments.crop_border(MOST - border)
}

/// Areas of the segments of at least [`MIN_AREA`] pixels.
fn areas(segments: &Image<u64>) -> BTreeMap<u64, u64> {
    let mut areas = BTreeMap::new();
    segments.pixels().iter().for_each(|segment| *areas.entry(*segment).or_default() += 1);
    areas.retain(|segment, area| *segment > 0 && *area >= MIN_AREA);
    areas
}

/// The IoUs of matched segments.
fn matched(one: &Image<u64>, other: &Image<u64>) -> Vec<f64> {
    let mut shared = BTreeMap::new();
    for pair in one.pixels().iter().copied().zip(other.pixels().iter().copied()) {
        *shared.entry(pair).or_default() += 1;
    }
    let (ones, others) = (areas(one), areas(other));
    let ratios = shared
        .into_iter()
        .filter_map(|(pair, both)| Some((pair, Ratio::iou(both, *ones.get(&pair.0)?, *others.get(&pair.1)?))));
    let ratios: Vec<((u64, u64), Ratio)> = ratios.collect();
    let candidates: Vec<Candidate> =
        ratios.iter().map(|((one, other), ratio)| Candidate::new(*one, *other, *ratio, None)).collect();
    best_assignment(&candidates).into_iter().map(|index| ratios[index].1.to_f64()).collect()
}

/// For each crop of one to eight pixels, the IoUs of the masks matched with those of the whole frames.
fn ious_by_crop(frames: &[CameraFrame<'_>]) -> Vec<Vec<f64>> {
    let network = AffinityNetwork::load(&AffinityWeights::BuiltIn).unwrap();
    let mut segmenter = AffinitySegmenter::new(network, AffinitySettings::default()).unwrap();
    let mut ious: Vec<Vec<f64>> = vec![Vec::new(); MOST];
    for frame in frames {
        let whole = interior(&mut segmenter, frame, 0);
        for (index, ious) in ious.iter_mut().enumerate() {
            ious.extend(matched(&whole, &interior(&mut segmenter, frame, index + 1)));
        }
    }
    assert!(ious.iter().all(|ious| ious.len() > 3 * frames.len()), "hardly any segments");
    ious
}

/// Checks that the mean for every crop is at least `least`. Returns the means.
fn check(ious: &[Vec<f64>], least: f64, what: &str) -> Vec<f64> {
    let means: Vec<f64> = ious.iter().map(|ious| ious.iter().sum::<f64>() / ious.len() as f64).collect();
    let text = format!("{what}: mean IoU after cropping 1 to {MOST} pixels: {means:.3?}, expected {least} or more");
    assert!(means.iter().all(|mean| *mean >= least), "{text}");
    means
}

#[test]
fn masks_of_a_synthetic_frame_stay_when_it_is_cropped() {
    let frames = [0, 1, 2].map(|seed| {
        let scene = room(&format!("synthetic:frames=40,seed={seed},width=320,height=240,noise=kinect"));
        scene.read_frame(13 * seed).unwrap().into_camera_frame()
    });
    check(&ious_by_crop(&frames), 0.95, "synthetic");
}

#[test]
fn masks_of_other_frames_stay_when_they_are_cropped() {
    let test = "masks_of_other_frames_stay_when_they_are_cropped";
    let mut all: Vec<Vec<f64>> = vec![Vec::new(); MOST];
    // Where depth has holes up to the border, a crop takes away what they are filled from.
    let scenes =
        [("rooms/dev-a", 20, 0.95), ("mosd-learn", 12, 0.9), ("kitchen-dev", 12, 0.85), ("hololens-dev", 25, 0.85)];
    for (name, stride, least) in scenes {
        let Some(scene) = shared(&format!("data/{name}"), test) else { return };
        let settings = DatasetSettings::default().with(|settings| {
            settings.stride = stride;
            settings.resize = (name != "hololens-dev").then(|| "320x240".parse().unwrap());
        });
        let stream = FrameStream::open(open_scene(&scene, &settings).unwrap(), &settings, GroundTruth::Skip).unwrap();
        let frames: Vec<CameraFrame> = stream.map(|item| item.unwrap().frame).collect();
        let means = check(&ious_by_crop(&frames), least, name);
        all.iter_mut().zip(means).for_each(|(all, mean)| all.push(mean));
    }
    check(&all, 0.9, "mean of all scenes");
}
