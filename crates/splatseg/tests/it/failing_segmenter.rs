//! A segmenter that fails in one frame, after which the frame is tried again.

use splatseg::dataset::Scene;
use splatseg::geometry::{CameraFrame, Mask, ScoredMask, Segmentation};
use splatseg::pipeline::PipelineError;
use splatseg::segmenter::SegmenterError;
use splatseg::{Pipeline, Segmenter, Settings};
use splatseg_test_scenes::room;

const FRAMES: usize = 8;

/// Finds the left half of each image, but fails at one call.
struct FailsOnce {
    calls: usize,
    failing: Option<usize>,
}

impl Segmenter for FailsOnce {
    fn name(&self) -> &str {
        "fails-once"
    }

    fn segment(&mut self, frame: &CameraFrame) -> Result<Segmentation, SegmenterError> {
        self.calls += 1;
        if self.failing == Some(self.calls) {
            return Err(SegmenterError::Other { name: self.name().to_owned(), source: "no network".into() });
        }
        let mask = Mask::from_fn(frame.width(), frame.height(), |column, _| 2 * column < frame.width());
        Ok(vec![ScoredMask { mask, score: 1.0 }].into())
    }
}

#[test]
fn a_frame_of_a_tracked_camera_can_be_tried_again() {
    let scene = room(&format!("synthetic:frames={FRAMES},width=128,height=96,noise=kinect"));
    let settings: Settings = toml::from_str("poses = \"track\"").unwrap();
    let results = |failing: Option<usize>| {
        let segmenter = Box::new(FailsOnce { calls: 0, failing });
        let mut pipeline = Pipeline::builder(&settings).segmenter(segmenter).build().unwrap();
        let step = |index| {
            let frame = scene.read_frame(index).unwrap();
            let result = pipeline.step(&frame).or_else(|error| {
                assert!(matches!(error, PipelineError::Segmenter { .. }), "{error}");
                assert_eq!(failing, Some(index + 1));
                pipeline.step(&frame)
            });
            let result = result.unwrap();
            (result.pose.world_from_camera.to_row_major(), result.output.segments)
        };
        (0..FRAMES).map(step).collect::<Vec<_>>()
    };
    let expected = results(None);
    for failing in [1, 4, 7] {
        assert!(results(Some(failing)) == expected, "after a failure in frame {failing}");
    }
}
