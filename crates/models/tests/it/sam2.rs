//! Compares SAM 2.1 on videos with the official predictor (reference data in `../shared/golden/sam2`), and tests
//! properties that need no reference.

use crate::sam2_golden::test_device::device;
use crate::sam2_golden::{FormulaWeights, Golden, Within, assert_close, folder, mini_weights};
use burn::tensor::Device;
use splatseg_geometry::{Click, Image, Mask, Prompt};
use splatseg_models::sam2::{ObjectMask, Sam2Config, Sam2Error, Sam2Network, Sam2Predictor, Sam2PredictorSettings};
use splatseg_models::transfer::Transfers;
use std::path::Path;
use std::sync::Arc;

const WIDTH: usize = 288;
const HEIGHT: usize = 200;

/// Settings used for the reference, for a video of `length` frames: the official defaults, but without the hole-filling
/// extension, and with propagation that restarts at corrected frames.
fn reference(length: usize) -> Sam2PredictorSettings {
    Sam2PredictorSettings {
        fill_hole_area: 0,
        track_corrected_frames_again: true,
        ..Sam2PredictorSettings::official(length)
    }
}

fn mini(folder: &Path) -> Arc<Sam2Network> {
    Arc::new(Sam2Network::load(&mini_weights(folder), None, &device()).unwrap())
}

fn frames(folder: &Path) -> Vec<Image<[u8; 3]>> {
    let read = |index: usize| {
        let picture = image::open(folder.join(format!("mini_video/{index:05}.png"))).unwrap().to_rgb8();
        Image::from_pixels(WIDTH, HEIGHT, picture.pixels().map(|pixel| pixel.0).collect()).unwrap()
    };
    (0..10).map(read).collect()
}

fn masks(golden: &Golden, name: &str) -> Vec<Mask> {
    let values = golden.bytes(name);
    let mask = |values: &[u8]| Mask::from_fn(WIDTH, HEIGHT, |column, row| values[row * WIDTH + column] != 0);
    values.chunks_exact(WIDTH * HEIGHT).map(mask).collect()
}

fn clicks(golden: &Golden, name: &str) -> Vec<Click> {
    let (coords, labels) = (golden.floats(&format!("{name}.coords")), golden.floats(&format!("{name}.labels")));
    let clicks = coords.chunks_exact(2).zip(labels);
    clicks.map(|(point, label)| Click { x: point[0], y: point[1], positive: label == 1.0 }).collect()
}

const VIDEO: Within = Within::Mixed(2e-3, 1e-3);

/// Compares logits at the video's size: one mask per object, -1024 for objects not known yet.
#[track_caller]
fn assert_video_logits(golden: &Golden, name: &str, found: &[Option<&ObjectMask>]) {
    let expected = golden.floats(name);
    for (object, expected) in expected.chunks_exact(WIDTH * HEIGHT).enumerate() {
        let logits = match found[object] {
            Some(mask) => mask.logits().into_pixels(),
            None => vec![-1024.0; WIDTH * HEIGHT],
        };
        assert_close(&format!("{name} of object {object}"), &logits, expected, VIDEO);
    }
}

/// One pass of a reference scenario.
struct Pass<'a> {
    golden: &'a Golden,
    pass: &'a str,
}

