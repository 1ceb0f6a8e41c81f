//! Objects that have been absent for long rest: they cost nothing until they are prompted or found. Weights are given
//! by a formula; the bias of the object score decides whether a tracked object is in the frame.

use crate::sam2_golden::FormulaWeights;
use burn::tensor::Device;
use splatseg_geometry::{Image, Mask, Prompt};
use splatseg_models::sam2::{
    ObjectMask, Sam2Error, Sam2Network, Sam2Predictor, Sam2PredictorSettings, VideoState, Weights,
};
use std::path::Path;
use std::sync::Arc;

const SIDE: usize = 64;
const OBJECTS: u64 = 5;
/// An object rests after this many frames without it.
const PATIENCE: usize = 3;

/// Weights with a modified bias of the object score: with a large negative bias, a tracked object is never in the
/// frame.
struct WithScoreBias(FormulaWeights, f32);

impl Weights for WithScoreBias {
    fn names(&self) -> Vec<String> {
        self.0.names()
    }

    fn shape(&self, name: &str) -> Option<Vec<usize>> {
        self.0.shape(name)
    }

    fn read(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, Sam2Error> {
        let mut values = self.0.read(name, shape)?;
        if name == "sam_mask_decoder.pred_obj_score_head.layers.2.bias" {
            values[0] += self.1;
        }
        Ok(values)
    }
}

fn network(score_bias: f32) -> Arc<Sam2Network> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/sam2");
    let weights = WithScoreBias(FormulaWeights::from_manifest(&folder, "mini"), score_bias);
    Arc::new(Sam2Network::load(&weights, Some(SIDE), &Device::flex()).unwrap())
}

fn blind() -> Arc<Sam2Network> {
    network(-50.0)
}

fn seeing() -> Arc<Sam2Network> {
    network(50.0)
}

fn frame(index: usize) -> Image<[u8; 3]> {
    let value = |at: usize| (at * 37 % 256) as u8;
    Image::from_fn(SIDE, SIDE, |x, y| [value(x / 8 + index), value(y / 8), value(x / 16 + y / 16)])
}

fn prompt(id: u64) -> (u64, Prompt) {
    let left = 8 * id as usize;
    (id, Prompt::Mask(Mask::from_fn(SIDE, SIDE, |x, y| (left..left + 16).contains(&x) && (16..48).contains(&y))))
}

fn resting() -> Sam2PredictorSettings {
    Sam2PredictorSettings { max_absent_frames: PATIENCE, ..Sam2PredictorSettings::default() }
}

/// Returns the state of a video whose objects were all prompted on the first frame and not seen again, at the first
/// frame in which the network processes none of them.
fn at_rest() -> VideoState {
    let mut predictor = Sam2Predictor::new(blind(), resting()).unwrap();
    predictor.track(&frame(0)).unwrap();
    predictor.prompt_all(&(0..OBJECTS).map(prompt).collect::<Vec<_>>()).unwrap();
    for index in 1..=PATIENCE {
        let found = predictor.track(&frame(index)).unwrap();
        assert_eq!(found.len(), OBJECTS as usize, "frame {index}");
        assert!(found.iter().all(|mask| !mask.is_present()));
    }
    assert!(predictor.track(&frame(PATIENCE + 1)).unwrap().is_empty());
    predictor.state().clone()
}

#[test]
fn resting_objects_cost_nothing() {
    let mut predictor = Sam2Predictor::resume(blind(), resting(), at_rest()).unwrap();
    let (passes, bytes) = (predictor.state().object_passes(), predictor.state().memory_bytes());
    // Per object: a prompt and its memory, then a mask and a memory per frame, except that the last is not remembered.
    assert_eq!(passes, OBJECTS as usize * (2 + PATIENCE + PATIENCE - 1));
    for index in 0..30 {
        assert!(predictor.track(&frame(index)).unwrap().is_empty());
    }
    assert_eq!(predictor.state().object_passes(), passes);
    assert_eq!(predictor.state().memory_bytes(), bytes);
    assert_eq!(predictor.state().objects().count(), OBJECTS as usize);
    let tokens = (SIDE / 16) * (SIDE / 16);
    let frame_bytes = 2 * tokens * network(0.0).config().memory_dim + 4 * network(0.0).config().hidden_dim;
    assert_eq!(bytes, OBJECTS as usize * frame_bytes, "more than the prompted frame is kept");
}

#[test]
fn objects_never_rest_by_default() {
    let mut predictor = Sam2Predictor::new(blind(), Sam2PredictorSettings::default()).unwrap();
    predictor.track(&frame(0)).unwrap();
    predictor.prompt_all(&[prompt(1), prompt(2)]).unwrap();
    for index in 1..30 {
        assert_eq!(predictor.track(&frame(index)).unwrap().len(), 2);
    }
}

