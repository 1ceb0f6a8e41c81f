//! Learning compared with its definition, and its effects.

use super::*;
use crate::features::loss::TINY;
use crate::{CodebookSettings, MemoryKind, SplatMemory};
use glam::{Mat4, Vec3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use splatseg_geometry::{Intrinsics, Pose, RgbdFrame, SegmentMap};
use std::collections::BTreeSet;

const SIZE: (usize, usize) = (64, 48);

/// A wall at z = 2 m, seen from `back` metres behind the origin.
fn wall(back: f32) -> RgbdFrame<'static> {
    let intrinsics = Intrinsics { fx: 50.0, fy: 50.0, cx: 31.5, cy: 23.5, width: SIZE.0, height: SIZE.1 };
    let pose = Pose::from_matrix(Mat4::from_translation(Vec3::new(0.0, 0.0, -back)).as_dmat4()).unwrap();
    let color = Image::filled(SIZE.0, SIZE.1, [90; 3]);
    RgbdFrame::new("0", color, Image::filled(SIZE.0, SIZE.1, 2.0 + back), intrinsics, pose).unwrap()
}

fn halves(left: u32, right: u32, border: usize) -> SegmentMap {
    SegmentMap::from_fn(SIZE.0, SIZE.1, |column, _| if column < border { left } else { right })
}

/// The loss defined in docs/PAPER.md, in f64.
fn loss(learning: &Learning<'_>, active: &ActiveWeights, features: &[f32]) -> f64 {
    let feature_dim = learning.codebook.feature_dim();
    let local: Vec<f32> = active
        .gaussians()
        .iter()
        .flat_map(|gaussian| features[*gaussian as usize * feature_dim..][..feature_dim].iter().copied())
        .collect();
    let mut sum = 0.0;
    for tile in active.tiles() {
        let mut pixels = vec![0.0; TileWeights::PIXELS * feature_dim];
        tile.render(&local, feature_dim, &mut pixels);
        let (left, top) = tile.weights.origin();
        for (pixel, feature) in pixels.chunks_exact(feature_dim).enumerate() {
            if tile.pixels.contains(pixel as u8) {
                let at = (left + pixel % TileWeights::SIDE, top + pixel / TileWeights::SIDE);
                let norm = f64::from(dot(feature, feature)).sqrt();
                sum += 50.0 * (f64::from(learning.target.confidence[at]) - norm).powi(2);
                if let Some(code) = learning.target.segments[at].checked_sub(1).filter(|_| norm > 1e-6) {
                    sum += 1.0 - f64::from(dot(feature, learning.codebook.vector(code as usize))) / norm;
                }
            }
        }
    }
    sum
}

/// Returns the losses after 0 to 20 steps for a camera `back` metres behind the pose from which the wall was mapped,
/// with a target that contradicts all remembered ids, and the fraction of pixels that decode to the target after the
/// last step.
fn descent(back: f32, rate: f32) -> (Vec<f64>, f32) {
    let settings = MemorySettings::default().with(|settings| {
        settings.kind = MemoryKind::Features;
        settings.feature_dim = 14;
        settings.num_codes = 16;
        settings.learning_rate = rate;
        settings.direction_learning_rate = rate;
        settings.active_tolerance = -1.0;
    });
    let mut memory = SplatMemory::new(settings.clone(), 0, &mut |_| {}).unwrap();
    (0..4).for_each(|_| _ = memory.new_segment().unwrap());
    let first = wall(0.0);
    memory.update(memory.recall(&first), &halves(1, 2, 32), &BTreeSet::new()).unwrap();
    let codebook =
        Codebook::generate(&CodebookSettings { num_codes: 16, feature_dim: 14, seed: 0 }, &mut |_| {}).unwrap();
    let labels = memory.map().segment_ids();
    let start: Vec<f32> = labels.iter().flat_map(|id| codebook.vector(*id as usize - 1).iter().copied()).collect();
    let frame = wall(back);
    let recall = memory.recall(&frame);
    let target = SegmentBelief {
        segments: halves(3, 4, 27),
        confidence: Image::from_fn(SIZE.0, SIZE.1, |_, row| if row < 20 { 1.0 } else { 0.7 }),
    };
    let (mut losses, mut features) = (Vec::new(), Vec::new());
    for num_steps in 0..=20 {
        // Without steps, no pixels would be active.
        let settings = settings.clone().with(|settings| settings.num_steps = num_steps.max(1));
        let learning = Learning { settings: &settings, codebook: &codebook, recall: &recall, target: &target };
        let active = recall.view.active_weights(&learning.active_pixels(&[]), 0.0);
        features.clone_from(&start);
        if num_steps > 0 {
            learning.descend(&active, &mut features);
        }
        losses.push(loss(&learning, &active, &features));
    }
    let (mut right, mut all) = (0.0, 0.0);
    for tile in recall.view.weights().tiles() {
        let mut pixels = vec![0.0; TileWeights::PIXELS * 14];
        tile.accumulate(&features, 14, &mut pixels);
        let ((left, top), (width, height)) = (tile.origin(), tile.size());
        for (row, column) in (0..height).flat_map(|row| (0..width).map(move |column| (row, column))) {
            let at = (left + column, top + row);
            if recall.silhouette[at] > 0.9 {
                let feature = &pixels[(row * TileWeights::SIDE + column) * 14..][..14];
                all += 1.0;
                right += f32::from(u8::from(
                    codebook.decode(feature, 4, 0.5).map(|code| code + 1) == Some(target.segments[at]),
                ));
            }
        }
    }
    (losses, right / all)
}