impl Pass<'_> {
    /// Returns the values of row `row` and object index `object` of a tensor `[frames, objects, ..]`.
    fn part(&self, name: &str, row: usize, object: usize) -> Vec<f32> {
        let name = format!("{}.{name}", self.pass);
        let shape = self.golden.shape(&name);
        let size: usize = shape[2..].iter().product();
        self.golden.floats(&name)[(row * shape[1] + object) * size..][..size].to_vec()
    }

    /// Compares an object in a frame; `row` and `object` are indices within the pass.
    #[track_caller]
    fn check(&self, row: usize, object: usize, found: &ObjectMask) {
        let what = |name: &str| format!("{}.{name} row {row} object {object}", self.pass);
        let expected = self.part("low_res_logits", row, object);
        let within = if expected[0] == -1024.0 { Within::Absolute(0.0) } else { Within::Absolute(2e-3) };
        assert_close(&what("low_res_logits"), found.low_res_logits.pixels(), &expected, within);
        if self.golden.has(&format!("{}.video_logits", self.pass)) {
            let expected = self.part("video_logits", row, object);
            assert_close(&what("video_logits"), found.logits().pixels(), &expected, VIDEO);
        }
        let score = self.part("object_score_logits", row, object);
        assert_close(&what("score"), &[found.object_score], &score, Within::Absolute(2e-3));
        let pointer = self.part("obj_ptr", row, object);
        assert_close(&what("obj_ptr"), &found.pointer, &pointer, Within::Absolute(1e-3));
    }

    /// Compares an object's memory of a frame.
    #[track_caller]
    fn check_memory(&self, row: usize, object: usize, found: &[f32]) {
        let planes = self.part("maskmem_features", row, object);
        let tokens = planes.len() / 16;
        let expected: Vec<f32> = (0..planes.len()).map(|index| planes[index % 16 * tokens + index / 16]).collect();
        let what = format!("{}.maskmem_features row {row} object {object}", self.pass);
        assert_close(&what, found, &expected, Within::OfMax(0.01));
        let mean = found.iter().zip(&expected).map(|(a, b)| (a - b).abs()).sum::<f32>() / found.len() as f32;
        assert!(mean < 1e-3, "{what}: off by {mean} on average");
    }
}

/// Tracks all objects from the frame after the current one and compares with rows `from..` of a pass.
fn follow(
    predictor: &mut Sam2Predictor,
    frames: &[&Image<[u8; 3]>],
    pass: &Pass,
    from: usize,
    objects: &[(u64, usize)],
) {
    for (offset, frame) in frames.iter().enumerate() {
        let masks = predictor.track(frame).unwrap();
        for (id, number) in objects {
            let mask = masks.iter().find(|mask| mask.object == *id).unwrap();
            pass.check(from + offset, *number, mask);
        }
        predictor.remember_frame();
        let now = predictor.state().frames() - 1;
        for (id, number) in objects {
            pass.check_memory(from + offset, *number, &predictor.state().memory(*id, now).unwrap().unwrap());
        }
    }
}

#[test]
fn scenario_a_mask_prompts() {
    let Some(folder) = folder("scenario_a_mask_prompts") else { return };
    let golden = Golden::open(&folder, "mini_video_A");
    let (network, frames) = (mini(&folder), frames(&folder));
    let pass = Pass { golden: &golden, pass: "p1" };
    for objects_per_chunk in [1, 2, 8] {
        let settings = Sam2PredictorSettings { objects_per_chunk, ..reference(10) };
        let mut predictor = Sam2Predictor::new(network.clone(), settings).unwrap();
        predictor.track(&frames[0]).unwrap();
        let prompts: Vec<(u64, Prompt)> =
            (1..).zip(masks(&golden, "masks_video_u8").into_iter().map(Prompt::Mask)).collect();
        let prompted = predictor.prompt_all(&prompts).unwrap();
        assert_video_logits(&golden, "after_add3.video_logits", &prompted.iter().map(Some).collect::<Vec<_>>());
        prompted.iter().enumerate().for_each(|(number, mask)| pass.check(0, number, mask));
        let rest: Vec<_> = frames[1..].iter().collect();
        follow(&mut predictor, &rest, &pass, 1, &[(1, 0), (2, 1), (3, 2)]);
    }
}

