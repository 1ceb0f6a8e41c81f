//! Growth of the map.

use super::run::{Run, agreement, evidence, features};
use super::scene::{SIZE, Scene, Solid, WALL, pose};
use glam::Vec3;
use splatseg_memory::GrowthRule;

/// Box 3 without a table, its front `distance` in front of the wall.
fn box_before_wall(distance: f32) -> Solid {
    Solid::new(3, [0.0, 0.0, 3.2 - distance], [0.6, 0.6, 0.4])
}

#[test]
fn the_map_grows_where_nothing_covers() {
    let scene = Scene::wall();
    let mut run = Run::new(evidence());
    let first = run.show(&scene.seen_from_origin());
    assert_eq!(first.update.grown, run.memory.gaussian_count());
    // A view 3 m away is 3.6 m wide.
    let right_edge = run.means().iter().map(|mean| mean.x).fold(f32::MIN, f32::max);
    assert!((1.6..1.9).contains(&right_edge), "{right_edge} m");

    let second = run.show(&scene.seen_from(pose([1.0, 0.0, 0.0], 0.0)));
    assert!(second.update.grown * 2 < first.update.grown, "only the new strip: {}", second.update.grown);
    let added = &run.means()[first.update.grown..];
    let leftmost = added.iter().map(|mean| mean.x).fold(f32::MAX, f32::min);
    assert!(leftmost > right_edge - 0.05, "none where the wall was known: {leftmost} m");
    assert!(added.iter().any(|mean| mean.x > right_edge + 0.8), "up to the new edge");
}

#[test]
fn a_surface_clearly_in_front_is_added() {
    let mut run = Run::new(evidence());
    run.show(&Scene::wall().seen_from_origin());
    let known = run.memory.gaussian_count();
    let solid = box_before_wall(0.3);
    let step = run.show(&Scene::wall().with(solid).seen_from_origin());
    assert!(step.update.grown > 0);
    let added = &run.means()[known..];
    assert!(added.iter().all(|mean| solid.contains(*mean, 0.01)), "only the box");
}

#[test]
fn a_surface_within_the_depth_disparity_is_not_new() {
    let mut run = Run::new(evidence());
    run.show(&Scene::wall().seen_from_origin());
    let step = run.show(&Scene::wall().with(box_before_wall(0.1)).seen_from_origin());
    assert_eq!(step.update.grown, 0);
}

#[test]
fn a_box_that_disappears_reveals_a_known_wall() {
    let (without, with) = (Scene::wall(), Scene::wall().with(box_before_wall(0.8)));
    let mut run = Run::new(evidence());
    run.show(&without.seen_from_origin());
    run.show_times(&with.seen_from_origin(), 3);
    for (frame, step) in run.show_times(&without.seen_from_origin(), 10).iter().enumerate() {
        assert_eq!(step.update.grown, 0, "frame {frame} without the box");
    }
}

#[test]
fn only_the_papers_rule_adds_a_farther_surface() {
    for (growth, expected) in [(GrowthRule::Missing, 0), (GrowthRule::Paper, 96 * 72)] {
        let mut run = Run::new(evidence().with(|settings| {
            settings.growth = growth;
            settings.removal_frames = 0;
        }));
        let near = Scene::wall().seen_from_origin();
        run.show(&near);
        let mut far = near.clone();
        far.depth.pixels_mut().fill(3.5);
        assert_eq!(run.show(&far).update.grown, expected, "{growth:?}");
    }
}

#[test]
fn a_mixed_pixel_gets_no_gaussian() {
    let scene = Scene::wall().with(box_before_wall(1.0));
    let mut shot = scene.seen_from_origin();
    let front = shot.truth.clone();
    for row in 0..front.height() {
        for column in 1..front.width() - 1 {
            if front[(column, row)] == 3 && front[(column - 1, row)] == 1 {
                shot.depth[(column, row)] = 2.5;
            }
        }
    }
    assert!(shot.depth.pixels().iter().filter(|depth| **depth == 2.5).count() > 20);
    let mut run = Run::new(evidence());
    run.show_times(&shot, 3);
    let mixed = run.means().iter().filter(|mean| mean.z > 2.05 && mean.z < 2.95 && mean.x < 0.0).count();
    assert_eq!(mixed, 0, "every Gaussian lies on a surface");
}

#[test]
fn the_papers_rule_adds_where_depths_differ_in_either_direction() {
    let grown = |second: &Scene| {
        let mut run = Run::new(features());
        run.show(&Scene::wall().seen_from_origin());
        run.show(&second.seen_from_origin()).update.grown
    };
    let moved = |by: f32| Scene(vec![Scene::wall().solid(WALL).moved(Vec3::new(0.0, 0.0, by))]);
    let pixels = SIZE.0 * SIZE.1;
    for near in [-0.14, 0.0, 0.14] {
        assert_eq!(grown(&moved(near)), 0, "{near} m");
    }
    for far in [-0.16, 0.16, 1.0] {
        assert_eq!(grown(&moved(far)), pixels, "{far} m: in front and behind");
    }
}

/// Numbers of Gaussians that two equal views of the wall add by the paper's rule.
fn grown_by_paper(growth_silhouette: f32, depth_disparity: f32) -> [usize; 2] {
    let mut run = Run::new(features().with(|settings| {
        settings.growth_silhouette = growth_silhouette;
        settings.depth_disparity = depth_disparity;
    }));
    let shot = Scene::wall().seen_from_origin();
    [run.show(&shot).update.grown, run.show(&shot).update.grown]
}

#[test]
fn the_papers_rule_adds_where_too_little_covers_whatever_the_depth() {
    let pixels = SIZE.0 * SIZE.1;
    // No disparity is that large, so coverage alone decides. Nothing is below 0, everything below 1.
    assert_eq!(grown_by_paper(0.0, 1000.0), [0, 0]);
    assert_eq!(grown_by_paper(0.5, 1000.0), [pixels, 0]);
    assert_eq!(grown_by_paper(1.0, 1000.0), [pixels, pixels]);
}

#[test]
fn the_papers_rule_adds_where_depths_differ_by_more_than_the_disparity_whatever_covers() {
    let shot = Scene::wall().seen_from_origin();
    let farthest = shot.frame().depth().pixels().iter().copied().fold(0.0, f32::max);
    let pixels = SIZE.0 * SIZE.1;
    // An empty map has depth 0.
    assert_eq!(grown_by_paper(0.0, farthest), [0, 0]);
    assert_eq!(grown_by_paper(0.0, 0.9 * farthest), [pixels, 0]);
}

#[test]
fn gaussians_of_the_papers_rule_show_the_segments_of_their_pixels_at_once() {
    let shot = Scene::boxes().seen_from_origin();
    let mut run = Run::new(features().with(|settings| settings.num_steps = 0));
    run.show(&shot);
    let shown = agreement(&run.expected(&shot), &shot.truth);
    // The rest is at borders, where Gaussians of both sides overlap.
    assert!(shown > 0.9, "{shown}");
}
