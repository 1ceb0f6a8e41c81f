//! Large frames are processed at a lower resolution, and their results enlarged.

use splatseg::dataset::{Framing, ImageSize, Scene};
use splatseg::geometry::{CameraFrame, RgbdFrame, ScoredMask, Segmentation};
use splatseg::segmenter::{Segmenter, SegmenterError};
use splatseg::tracking::{FrameOutput, Hindsight, Method, ShownFrame, TrackingError};
use splatseg::{Pipeline, SegmentMap, Settings};
use splatseg_test_scenes::room;
use std::sync::{Arc, Mutex};

const FRAMES: usize = 3;
const SIZE: (usize, usize) = (250, 190);
const REDUCED: (usize, usize) = (125, 95);

fn frames() -> Vec<RgbdFrame<'static>> {
    let scene = room(&format!("synthetic:frames={FRAMES},width={},height={}", SIZE.0, SIZE.1));
    (0..FRAMES).map(|index| scene.read_frame(index).unwrap()).collect()
}

fn settings() -> Settings {
    let mut settings = Settings::default();
    settings.run.working_pixels = REDUCED.0 * REDUCED.1;
    settings
}

/// Sizes of the images that a part has seen.
type Sizes = Arc<Mutex<Vec<(usize, usize)>>>;

/// Finds nothing.
struct Blank {
    seen: Sizes,
    needs_all_pixels: bool,
}

impl Segmenter for Blank {
    fn name(&self) -> &str {
        "blank"
    }

    fn needs_all_pixels(&self) -> bool {
        self.needs_all_pixels
    }

    fn segment(&mut self, frame: &CameraFrame) -> Result<Segmentation, SegmenterError> {
        self.seen.lock().unwrap().push((frame.width(), frame.height()));
        Ok(Segmentation::default())
    }
}

impl Method for Blank {
    fn name(&self) -> &str {
        "blank"
    }

    fn process(&mut self, frame: &RgbdFrame, _: &Segmentation) -> Result<FrameOutput, TrackingError> {
        self.seen.lock().unwrap().push((frame.width(), frame.height()));
        Ok(FrameOutput::from_segments(SegmentMap::filled(frame.width(), frame.height(), 1)))
    }
}

#[test]
fn ids_of_a_large_frame_are_those_of_the_reduced_one_but_at_borders() {
    let size = ImageSize { width: REDUCED.0, height: REDUCED.1 };
    let framing = Framing { resize: Some(size), ..Framing::default() };
    let mut large = Pipeline::builder(&settings()).build().unwrap();
    let mut small = Pipeline::builder(&Settings::default()).build().unwrap();
    for frame in frames() {
        let reduced = framing.apply(frame.as_borrowed()).unwrap().at(*frame.world_from_camera());
        let [large, small] = [large.step(&frame), small.step(&reduced)].map(|result| result.unwrap().output);
        assert_eq!(large.segments.size(), SIZE);
        assert_eq!(large.confidence.size(), SIZE);
        let doubled = small.segments.doubled(SIZE);
        let pixels = large.segments.pixels().iter().zip(doubled.pixels());
        let equal = pixels.filter(|(large, doubled)| large == doubled).count();
        assert!(equal * 100 > 90 * SIZE.0 * SIZE.1, "{equal} pixels are equal");
    }
    let gaussians = |pipeline: &Pipeline| pipeline.map().unwrap().gaussian_count();
    let (large, small) = (gaussians(&large), gaussians(&small));
    assert!(small / 2 < large && large < 2 * small, "{large} Gaussians, {small} of reduced frames");
}

#[test]
fn a_segmenter_of_your_own_sees_whole_frames_unless_it_says_otherwise() {
    for (needs_all_pixels, expected) in [(true, SIZE), (false, REDUCED)] {
        let seen = Sizes::default();
        let segmenter = Box::new(Blank { seen: Arc::clone(&seen), needs_all_pixels });
        let mut pipeline = Pipeline::builder(&settings()).segmenter(segmenter).build().unwrap();
        let result = pipeline.step(&frames()[0]).unwrap();
        assert_eq!(*seen.lock().unwrap(), [expected]);
        assert_eq!(result.output.segments.size(), SIZE);
    }
}

/// Finds a mask of a fixed size, and regions if it has them.
struct OfSize(SegmentMap, Option<SegmentMap>);

impl Segmenter for OfSize {
    fn name(&self) -> &str {
        "of-size"
    }

    fn segment(&mut self, _: &CameraFrame) -> Result<Segmentation, SegmenterError> {
        let masks = vec![ScoredMask { mask: self.0.mask_of(1), score: 1.0 }];
        Ok(Segmentation { regions: self.1.clone(), ..masks.into() })
    }
}

#[test]
fn masks_of_whole_frames_are_reduced_and_those_of_another_size_are_errors() {
    let left = |size: (usize, usize)| SegmentMap::from_fn(size.0, size.1, |column, _| u32::from(2 * column < size.0));
    let step = |masks: SegmentMap, regions: Option<SegmentMap>| {
        let segmenter = Box::new(OfSize(masks, regions));
        Pipeline::builder(&settings()).segmenter(segmenter).build().unwrap().step(&frames()[0])
    };
    let segments = step(left(SIZE), None).unwrap().output.segments;
    assert_eq!([segments[(20, 90)], segments[(230, 90)]], [1, 0]);
    for (masks, regions) in [(left((9, 9)), None), (left(REDUCED), None), (left(SIZE), Some(left((9, 9))))] {
        let error = step(masks, regions).unwrap_err();
        let text = format!("{error:?}");
        assert!(text.contains("MaskSize") && text.contains("expected: (250, 190)"), "{text}");
    }
}

#[test]
fn a_method_of_your_own_sees_whole_frames() {
    let seen = Sizes::default();
    let part = || Box::new(Blank { seen: Arc::clone(&seen), needs_all_pixels: false });
    let mut pipeline = Pipeline::builder(&settings()).segmenter(part()).method(part()).build().unwrap();
    pipeline.step(&frames()[0]).unwrap();
    assert_eq!(*seen.lock().unwrap(), [SIZE, SIZE]);
}

#[test]
fn frames_are_decided_again_at_the_resolution_at_which_they_were_processed() {
    let mut pipeline = Pipeline::builder(&settings()).build().unwrap();
    let frames = frames();
    let results: Vec<_> = frames.iter().map(|frame| pipeline.step(frame).unwrap()).collect();
    pipeline.settle();
    let hindsight = pipeline.hindsight().unwrap();
    for (frame, result) in frames.iter().zip(results) {
        assert_eq!(result.regions.as_ref().map(SegmentMap::size), Some(REDUCED));
        let shown = ShownFrame { segments: result.output.segments, regions: result.regions };
        assert_eq!(hindsight.look_again(frame, &shown).unwrap().segments.size(), SIZE);
        let wrong = ShownFrame { segments: SegmentMap::filled(9, 9, 0), regions: None };
        let error = hindsight.look_again(frame, &wrong).unwrap_err().to_string();
        assert!(error.contains("9x9") && error.contains("250x190"), "{error}");
    }
}