/// Box and points on frame 0, then a correction on frame 5.
fn scenario_b(settings: Sam2PredictorSettings, corrected: &str) {
    let Some(folder) = folder("scenario_b") else { return };
    let golden = Golden::open(&folder, "mini_video_B");
    let after = Golden::open(&folder, corrected);
    let (network, frames) = (mini(&folder), frames(&folder));
    let mut predictor = Sam2Predictor::new(network.clone(), settings).unwrap();
    predictor.track(&frames[0]).unwrap();
    let corners: [f32; 4] = golden.floats("box1").try_into().unwrap();
    let first = predictor.prompt(1, &Prompt::bounding_box(corners)).unwrap();
    assert_video_logits(&golden, "after_add1.video_logits", &[Some(&first)]);
    let clicked = Prompt::Points { bounding_box: None, clicks: clicks(&golden, "points2_first") };
    let second = predictor.prompt(2, &clicked).unwrap();
    assert_video_logits(&golden, "after_add2_first.video_logits", &[Some(&first), Some(&second)]);
    let second = predictor.prompt(2, &Prompt::MoreClicks(clicks(&golden, "points2_second"))).unwrap();
    assert_video_logits(&golden, "after_add2_second.video_logits", &[Some(&first), Some(&second)]);
    let pass = Pass { golden: &golden, pass: "p1" };
    pass.check(0, 0, &first);
    pass.check(0, 1, &second);
    let objects = [(1, 0), (2, 1)];
    follow(&mut predictor, &frames[1..5].iter().collect::<Vec<_>>(), &pass, 1, &objects);

    let tracked = predictor.track(&frames[5]).unwrap();
    tracked.iter().enumerate().for_each(|(number, mask)| pass.check(5, number, mask));
    let correction = Prompt::Points { bounding_box: None, clicks: clicks(&after, "correction") };
    let mask = predictor.prompt(2, &correction).unwrap();
    let expected = after.floats("after_correction.obj2_low_res_logits");
    assert_close("correction", mask.low_res_logits.pixels(), &expected, Within::Absolute(2e-3));
    let expected = after.floats("after_correction.obj2_obj_ptr");
    assert_close("correction's pointer", &mask.pointer, &expected, Within::Absolute(1e-3));
    let expected = after.floats("after_correction.obj2_object_score_logits");
    assert_close("correction's score", &[mask.object_score], &expected, Within::Absolute(2e-3));
    assert_video_logits(&after, "after_correction.video_logits", &[Some(&tracked[0]), Some(&mask)]);
    let pass = Pass { golden: &after, pass: "p2" };
    follow(&mut predictor, &frames[6..].iter().collect::<Vec<_>>(), &pass, 1, &objects);
}

#[test]
fn scenario_b_corrections_without_effect() {
    scenario_b(reference(10), "mini_video_B");
}

#[test]
fn scenario_b_corrections_that_condition() {
    let settings = Sam2PredictorSettings { add_all_frames_to_correct_as_cond: true, ..reference(10) };
    scenario_b(settings, "mini_video_B_all_cond");
}

#[test]
fn scenario_c_an_object_added_late() {
    let Some(folder) = folder("scenario_c_an_object_added_late") else { return };
    let (start, golden) = (Golden::open(&folder, "mini_video_A"), Golden::open(&folder, "mini_video_C"));
    let (network, frames) = (mini(&folder), frames(&folder));
    let mut predictor = Sam2Predictor::new(network.clone(), reference(10)).unwrap();
    predictor.track(&frames[0]).unwrap();
    for (id, mask) in (1..=2).zip(masks(&start, "masks_video_u8")) {
        predictor.prompt(id, &Prompt::Mask(mask)).unwrap();
    }
    let (before, pass) = (Pass { golden: &start, pass: "p1" }, Pass { golden: &golden, pass: "p2" });
    follow(&mut predictor, &frames[1..4].iter().collect::<Vec<_>>(), &before, 1, &[(1, 0), (2, 1)]);
    let tracked = predictor.track(&frames[4]).unwrap();
    let added = predictor.prompt(3, &Prompt::Mask(masks(&golden, "mask3_video_u8").remove(0))).unwrap();
    assert_video_logits(&golden, "after_add3.video_logits", &[Some(&tracked[0]), Some(&tracked[1]), Some(&added)]);
    for (number, mask) in [&tracked[0], &tracked[1], &added].into_iter().enumerate() {
        pass.check(0, number, mask);
    }
    follow(&mut predictor, &frames[5..].iter().collect::<Vec<_>>(), &pass, 1, &[(1, 0), (2, 1), (3, 2)]);
}