#[test]
fn ids_turn_within_a_frame_and_the_loss_falls_with_every_step_near_or_far() {
    // At 0.4 m, a Gaussian covers 25 pixels or more; at 20 m, a pixel shows 100 Gaussians.
    for back in [-1.6, -1.0, 0.0, 2.0, 6.0, 18.0] {
        let (losses, right) = descent(back, 0.5);
        assert!(losses.windows(2).all(|pair| pair[1] < pair[0]), "{back} m: {losses:?}");
        // The remaining pixels are where segments meet and blend.
        assert!(right > 0.9, "{back} m: {right} of the pixels have turned, {losses:?}");
        let (losses, _) = descent(back, 1.0);
        assert!(losses[20] < losses[0], "the largest allowed step size, {back} m: {losses:?}");
    }
}

/// A memory of features that has learnt the left two thirds of the wall as segments 1 and 2, and has given out ids up
/// to 4.
fn memory(settings: &MemorySettings) -> SplatMemory {
    let mut memory = SplatMemory::new(settings.clone(), 0, &mut |_| {}).unwrap();
    (0..4).for_each(|_| _ = memory.new_segment().unwrap());
    let whole = wall(0.0);
    let depth = Image::from_fn(SIZE.0, SIZE.1, |column, _| if column < 44 { 2.0 } else { 0.0 });
    let color = Image::filled(SIZE.0, SIZE.1, [90; 3]);
    let frame = RgbdFrame::new("0", color, depth, *whole.intrinsics(), Pose::IDENTITY).unwrap();
    memory.update(memory.recall(&frame), &halves(1, 2, 22), &BTreeSet::new()).unwrap();
    memory
}

fn settings(feature_dim: usize) -> MemorySettings {
    MemorySettings::default().with(|settings| {
        settings.kind = MemoryKind::Features;
        settings.feature_dim = feature_dim;
        settings.num_codes = 16;
    })
}

fn codebook(settings: &MemorySettings) -> Codebook {
    let MemorySettings { num_codes, feature_dim, .. } = *settings;
    Codebook::generate(&CodebookSettings { num_codes, feature_dim, seed: 0 }, &mut |_| {}).unwrap()
}

/// A target of random rectangles with ids, including 0, and confidences.
fn patchwork(random: &mut ChaCha8Rng) -> SegmentBelief {
    let mut target = SegmentBelief { segments: halves(1, 2, 22), confidence: Image::filled(SIZE.0, SIZE.1, 1.0) };
    for _ in 0..12 {
        let (id, confidence) = (random.random_range(0..=4), random.random_range(0.0..1.0));
        let (left, top) = (random.random_range(0..SIZE.0 - 12), random.random_range(0..SIZE.1 - 12));
        for at in (left..left + 12).flat_map(|column| (top..top + 9).map(move |row| (column, row))) {
            target.segments[at] = id;
            target.confidence[at] = confidence;
        }
    }
    target
}

