//! Density of the map.

use super::run::{Run, evidence};
use super::scene::{SIZE, Scene, Shot};
use splatseg_geometry::{Image, RgbdFrame, SegmentMap};
use std::collections::{BTreeMap, BTreeSet};

/// A wall with the border of two segments in the middle of the view.
fn halves() -> (Shot, SegmentMap) {
    let shot = Scene::wall().seen_from_origin();
    let predicted = SegmentMap::from_fn(SIZE.0, SIZE.1, |column, _| if column < SIZE.0 / 2 { 1 } else { 2 });
    (shot, predicted)
}

/// Radius of a Gaussian, in the spacing of the pixels that it stands for.
const RADIUS_PER_SPACING: f32 = 0.6;

#[test]
fn gaussians_are_coarse_inside_a_segment_and_fine_at_its_border() {
    let (shot, predicted) = halves();
    let settings = evidence().with(|settings| settings.growth_spacing = 4);
    let mut run = Run::new(settings.clone());
    run.show_as(&shot, &predicted);
    let map = run.memory.map();
    // A pixel is 3.75 cm wide on the wall. The border is at x = 0.
    let pixel = 3.0 / 80.0;
    let radii = |from: f32, to: f32| {
        let radii = map.means.iter().zip(map.radii);
        let radii = radii.filter(move |(mean, _)| (from * pixel..to * pixel).contains(&mean.x.abs()));
        radii.map(|(_, radius)| *radius).collect::<Vec<f32>>()
    };
    let (border, inside) = (radii(0.0, 1.0), radii(16.0, 48.0));
    let (width, radius) = (settings.growth_spacing as f32, RADIUS_PER_SPACING * pixel);
    assert_eq!(border.len(), 2 * SIZE.1, "one per pixel beside the border");
    assert!(border.iter().all(|found| (found - radius).abs() < 1e-4));
    assert_eq!(inside.len(), 2 * 32 * SIZE.1 / 16, "one per 4x4 pixels");
    assert!(inside.iter().all(|found| (found - width * radius).abs() < 1e-4));
}

#[test]
fn a_flat_segment_needs_few_gaussians() {
    let shot = Scene::wall().seen_from_origin();
    let count = |growth_spacing| {
        let mut run = Run::new(evidence().with(|settings| settings.growth_spacing = growth_spacing));
        run.show(&shot);
        run.memory.gaussian_count()
    };
    let pixels = SIZE.0 * SIZE.1;
    assert_eq!([1, 2, 4, 8].map(count), [pixels, pixels / 4, pixels / 16, pixels / 64]);
}

/// Shows a wall whose depth is known where `is_known` returns true for the column and row in each block of 4x4 pixels.
/// Returns the number of Gaussians for each side length in pixels.
fn sides_of_gaussians(is_known: fn(usize, usize) -> bool) -> BTreeMap<usize, usize> {
    let mut shot = Scene::wall().seen_from_origin();
    let depth = shot.depth.clone();
    shot.depth = Image::from_fn(
        SIZE.0,
        SIZE.1,
        |column, row| {
            if is_known(column % 4, row % 4) { depth[(column, row)] } else { 0.0 }
        },
    );
    let settings = evidence().with(|settings| settings.growth_spacing = 4);
    let mut run = Run::new(settings.clone());
    // Without predictions, depth is not completed.
    run.show_as(&shot, &shot.truth.map(|_| 0));
    let one_pixel = RADIUS_PER_SPACING * 3.0 / 80.0;
    let mut sides = BTreeMap::new();
    for radius in run.memory.map().radii {
        *sides.entry((radius / one_pixel).round() as usize).or_insert(0) += 1;
    }
    sides
}

#[test]
fn a_gaussian_stands_for_a_block_if_at_least_half_is_missing() {
    let blocks = SIZE.0 * SIZE.1 / 16;
    let all = |side, per_block: usize| BTreeMap::from([(side, per_block * blocks)]);
    assert_eq!(sides_of_gaussians(|column, _| column < 2), all(4, 1), "8 of 16");
    assert_eq!(sides_of_gaussians(|column, row| column < 2 && (column, row) != (0, 0)), all(2, 2), "7 of 16");
    assert_eq!(sides_of_gaussians(|column, row| column < 2 && row < 2), all(2, 1), "4 of 16, a quarter");
    assert_eq!(sides_of_gaussians(|column, row| column == 3 && row == 3), all(1, 1), "1 of 16");
}

#[test]
fn a_gaussian_has_the_mean_color_and_place_of_its_block() {
    let shot = Scene::wall().seen_from_origin();
    let color = Image::from_fn(SIZE.0, SIZE.1, |column, row| match (column % 2, row % 2) {
        (0, _) => [10, 100, 200],
        (_, 0) => [30, 110, 200],
        _ => [50, 190, 200],
    });
    let frame = RgbdFrame::new("0", color, shot.depth.clone(), shot.intrinsics, shot.pose).unwrap();
    let mut run = Run::new(evidence());
    run.memory.new_segment().unwrap();
    let recall = run.memory.recall(&frame);
    run.memory.update(recall, &shot.truth, &BTreeSet::new()).unwrap();
    let colors = run.memory.map().colors;
    assert_eq!(colors.len(), SIZE.0 * SIZE.1 / 64);
    for (mean, color) in run.means().iter().zip(colors) {
        let column = mean.x / 3.0 * 80.0 + 0.5 * (SIZE.0 - 1) as f32;
        assert!((column % 8.0 - 3.5).abs() < 1e-3, "in the middle of a block: column {column}");
        assert_eq!(*color, [25, 125, 200]);
    }
}

#[test]
fn a_scene_of_boxes_needs_less_than_one_gaussian_per_two_pixels() {
    let mut run = Run::new(evidence());
    run.show(&Scene::boxes().seen_from_origin());
    let pixels = SIZE.0 * SIZE.1;
    assert!(run.memory.gaussian_count() * 2 < pixels, "{} for {pixels} pixels", run.memory.gaussian_count());
}

#[test]
fn every_pixel_with_depth_is_covered_afterwards() {
    let (wall, halves) = halves();
    let boxes = Scene::boxes().seen_from_origin();
    for growth_spacing in [1, 2, 4, 8] {
        for (shot, predicted) in [(&wall, &wall.truth), (&wall, &halves), (&boxes, &boxes.truth)] {
            let mut run = Run::new(evidence().with(|settings| settings.growth_spacing = growth_spacing));
            run.show_as(shot, predicted);
            let frame = shot.frame();
            let recall = run.memory.recall(&frame);
            let least = recall.silhouette().pixels().iter().fold(1.0f32, |least, value| least.min(*value));
            assert!(least >= 0.5, "spacing {growth_spacing}: {least}");
        }
    }
}