#[test]
fn objects_that_are_seen_do_not_rest() {
    let mut predictor = Sam2Predictor::new(seeing(), resting()).unwrap();
    predictor.track(&frame(0)).unwrap();
    predictor.prompt_all(&[prompt(1), prompt(2)]).unwrap();
    for index in 1..3 * PATIENCE {
        assert_eq!(predictor.track(&frame(index)).unwrap().len(), 2);
    }
}

fn ids(masks: &[ObjectMask]) -> Vec<u64> {
    masks.iter().map(|mask| mask.object).collect()
}

#[test]
fn a_prompt_ends_the_rest_of_its_object_only() {
    let mut predictor = Sam2Predictor::resume(seeing(), resting(), at_rest()).unwrap();
    let passes = predictor.state().object_passes();
    predictor.prompt(3, &Prompt::click(30.0, 30.0)).unwrap();
    assert_eq!(predictor.state().object_passes(), passes + 1);
    for index in 1..=2 * PATIENCE {
        let found = predictor.track(&frame(index)).unwrap();
        assert_eq!(ids(&found), [3]);
        assert!(found[0].is_present());
        assert_eq!(predictor.state().object_passes(), passes + 1 + 2 * index);
    }
    // The new prompt conditions the tracking in addition to the first: both frames are kept.
    let state = predictor.state();
    assert!(state.memory(3, 0).unwrap().is_some() && state.memory(3, PATIENCE + 1).unwrap().is_some());
    assert!(state.memory(3, 1).unwrap().is_none());

    // If it is not seen, it rests again.
    let mut predictor = Sam2Predictor::resume(blind(), resting(), predictor.state().clone()).unwrap();
    let seen: Vec<usize> = (0..PATIENCE + 2).map(|index| predictor.track(&frame(index)).unwrap().len()).collect();
    assert_eq!(seen, [1, 1, 1, 0, 0]);
}

#[test]
fn resting_objects_are_looked_for_in_turn() {
    let interval = 4;
    let settings = Sam2PredictorSettings { absent_check_interval: interval, ..resting() };
    let mut predictor = Sam2Predictor::resume(blind(), settings, at_rest()).unwrap();
    let (passes, bytes) = (predictor.state().object_passes(), predictor.state().memory_bytes());
    let counts: Vec<usize> = (0..2 * interval).map(|index| predictor.track(&frame(index)).unwrap().len()).collect();
    assert_eq!(counts.iter().sum::<usize>(), 2 * OBJECTS as usize);
    assert!(counts.iter().all(|count| *count <= 2), "not all in the same frame: {counts:?}");
    assert_eq!(predictor.state().object_passes(), passes + 2 * OBJECTS as usize, "nothing is remembered");
    assert_eq!(predictor.state().memory_bytes(), bytes);

    let mut predictor = Sam2Predictor::resume(seeing(), settings, predictor.state().clone()).unwrap();
    let mut followed = 0;
    for index in 0..interval {
        let found = predictor.track(&frame(index)).unwrap().len();
        assert!(found >= followed, "what was found is followed");
        followed = found;
    }
    assert_eq!(followed, OBJECTS as usize);
}

/// Returns all masks from a predictor while objects are prompted, tracked, lost, resting and prompted again.
fn everything(objects_per_chunk: usize) -> Vec<ObjectMask> {
    let settings = Sam2PredictorSettings { objects_per_chunk, absent_check_interval: 4, ..resting() };
    let mut all = Vec::new();
    let mut state = VideoState::default();
    for (network, frames) in [(seeing(), 0..3), (blind(), 3..10), (seeing(), 10..13)] {
        let mut predictor = Sam2Predictor::resume(network, settings, state).unwrap();
        for index in frames {
            all.extend(predictor.track(&frame(index)).unwrap());
            let prompts: Vec<(u64, Prompt)> = match index {
                0 => (0..OBJECTS).map(prompt).collect(),
                2 => vec![(1, Prompt::click(20.0, 20.0)), (4, Prompt::click(50.0, 20.0))],
                10 => vec![(2, Prompt::click(20.0, 20.0)), (3, Prompt::click(50.0, 20.0))],
                _ => Vec::new(),
            };
            all.extend(predictor.prompt_all(&prompts).unwrap());
        }
        state = predictor.state().clone();
    }
    all
}

#[test]
fn results_do_not_depend_on_how_many_objects_go_together() {
    let one_by_one = everything(1);
    assert!(one_by_one.len() > 40);
    for objects_per_chunk in [2, 3, 64] {
        assert!(everything(objects_per_chunk) == one_by_one, "{objects_per_chunk} objects at a time");
    }
}