/// Returns the pixels to be learnt by the descriptions of the settings.
fn pixels_to_learn(learning: &Learning<'_>, touched: &[PixelSet]) -> Image<bool> {
    let (settings, recall, target) = (learning.settings, learning.recall, learning.target);
    let feature_dim = settings.feature_dim;
    let mut seed = Image::filled(SIZE.0, SIZE.1, false);
    let mut is_touched = seed.clone();
    let is_covered = |at| settings.learn_new || recall.silhouette[at] >= settings.growth_silhouette;
    for (tile, weights) in recall.view.weights().tiles().iter().enumerate() {
        let ((left, top), (width, height)) = (weights.origin(), weights.size());
        for (column, row) in (0..width).flat_map(|column| (0..height).map(move |row| (column, row))) {
            let (pixel, at) = (row * TileWeights::SIDE + column, (left + column, top + row));
            is_touched[at] = touched.get(tile).is_some_and(|touched| touched.contains(pixel as u8));
            let feature = &recall.tiles[tile].values[pixel * feature_dim..][..feature_dim];
            let length = dot(feature, feature).sqrt();
            let id = target.segments[at];
            let is_other_length = (length - target.confidence[at]).abs() > settings.active_tolerance;
            seed[at] = is_covered(at)
                && match id {
                    0 => is_other_length,
                    _ if recall.belief.segments[at] != id => true,
                    _ if feature_dim == 1 => (feature[0] - id as f32).abs() > settings.active_tolerance,
                    _ => {
                        let code = learning.codebook.vector(id as usize - 1);
                        is_other_length || dot(feature, code) < settings.active_min_cosine * length
                    }
                };
        }
    }
    let margin = settings.active_margin;
    Image::from_fn(SIZE.0, SIZE.1, |column, row| {
        let columns = column.saturating_sub(margin)..(column + margin + 1).min(SIZE.0);
        let rows = row.saturating_sub(margin)..(row + margin + 1).min(SIZE.1);
        let is_near = columns.flat_map(|column| rows.clone().map(move |row| (column, row))).any(|at| seed[at]);
        is_near && is_covered((column, row)) && !is_touched[(column, row)]
    })
}

#[test]
fn pixels_that_differ_and_their_surroundings_are_learnt() {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let changes: [fn(&mut MemorySettings); 8] = [
        |_| {},
        |settings| settings.active_margin = 0,
        |settings| settings.active_margin = 3,
        |settings| settings.active_tolerance = 0.4,
        |settings| settings.active_tolerance = -1.0,
        |settings| settings.active_min_cosine = 0.999,
        |settings| settings.learn_new = true,
        |settings| settings.growth_silhouette = 0.9,
    ];
    for (feature_dim, change) in [1, 7].into_iter().flat_map(|dim| changes.map(|change| (dim, change))) {
        let settings = settings(feature_dim).with(change);
        let (memory, codebook) = (memory(&settings), codebook(&settings));
        let frame = wall(0.1);
        let recall = memory.recall(&frame);
        let target = patchwork(&mut random);
        let learning = Learning { settings: &settings, codebook: &codebook, recall: &recall, target: &target };
        let mut touched = vec![PixelSet::default(); recall.tiles.len()];
        (0..60).for_each(|pixel| touched[1].insert(4 * pixel));
        for touched in [&touched[..], &[]] {
            let found = learning.active_pixels(touched);
            let expected = pixels_to_learn(&learning, touched);
            for (tile, weights) in recall.view.weights().tiles().iter().enumerate() {
                let (left, top) = weights.origin();
                for pixel in 0..=255u8 {
                    let at =
                        (left + usize::from(pixel) % TileWeights::SIDE, top + usize::from(pixel) / TileWeights::SIDE);
                    assert_eq!(found[tile].contains(pixel), expected[at], "{at:?}, D = {feature_dim}");
                }
            }
        }
        let none = settings.clone().with(|settings| settings.num_steps = 0);
        let found = Learning { settings: &none, ..learning }.active_pixels(&[]);
        assert!(found.len() == recall.tiles.len() && found.iter().all(PixelSet::is_empty));
    }
}