#[test]
fn scenario_f_more_pointers_than_fit() {
    let Some(folder) = folder("scenario_f_more_pointers_than_fit") else { return };
    let golden = Golden::open(&folder, "mini_video_F_long");
    let (network, frames) = (mini(&folder), frames(&folder));
    let order: Vec<_> = golden.ints("source_frame").into_iter().map(|index| &frames[index]).collect();
    let mut predictor = Sam2Predictor::new(network.clone(), reference(20)).unwrap();
    predictor.track(order[0]).unwrap();
    predictor.prompt(1, &Prompt::Mask(masks(&golden, "mask_video_u8").remove(0))).unwrap();
    follow(&mut predictor, &order[1..], &Pass { golden: &golden, pass: "p1" }, 1, &[(1, 0)]);
}

/// Runs the network on a smaller input than the published one: position embeddings are interpolated as in the official
/// code. The reference was generated by `tools/make_sam2_size_test_data.py`.
#[test]
fn another_image_size() {
    let Some(folder) = folder("another_image_size") else { return };
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    let golden = Golden::open(&data, "sam2_mini_224");
    let network = Arc::new(Sam2Network::load(&mini_weights(&folder), Some(224), &device()).unwrap());
    let frames = frames(&folder);
    let embedding = network.encode(network.input(&frames[0])).embedding.permute([0, 3, 1, 2]);
    let embedding = embedding.into_data().try_into_vec::<f32>().unwrap();
    assert_close("embedding", &embedding, &golden.floats("embedding"), Within::OfMax(1e-5));
    let mask = masks(&Golden::open(&folder, "mini_preprocess"), "mask_video_u8").remove(0);
    let mut predictor = Sam2Predictor::new(network, reference(3)).unwrap();
    let (logits, scores) = (golden.floats("low_res_logits"), golden.floats("object_score_logits"));
    for (index, frame) in frames[..3].iter().enumerate() {
        let found = predictor.track(frame).unwrap();
        let found =
            if index == 0 { predictor.prompt(1, &Prompt::Mask(mask.clone())).unwrap() } else { found[0].clone() };
        let expected = &logits[index * 56 * 56..][..56 * 56];
        assert_close("low_res_logits", found.low_res_logits.pixels(), expected, Within::Absolute(2e-3));
        assert_close("object_score", &[found.object_score], &scores[index..=index], Within::Absolute(2e-3));
    }
}

#[test]
fn memory_stays_bounded_and_corrections_are_not_lost() {
    let Some(folder) = folder("memory_stays_bounded_and_corrections_are_not_lost") else { return };
    let golden = Golden::open(&folder, "mini_video_A");
    // The memory's contents do not depend on the input's size; a small one is fast.
    let network = Arc::new(Sam2Network::load(&mini_weights(&folder), Some(64), &device()).unwrap());
    let frames = frames(&folder);
    let mask = masks(&golden, "masks_video_u8").remove(0);
    let mut predictor = Sam2Predictor::new(network.clone(), Sam2PredictorSettings::default()).unwrap();
    let mut without = Sam2Predictor::new(network.clone(), Sam2PredictorSettings::default()).unwrap();
    let mut bytes = Vec::new();
    for step in 0..60 {
        let frame = &frames[step % 10];
        let found = predictor.track(frame).unwrap();
        let other = if step <= 3 { without.track(frame).unwrap() } else { Vec::new() };
        if step == 0 {
            predictor.prompt(7, &Prompt::Mask(mask.clone())).unwrap();
            without.prompt(7, &Prompt::Mask(mask.clone())).unwrap();
        } else if step == 2 {
            assert_eq!(found, other);
            predictor.prompt(7, &Prompt::click(5.0, 190.0)).unwrap();
        } else if step == 3 {
            assert_ne!(found, other, "a correction must change what follows");
        } else if step % 5 == 0 {
            predictor.prompt(7, &Prompt::Mask(mask.clone())).unwrap();
        }
        bytes.push(predictor.state().memory_bytes());
    }
    let early = bytes[..30].iter().max();
    assert_eq!(early, bytes[30..].iter().max(), "memory grows with the video: {bytes:?}");
}

