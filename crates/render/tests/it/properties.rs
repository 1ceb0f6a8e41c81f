//! The tiled rasteriser against its brute-force twin on random scenes, and gradients against finite differences.

use crate::brute_force;
use glam::{Quat, Vec3};
use proptest::prelude::*;
use splatseg_geometry::{Image, Intrinsics, LocalPose};
use splatseg_render::{ActiveTile, Camera, Gaussians, PixelSet, TileWeights, View};

const SIZE: (usize, usize) = (37, 26);

fn camera() -> Camera {
    let intrinsics = Intrinsics { fx: 30.0, fy: 33.0, cx: 18.2, cy: 12.4, width: SIZE.0, height: SIZE.1 };
    Camera::new(intrinsics, &LocalPose::IDENTITY)
}

prop_compose! {
    fn gaussian()(
        mean in (-3.0f32..3.0, -2.0f32..2.0, -0.5f32..4.0),
        quat in prop::array::uniform4(-1.0f32..1.0).prop_filter("no rotation", |q| q.iter().map(|x| x * x).sum::<f32>() > 0.01),
        scale in prop::array::uniform3(0.005f32..0.4),
        ball in any::<bool>(),
        opacity in 0.0f32..=1.0,
    ) -> (Vec3, Quat, Vec3, f32) {
        let scale = if ball { Vec3::splat(scale[0]) } else { Vec3::from(scale) };
        (Vec3::from(mean), Quat::from_array(quat), scale, opacity)
    }
}

fn scene(entries: &[(Vec3, Quat, Vec3, f32)]) -> Gaussians {
    let mut gaussians = Gaussians::default();
    for (mean, quat, scale, opacity) in entries {
        gaussians.push(*mean, *quat, *scale, *opacity);
    }
    gaussians
}

fn values(count: usize, channels: usize, seed: u32) -> Vec<f32> {
    (0..(count * channels) as u32)
        .map(|i| ((i.wrapping_mul(2_654_435) + seed * 97) % 1000) as f32 / 500.0 - 1.0)
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn tiles_equal_brute_force(entries in prop::collection::vec(gaussian(), 1..60), channels in 1usize..30) {
        let gaussians = scene(&entries);
        let view = View::new(&gaussians, &camera());
        let twin = brute_force::blend_weights(&gaussians, &camera());
        let values = values(gaussians.len(), channels, 1);
        let image = view.weights().render(&values, channels);
        for pixel in (0..SIZE.0 * SIZE.1).filter(|pixel| !twin.fragile[*pixel]) {
            for channel in 0..channels {
                let expected: f64 = twin.weights[pixel].iter().enumerate()
                    .map(|(gaussian, weight)| weight * f64::from(values[gaussian * channels + channel])).sum();
                let found = f64::from(image[pixel * channels + channel]);
                prop_assert!((found - expected).abs() < 5e-5, "pixel {pixel}: {found} instead of {expected}");
            }
        }
    }

    #[test]
    fn gradients_equal_finite_differences(entries in prop::collection::vec(gaussian(), 1..25), channels in 1usize..9) {
        // loss = sum of weight * value^2 / 2 over the image, so its gradient with respect to the image is not constant.
        let gaussians = scene(&entries);
        let view = View::new(&gaussians, &camera());
        let weights = view.weights();
        let values = values(gaussians.len(), channels, 2);
        let factors = self::values(SIZE.0 * SIZE.1, channels, 3);
        let loss = |values: &[f32]| -> f64 {
            weights.render(values, channels).iter().zip(&factors)
                .map(|(value, factor)| f64::from(*factor) * f64::from(*value).powi(2) / 2.0).sum()
        };
        let image_gradient: Vec<f32> =
            weights.render(&values, channels).iter().zip(&factors).map(|(value, factor)| value * factor).collect();
        let gradient = weights.gradient(&image_gradient, channels, gaussians.len());
        for entry in (0..values.len()).step_by(values.len().div_ceil(12)) {
            let step = 0.05;
            let (mut above, mut below) = (values.clone(), values.clone());
            above[entry] += step;
            below[entry] -= step;
            // Central differences are exact for a quadratic loss.
            let numeric = (loss(&above) - loss(&below)) / f64::from(above[entry] - below[entry]);
            let found = f64::from(gradient[entry]);
            prop_assert!((found - numeric).abs() < 2e-3 * (1.0 + numeric.abs()), "{found} instead of {numeric}");
        }
    }

    #[test]
    fn untouched_pixels_keep_their_weights(entries in prop::collection::vec(gaussian(), 2..40), added in prop::collection::vec(gaussian(), 1..4)) {
        let before = scene(&entries);
        let all = scene(&[entries.clone(), added].concat());
        let view = View::new(&before, &camera());
        let everywhere = Image::filled(SIZE.0, SIZE.1, f32::INFINITY);
        let touched = view.pixels_touched_since(&all, &everywhere, camera().limits.min_alpha);
        let values = values(all.len(), 2, 6);
        let (old, new) = (view.weights().render(&values, 2), View::new(&all, &camera()).weights().render(&values, 2));
        for (index, (old, new)) in old.iter().zip(&new).enumerate() {
            let (column, row) = (index / 2 % SIZE.0, index / 2 / SIZE.0);
            let tile = row / 16 * SIZE.0.div_ceil(16) + column / 16;
            prop_assert!(old == new || touched[tile].contains((row % 16 * 16 + column % 16) as u8));
        }
    }

    #[test]
    fn threads_change_nothing(entries in prop::collection::vec(gaussian(), 1..60)) {
        let gaussians = scene(&entries);
        let run = |threads: usize| {
            rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
                let view = View::new(&gaussians, &camera());
                let image = view.weights().render(&values(gaussians.len(), 5, 4), 5);
                let gradient = view.weights().gradient(&image, 5, gaussians.len());
                (view.weights().clone(), image, gradient)
            })
        };
        prop_assert!(run(1) == run(4));
    }
}