/// Features as rows of f64.
type Rows = Vec<Vec<f64>>;

fn dot64(left: &[f64], right: &[f64]) -> f64 {
    left.iter().zip(right).map(|(left, right)| left * right).sum()
}

/// Returns the gradient and the curvature across minus `direction_weight` at a pixel with these weights of features.
fn pixel_gradient(
    learning: &Learning<'_>,
    at: (usize, usize),
    weights: &[(usize, f64)],
    features: &Rows,
) -> (Vec<f64>, f64) {
    let (dim, settings) = (learning.settings.feature_dim, learning.settings);
    let (magnitude_weight, direction_weight) =
        (f64::from(settings.magnitude_weight), f64::from(settings.direction_weight));
    let mut rendered = vec![0.0; dim];
    for (gaussian, weight) in weights {
        rendered.iter_mut().zip(&features[*gaussian]).for_each(|(sum, value)| *sum += weight * value);
    }
    let (id, confidence) = (learning.target.segments[at], f64::from(learning.target.confidence[at]));
    if dim == 1 {
        return (vec![-2.0 * magnitude_weight * (f64::from(id) - rendered[0])], 0.0);
    }
    let sum: f64 = weights.iter().map(|(_, weight)| weight).sum();
    let squares: f64 =
        weights.iter().map(|(gaussian, weight)| weight * dot64(&features[*gaussian], &features[*gaussian])).sum();
    let length = dot64(&rendered, &rendered).sqrt();
    let tiny = f64::from(TINY);
    let cancelled = 1.0 - length * length / (sum * squares).max(tiny * tiny);
    let curvature = 2.0 * magnitude_weight * cancelled.clamp(0.0, 1.0) - direction_weight;
    let radial = -2.0 * magnitude_weight * (confidence - length);
    let direction: Vec<f64> = rendered.iter().map(|value| if length > tiny { value / length } else { 0.0 }).collect();
    if id == 0 {
        return (direction.iter().map(|value| radial * value).collect(), curvature);
    }
    let code: Vec<f64> = learning.codebook.vector(id as usize - 1).iter().map(|value| f64::from(*value)).collect();
    if length <= tiny {
        return (code.iter().map(|value| radial * value).collect(), curvature);
    }
    let cosine = dot64(&direction, &code);
    let turn = |(value, code): (&f64, &f64)| radial * value - direction_weight * (code - cosine * value) / length;
    (direction.iter().zip(&code).map(turn).collect(), curvature + direction_weight / (length * length))
}

/// Returns the features after `num_steps` steps by the formulas at the top of `learning.rs` and `loss.rs`.
fn descended(learning: &Learning<'_>, active: &ActiveWeights, features: &[f32]) -> Rows {
    let (settings, dim) = (learning.settings, learning.settings.feature_dim);
    let magnitude_weight = f64::from(settings.magnitude_weight);
    let start =
        |gaussian: &u32| features[*gaussian as usize * dim..][..dim].iter().map(|value| f64::from(*value)).collect();
    let mut ahead: Rows = active.gaussians().iter().map(start).collect();
    let mut last = ahead.clone();
    for step in 0..settings.num_steps {
        let mut gradients = vec![(vec![0.0; dim], 0.0); ahead.len()];
        for tile in active.tiles() {
            let mut pixels: Vec<Vec<(usize, f64)>> = vec![Vec::new(); TileWeights::PIXELS];
            for (column, gaussian) in tile.weights.gaussians().iter().enumerate() {
                for (pixel, weight) in tile.weights.column(column) {
                    pixels[usize::from(pixel)].push((*gaussian as usize, f64::from(weight)));
                }
            }
            let (left, top) = tile.weights.origin();
            for (pixel, weights) in pixels.iter().enumerate().filter(|(pixel, _)| tile.pixels.contains(*pixel as u8)) {
                let at = (left + pixel % TileWeights::SIDE, top + pixel / TileWeights::SIDE);
                let (gradient, curvature) = pixel_gradient(learning, at, weights, &ahead);
                for (gaussian, weight) in weights {
                    let sums = &mut gradients[*gaussian];
                    sums.0.iter_mut().zip(&gradient).for_each(|(sum, value)| *sum += weight * value);
                    sums.1 += weight * curvature;
                }
            }
        }
        let momentum = step as f64 / (step as f64 + 3.0);
        for (gaussian, (gradient, curvature)) in gradients.iter().enumerate() {
            let weight_sum = f64::from(active.weight_sums()[gaussian]);
            let along_curvature = 2.0 * magnitude_weight * weight_sum;
            let along = if along_curvature > 0.0 { f64::from(settings.learning_rate) / along_curvature } else { 0.0 };
            let feature = ahead[gaussian].clone();
            let square = dot64(&feature, &feature);
            let is_turned = dim > 1 && square > 1e-12;
            let share = if is_turned { dot64(gradient, &feature) / square } else { 0.0 };
            let across_curvature = curvature + f64::from(settings.direction_weight) * weight_sum;
            let across_curvature = across_curvature.max(f64::from(MIN_CURVATURE_ACROSS) * along_curvature);
            let across = if is_turned { f64::from(settings.direction_learning_rate) / across_curvature } else { along };
            for channel in 0..dim {
                let radial = share * feature[channel];
                let moved = feature[channel] - along * radial - across * (gradient[channel] - radial);
                ahead[gaussian][channel] = moved + momentum * (moved - last[gaussian][channel]);
                last[gaussian][channel] = moved;
            }
        }
    }
    last
}

