//! How dense the map is.

use crate::run::{Run, evidence};
use crate::scene::{SIZE, Scene, Shot};
use splatseg_geometry::SegmentMap;

/// A wall, with the border of two segments in the middle of the view.
fn halves() -> (Shot, SegmentMap) {
    let shot = Scene::wall().seen_from_origin();
    let seen = SegmentMap::from_fn(SIZE.0, SIZE.1, |column, _| if column < SIZE.0 / 2 { 1 } else { 2 });
    (shot, seen)
}

#[test]
fn gaussians_are_coarse_inside_a_segment_and_fine_at_its_border() {
    let (shot, seen) = halves();
    let settings = evidence().with(|settings| settings.growth_spacing = 4);
    let mut run = Run::new(settings.clone());
    run.show_as(&shot, &seen);
    let balls = run.memory.balls();
    // A pixel is 3.75 cm wide on the wall. The border is at x = 0.
    let pixel = 3.0 / 80.0;
    let radii = |from: f32, to: f32| {
        let radii = balls.means.iter().zip(&balls.radii);
        let radii = radii.filter(move |(mean, _)| (from * pixel..to * pixel).contains(&mean.x.abs()));
        radii.map(|(_, radius)| *radius).collect::<Vec<f32>>()
    };
    let (border, inside) = (radii(0.0, 1.0), radii(16.0, 48.0));
    let (width, radius) = (settings.growth_spacing as f32, settings.radius_per_spacing * pixel);
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
        for (shot, seen) in [(&wall, &wall.truth), (&wall, &halves), (&boxes, &boxes.truth)] {
            let mut run = Run::new(evidence().with(|settings| settings.growth_spacing = growth_spacing));
            run.show_as(shot, seen);
            let frame = shot.frame();
            let recall = run.memory.recall(&frame);
            let least = recall.silhouette().pixels().iter().fold(1.0f32, |least, value| least.min(*value));
            assert!(least >= 0.5, "spacing {growth_spacing}: {least}");
        }
    }
}