#[test]
fn removed_objects_leave_no_trace() {
    let Some(folder) = folder("removed_objects_leave_no_trace") else { return };
    let golden = Golden::open(&folder, "mini_video_A");
    let (network, frames) = (mini(&folder), frames(&folder));
    let masks = masks(&golden, "masks_video_u8");
    let mut both = Sam2Predictor::new(network.clone(), Sam2PredictorSettings::default()).unwrap();
    let mut one = Sam2Predictor::new(network.clone(), Sam2PredictorSettings::default()).unwrap();
    both.track(&frames[0]).unwrap();
    one.track(&frames[0]).unwrap();
    both.prompt_all(&[(5, Prompt::Mask(masks[0].clone())), (2, Prompt::Mask(masks[1].clone()))]).unwrap();
    one.prompt(2, &Prompt::Mask(masks[1].clone())).unwrap();
    let found = both.track(&frames[1]).unwrap();
    assert_eq!(found.iter().map(|mask| mask.object).collect::<Vec<_>>(), [2, 5]);
    one.track(&frames[1]).unwrap();
    both.remove(5).unwrap();
    assert_eq!(both.remove(5), Err(Sam2Error::UnknownObject { object: 5 }));
    assert_eq!(both.track(&frames[2]).unwrap(), one.track(&frames[2]).unwrap());
}

#[test]
fn bad_prompts_are_refused() {
    let Some(folder) = folder("bad_prompts_are_refused") else { return };
    let (network, frames) = (mini(&folder), frames(&folder));
    let mut predictor = Sam2Predictor::new(network.clone(), Sam2PredictorSettings::default()).unwrap();
    assert_eq!(predictor.prompt(1, &Prompt::click(3.0, 3.0)), Err(Sam2Error::NoFrame));
    predictor.track(&frames[0]).unwrap();
    for (x, y) in [(f32::NAN, 3.0), (3.0, f32::INFINITY), (-0.5, 3.0), (289.0, 3.0), (3.0, 200.5)] {
        let refused = predictor.prompt(1, &Prompt::click(x, y));
        assert!(matches!(refused, Err(Sam2Error::PointOutside { object: 1, .. })), "({x}, {y}): {refused:?}");
    }
    let corners = [50.0, 50.0, 50.0, 80.0];
    let refused = predictor.prompt(1, &Prompt::bounding_box(corners));
    assert_eq!(refused, Err(Sam2Error::EmptyBox { object: 1, corners }));
    let nothing = Prompt::Points { bounding_box: None, clicks: Vec::new() };
    assert_eq!(predictor.prompt(1, &nothing), Err(Sam2Error::EmptyPrompt { object: 1 }));
    let refused = predictor.prompt(1, &Prompt::Mask(Mask::empty(WIDTH, HEIGHT)));
    assert_eq!(refused, Err(Sam2Error::EmptyMask { object: 1 }));
    let refused = predictor.prompt(1, &Prompt::Mask(Mask::from_fn(3, 4, |_, _| true)));
    assert_eq!(refused, Err(Sam2Error::MaskSize { object: 1, found: (3, 4), expected: (WIDTH, HEIGHT) }));
    assert_eq!(predictor.remove(1), Err(Sam2Error::UnknownObject { object: 1 }));
    assert_eq!(predictor.state().objects().count(), 0, "refused prompts make no objects");
    let other = Image::filled(10, 10, [0; 3]);
    assert_eq!(
        predictor.track(&other).unwrap_err(),
        Sam2Error::FrameSize { found: (10, 10), expected: (WIDTH, HEIGHT) }
    );
    let settings = Sam2PredictorSettings { objects_per_chunk: 0, ..Sam2PredictorSettings::default() };
    assert!(matches!(Sam2Predictor::new(network.clone(), settings), Err(Sam2Error::Setting { .. })));
}

/// Weights with names and shapes, and zeros for values.
struct Shapes(FormulaWeights);