#[test]
fn features_move_by_the_formulas() {
    let mut random = ChaCha8Rng::seed_from_u64(2);
    // Rows in working memory of 1, 8, 16 and 32 numbers, and of another length.
    let dims = [(1, 0.5), (4, 0.5), (14, 0.01), (28, 0.3), (40, 0.5)];
    let with_usual_weights = dims.map(|(feature_dim, rate)| (feature_dim, rate, (50.0, 1.0)));
    // Only directions, and directions with so little weight that the minimum curvature applies.
    let with_others = [(4, 0.3, (0.0, 1.0)), (4, 0.5, (50.0, 0.01))];
    for (feature_dim, direction_learning_rate, weights) in with_usual_weights.into_iter().chain(with_others) {
        let settings = settings(feature_dim).with(|settings| {
            settings.num_steps = 4;
            settings.direction_learning_rate = direction_learning_rate;
            (settings.magnitude_weight, settings.direction_weight) = weights;
        });
        let (memory, codebook) = (memory(&settings), codebook(&settings));
        let frame = wall(0.1);
        let recall = memory.recall(&frame);
        let target = patchwork(&mut random);
        let learning = Learning { settings: &settings, codebook: &codebook, recall: &recall, target: &target };
        let active = recall.view.active_weights(&learning.active_pixels(&[]), settings.learning_min_weight);
        // Codes scaled to any length, and some zero features.
        let mut features = Vec::new();
        for gaussian in 0..memory.gaussian_count() {
            let length = if gaussian % 37 < 6 { 0.0 } else { random.random_range(0.2..1.2) };
            features.extend(codebook.vector(gaussian / 300 % 4).iter().map(|value| length * value));
        }
        let (start, expected) = (features.clone(), descended(&learning, &active, &features));
        let extent = learning.descend(&active, &mut features);
        assert_eq!(extent.active_gaussians, active.gaussians().len());
        assert_eq!(extent.active_pixels, active.tiles().iter().map(|tile| tile.pixels.len()).sum::<usize>());
        assert!(extent.active_gaussians > 500 && extent.active_gaussians < memory.gaussian_count());
        let mut is_active = vec![false; memory.gaussian_count()];
        for (gaussian, expected) in active.gaussians().iter().zip(&expected) {
            is_active[*gaussian as usize] = true;
            let found = &features[*gaussian as usize * feature_dim..][..feature_dim];
            for (found, expected) in found.iter().zip(expected) {
                let difference = (f64::from(*found) - expected).abs();
                assert!(difference < 1e-3 * (1.0 + expected.abs()), "D = {feature_dim}: {found} instead of {expected}");
            }
        }
        for gaussian in (0..memory.gaussian_count()).filter(|gaussian| !is_active[*gaussian]) {
            let range = gaussian * feature_dim..(gaussian + 1) * feature_dim;
            assert_eq!(features[range.clone()], start[range], "an inactive Gaussian does not change");
        }
    }
}