#[test]
fn nonsense_gaussians_are_left_out() {
    let mut gaussians = Gaussians::default();
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        gaussians.push(Vec3::new(bad, 0.0, 1.0), Quat::IDENTITY, Vec3::splat(0.1), 1.0);
        gaussians.push(Vec3::new(0.0, 0.0, bad), Quat::IDENTITY, Vec3::splat(0.1), 1.0);
        gaussians.push(Vec3::Z, Quat::IDENTITY, Vec3::splat(bad), 1.0);
        gaussians.push(Vec3::Z, Quat::IDENTITY, Vec3::splat(0.1), bad);
        gaussians.push(Vec3::Z, Quat::from_xyzw(bad, 0.0, 0.0, 1.0), Vec3::new(0.1, 0.2, 0.3), 1.0);
    }
    gaussians.push(Vec3::Z, Quat::from_xyzw(0.0, 0.0, 0.0, 0.0), Vec3::new(0.1, 0.2, 0.3), 1.0);
    let view = View::new(&gaussians, &camera());
    assert!(view.weights().silhouette().pixels().iter().all(|alpha| alpha.is_finite()));
    assert!(view.weights().render(&vec![1.0; gaussians.len()], 1).iter().all(|value| value.is_finite()));
}

#[test]
fn no_gaussians_make_an_empty_image() {
    let view = View::new(&Gaussians::default(), &camera());
    assert_eq!(view.weights().non_zeros(), 0);
    assert!(view.weights().render(&[], 3).iter().all(|value| *value == 0.0));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(30))]

    #[test]
    fn restricted_weights_give_the_same_products(entries in prop::collection::vec(gaussian(), 1..60), stride in 1usize..7) {
        let gaussians = scene(&entries);
        let view = View::new(&gaussians, &camera());
        let chosen = |index: usize| index.is_multiple_of(stride);
        let sets: Vec<PixelSet> = view.weights().tiles().iter().map(|tile| {
            let mut set = PixelSet::default();
            for row in 0..tile.size().1 {
                for column in 0..tile.size().0 {
                    if chosen((tile.origin().1 + row) * SIZE.0 + tile.origin().0 + column) {
                        set.insert((row * 16 + column) as u8);
                    }
                }
            }
            set
        }).collect();
        let active = view.active_weights(&sets, 0.0);

        // Wᵀ g with g zero at the other pixels.
        let mut gradient_image = values(SIZE.0 * SIZE.1, 3, 5);
        for (index, gradient) in gradient_image.chunks_exact_mut(3).enumerate() {
            if !chosen(index) {
                gradient.fill(0.0);
            }
        }
        let expected = view.weights().gradient(&gradient_image, 3, gaussians.len());
        let mut partial = Vec::new();
        for tile in active.tiles() {
            let (left, top) = tile.weights.origin();
            let mut pixels = vec![0.0; TileWeights::PIXELS * 3];
            for row in 0..tile.weights.size().1 {
                for column in 0..tile.weights.size().0 {
                    let from = ((top + row) * SIZE.0 + left + column) * 3;
                    pixels[(row * 16 + column) * 3..][..3].copy_from_slice(&gradient_image[from..from + 3]);
                }
            }
            let mut columns = vec![0.0; tile.weights.gaussians().len() * 3];
            tile.weights.project_back(&pixels, 3, &mut columns);
            partial.extend(columns);
            prop_assert!(rows_equal_columns(tile, &values(active.gaussians().len(), 8, 7)));
        }
        prop_assert_eq!(partial.len(), active.column_count() * 3);
        let total = view.weights().gradient(&vec![1.0; SIZE.0 * SIZE.1], 1, gaussians.len());
        for (number, gaussian) in active.gaussians().iter().enumerate() {
            prop_assert!((active.weight_sums()[number] - total[*gaussian as usize]).abs() < 1e-4);
            for channel in 0..3 {
                let found: f32 = active.columns_of(number).iter().map(|c| partial[*c as usize * 3 + channel]).sum();
                prop_assert!((found - expected[*gaussian as usize * 3 + channel]).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn runs_hold_the_weights_of_pixels_inside_the_image(entries in prop::collection::vec(gaussian(), 1..60)) {
        let view = View::new(&scene(&entries), &camera());
        let mut found = 0;
        for tile in view.weights().tiles() {
            for column in 0..tile.gaussians().len() {
                let (firsts, weights) = tile.runs(column);
                prop_assert_eq!(firsts.len(), weights.len());
                prop_assert!(!firsts.is_empty() && firsts.is_sorted_by(|one, next| one < next));
                let mut of_runs = Vec::new();
                for (first, weights) in firsts.iter().zip(weights) {
                    let (row, start) = (usize::from(*first) / TileWeights::SIDE, usize::from(*first) % TileWeights::SIDE);
                    prop_assert!(start + TileWeights::RUN <= TileWeights::SIDE, "a run in one row");
                    prop_assert!(weights.iter().any(|weight| *weight > 0.0));
                    for (lane, weight) in weights.iter().enumerate().filter(|(_, weight)| **weight != 0.0) {
                        prop_assert!(start + lane < tile.size().0 && row < tile.size().1 && *weight > 0.0);
                        of_runs.push((first + lane as u8, *weight));
                    }
                }
                prop_assert_eq!(&of_runs, &tile.column(column).collect::<Vec<_>>());
                found += of_runs.len();
            }
        }
        prop_assert_eq!(found, view.weights().non_zeros());
    }
}

/// True if rendering a tile pixel by pixel and Gaussian by Gaussian gives the same bits.
fn rows_equal_columns(tile: &ActiveTile, values: &[f32]) -> bool {
    let mut by_column = vec![0.0; TileWeights::PIXELS * 8];
    let mut by_row = vec![f32::NAN; TileWeights::PIXELS * 8];
    tile.weights.accumulate(values, 8, &mut by_column);
    tile.render(values, 8, &mut by_row);
    by_column == by_row
}