impl splatseg_models::sam2::Weights for Shapes {
    fn names(&self) -> Vec<String> {
        self.0.names()
    }

    fn shape(&self, name: &str) -> Option<Vec<usize>> {
        self.0.shape(name)
    }

    fn read(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, Sam2Error> {
        if self.shape(name).as_deref() != Some(shape) {
            return Err(Sam2Error::UnreadableTensor { name: name.into(), reason: "refused".into() });
        }
        Ok(vec![0.0; shape.iter().product()])
    }
}

#[test]
fn every_size_is_recognised_and_has_exactly_its_tensors() {
    let Some(folder) = folder("every_size_is_recognised_and_has_exactly_its_tensors") else { return };
    for (size, config) in ["tiny", "small", "base_plus", "large"].into_iter().zip(&Sam2Config::ALL[1..]) {
        let mut weights = Shapes(FormulaWeights::from_manifest(&folder, size));
        let network =
            Sam2Network::load(&weights, Some(64), &device()).unwrap_or_else(|error| panic!("{size}: {error}"));
        assert_eq!(network.config(), config, "{size}");

        weights.0.shapes_mut().insert("extra".into(), vec![1]);
        let refused = Sam2Network::load(&weights, Some(64), &device()).unwrap_err();
        assert_eq!(refused, Sam2Error::UnexpectedTensor { name: "extra".into() });
        weights.0.shapes_mut().remove("memory_encoder.out_proj.bias");
        let refused = Sam2Network::load(&weights, Some(64), &device()).unwrap_err();
        assert_eq!(refused, Sam2Error::MissingTensor { name: "memory_encoder.out_proj.bias".into() });
        weights.0.shapes_mut().insert("no_obj_ptr".into(), vec![1, 3]);
        let refused = Sam2Network::load(&weights, Some(64), &device()).unwrap_err();
        let expected = Sam2Error::TensorShape { name: "no_obj_ptr".into(), found: vec![1, 3], expected: vec![1, 256] };
        assert_eq!(refused, expected);
    }
}

/// On the CPU there are no transfers. On other devices the host waits for masks and scores once per chunk of objects.
#[test]
fn a_frame_takes_one_round_trip_for_each_chunk_of_objects() {
    let Some(folder) = folder("a_frame_takes_one_round_trip_for_each_chunk_of_objects") else { return };
    let golden = Golden::open(&folder, "mini_video_A");
    let (network, frames) = (mini(&folder), frames(&folder));
    let settings = Sam2PredictorSettings { objects_per_chunk: 2, ..Sam2PredictorSettings::default() };
    let mut predictor = Sam2Predictor::new(network.clone(), settings).unwrap();
    predictor.track(&frames[0]).unwrap();
    let prompts: Vec<(u64, Prompt)> =
        (1..).zip(masks(&golden, "masks_video_u8").into_iter().map(Prompt::Mask)).collect();
    assert_eq!(prompts.len(), 3, "two chunks");
    let moves = device() != Device::flex();
    let mut so_far = Transfers::so_far();
    let mut since = || {
        let moved = Transfers::so_far().since(so_far);
        so_far = Transfers::so_far();
        moved
    };
    predictor.prompt_all(&prompts).unwrap();
    assert_eq!(since().downloads, if moves { 2 } else { 0 });
    for frame in &frames[1..4] {
        let found = predictor.track(frame).unwrap();
        let moved = since();
        if !moves {
            assert_eq!(moved, Transfers::default());
            continue;
        }
        // Logits, pointer and two scores of each object, but no features, memories or attention.
        let numbers: usize = found.iter().map(|mask| mask.low_res_logits.pixels().len() + mask.pointer.len() + 2).sum();
        assert_eq!((moved.downloads, moved.downloaded_bytes), (2, 4 * numbers));
        // The frame, and after prompts their masks; other uploads are small.
        let side = network.image_size();
        let (input, masks) = (4 * 3 * side * side, 4 * 3 * (side / 4).pow(2));
        assert!(moved.uploaded_bytes < input + masks + 16_384, "{moved:?}");
    }
}
