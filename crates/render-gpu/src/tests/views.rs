//! Sights, projection, tiles, blending, votes and growth of a made-up map.

use super::{device, noise};
use crate::GpuDevice;
use crate::device::{cube_dim, cubes, threads};
use crate::evidence::Evidence;
use crate::gaussians::DeviceGaussians;
use crate::kernels::camera::view_args;
use crate::kernels::forget::{HIDDEN, NOWHERE, locate_seen};
use crate::kernels::project::NUMBERS;
use crate::kernels::sight::{PAIR_COUNT, SEEN, SEEN_COUNT, THROUGH, THROUGH_COUNT, UNKNOWN, VISIBLE_COUNT};
use crate::kernels::vote::{LABELS, PairVotesLaunch, count_votes};
use crate::store::DeviceStore;
use crate::view::{bin, look, render, tile_count};
use glam::{DVec3, Mat4, Vec3};
use splatseg_geometry::{Image, Intrinsics, Pose, RgbdFrame, SegmentMap};
use splatseg_memory::{FrameTrust, MemorySettings, SplatMap, Votes};
use splatseg_render::{Balls, Camera, RasterLimits, View, project};

const SIZE: (usize, usize) = (75, 52);

/// Numbers from 0 to 1 that look random.
fn fractions(seed: u32) -> impl Iterator<Item = f32> {
    noise(seed).map(|value| (value & 0xffff) as f32 / 65_536.0)
}

/// Balls in and around the view of a camera, some on one another, and votes for six segments.
fn made_up_map(count: usize) -> (SplatMap, Vec<Votes>) {
    let mut map = SplatMap::default();
    let mut numbers = fractions(7);
    let mut next = || numbers.next().unwrap_or(0.0);
    let mut votes = Vec::new();
    for index in 0..count {
        // Every eighth has the depth of the one before.
        let z = match map.balls.means.last() {
            Some(last) if index % 8 == 7 => last.z,
            _ => 3.5 * next() - 0.3,
        };
        map.balls.push(Vec3::new(4.0 * next() - 2.0, 3.0 * next() - 1.5, z), 0.005 + 0.06 * next());
        map.colors.push([index as u8; 3]);
        map.last_seen.push(0);
        map.seen_through.push(0);
        let mut own = Votes::one((6.0 * next()) as u32, 0.2 + next());
        own.add((6.0 * next()) as u32, next());
        votes.push(own);
    }
    (map, votes)
}

fn frame() -> RgbdFrame<'static> {
    let (width, height) = SIZE;
    let camera = Intrinsics { fx: 61.0, fy: 60.0, cx: 36.2, cy: 26.4, width, height };
    let depth = Image::from_fn(width, height, |column, row| match (column / 6 + row / 9) % 5 {
        0 => 0.0,
        1 => 2.5,
        _ => 1.2 + 0.01 * column as f32,
    });
    let color = Image::from_fn(width, height, |column, row| [column as u8, row as u8, 7]);
    let rotation = Mat4::from_rotation_y(0.1) * Mat4::from_rotation_x(-0.05);
    let pose = Pose::from_matrix((Mat4::from_translation(Vec3::new(0.1, -0.05, 0.02)) * rotation).as_dmat4()).unwrap();
    RgbdFrame::new("0", color, depth, camera, pose).unwrap()
}

fn camera(frame: &RgbdFrame<'_>) -> Camera {
    let camera = Camera::new(*frame.intrinsics(), &frame.world_from_camera().relative_to(DVec3::ZERO));
    let limits = RasterLimits { min_alpha: 0.02, max_alpha: 0.98, min_transmittance: 0.01, ..camera.limits };
    Camera { limits, ..camera }
}

/// The map on the device; nothing is hidden because it is seen through.
fn on(device: &GpuDevice) -> (SplatMap, Vec<Votes>, DeviceGaussians, MemorySettings) {
    let (map, votes) = made_up_map(3000);
    let gaussians = DeviceGaussians::new(device, &map, Evidence::columns(&votes)).unwrap();
    (map, votes, gaussians, MemorySettings::default().with(|settings| settings.removal_frames = 0))
}

fn evidence(settings: &MemorySettings) -> Evidence {
    Evidence { settings: settings.clone() }
}

#[test]
fn maps_come_back_as_they_were_sent() {
    let Some(device) = device() else { return };
    for count in [0, 1, 3000] {
        let (map, votes) = made_up_map(count);
        let found = DeviceGaussians::new(&device, &map, Evidence::columns(&votes)).unwrap();
        assert!(found.read().unwrap() == map);
        assert!(evidence(&MemorySettings::default()).read(&device, &found).unwrap() == votes);
    }
}

#[test]
fn sights_are_those_of_the_definition() {
    let Some(device) = device() else { return };
    let (map, _, gaussians, settings) = on(&device);
    let (frame, camera) = (frame(), camera(&frame()));
    let depth = device.upload(frame.depth().pixels(), "test").unwrap();
    let found = look(&device, &gaussians, &depth, &camera, FrameTrust::Alone, &settings).unwrap();
    let [sights, counters] = device.download([&found.sights, &found.counters]).unwrap();
    let expected = map.balls.means.iter().map(|mean| {
        let center = camera.to_camera(*mean);
        let Some(pixel) = frame.intrinsics().project(center) else { return UNKNOWN };
        let (column, row) = (pixel.x.round(), pixel.y.round());
        if column < 1.0 || row < 1.0 || column + 2.0 > SIZE.0 as f32 || row + 2.0 > SIZE.1 as f32 {
            return UNKNOWN;
        }
        let margin = settings.removal_margin.max(settings.removal_margin_relative * center.z);
        let around = (0..9).map(|at| frame.depth()[(column as usize + at % 3 - 1, row as usize + at / 3 - 1)]);
        let around: Vec<f32> = around.collect();
        if around.iter().all(|observed| *observed > center.z + margin) {
            return THROUGH;
        }
        let is_seen = around.iter().any(|observed| *observed > 0.0 && (observed - center.z).abs() <= margin);
        if is_seen { SEEN } else { UNKNOWN }
    });
    let expected: Vec<u32> = expected.collect();
    assert!(sights == expected);
    let count = |kind| expected.iter().filter(|sight| **sight == kind).count() as u32;
    assert_eq!((counters[SEEN_COUNT], counters[THROUGH_COUNT]), (count(SEEN), count(THROUGH)));
    assert!(count(SEEN) > 20 && count(THROUGH) > 20, "{} {}", count(SEEN), count(THROUGH));
}

#[test]
fn projected_gaussians_and_their_order_are_those_of_the_cpu() {
    let Some(device) = device() else { return };
    let (map, _, gaussians, settings) = on(&device);
    let (frame, camera) = (frame(), camera(&frame()));
    let depth = device.upload(frame.depth().pixels(), "test").unwrap();
    let sights = look(&device, &gaussians, &depth, &camera, FrameTrust::Alone, &settings).unwrap();
    let tiles = bin(&device, &gaussians, &sights, &camera).unwrap();
    let [splats, indices, order, counters] =
        device.download([&tiles.splats, &tiles.gaussians, &tiles.order, &sights.counters]).unwrap();
    let expected = project(&map.balls, 0, &camera);
    assert_eq!(counters[VISIBLE_COUNT] as usize, expected.len());
    assert!(expected.len() > 500);
    for ((splat, index), expected) in splats.chunks_exact(NUMBERS).zip(indices).zip(&expected) {
        assert_eq!(index, expected.gaussian);
        let (mean, [a, b, c], half) = (expected.mean, expected.conic, expected.half_extent);
        for (found, expected) in splat.iter().zip([mean.x, mean.y, a, b, c, expected.depth, half.x, half.y]) {
            let found = f32::from_bits(*found);
            assert!((found - expected).abs() <= 1e-5 * expected.abs().max(1.0), "{found} instead of {expected}");
        }
    }
    let mut sorted: Vec<u32> = (0..expected.len() as u32).collect();
    sorted.sort_by(|one, other| expected[*one as usize].depth.total_cmp(&expected[*other as usize].depth));
    assert!(order == sorted);
    // Each tile has the Gaussians whose boxes touch it, front to back.
    let [begins, ends, pairs, of_pair] =
        device.download([&tiles.begins, &tiles.ends, &tiles.pairs, &tiles.splat_of_pair]).unwrap();
    let columns = SIZE.0.div_ceil(16);
    for tile in 0..tile_count(&camera) {
        let found: Vec<u32> = (begins[tile]..ends[tile]).map(|place| of_pair[pairs[place as usize] as usize]).collect();
        let touches = |center: f32, half: f32, tile: usize, tiles: usize| {
            let of = |pixel: f32| ((pixel.max(0.0) as usize) / 16).min(tiles - 1);
            (of(center - half)..=of(center + half)).contains(&tile)
        };
        let is_here = |splat: &&u32| {
            let splat = &expected[**splat as usize];
            touches(splat.mean.x, splat.half_extent.x, tile % columns, columns)
                && touches(splat.mean.y, splat.half_extent.y, tile / columns, SIZE.1.div_ceil(16))
        };
        let here: Vec<u32> = sorted.iter().filter(is_here).copied().collect();
        assert!(found == here, "tile {tile}");
    }
    assert_eq!(counters[PAIR_COUNT], ends[tile_count(&camera) - 1]);
}

#[test]
fn images_are_products_with_the_blend_weights_of_the_cpu() {
    let Some(device) = device() else { return };
    let (map, votes, gaussians, settings) = on(&device);
    let (frame, camera) = (frame(), camera(&frame()));
    let store = evidence(&settings);
    let (rendered, images) =
        render(&device, &gaussians, &store, &frame, &camera, FrameTrust::Alone, &settings).unwrap();
    let view = &rendered.view;
    let host = View::new(&map.balls, &camera);
    let (silhouette, depth) = (host.weights().silhouette(), host.weights().accumulated_depth());
    let surfaces = silhouette.pixels().iter().zip(depth.pixels()).enumerate();
    for (pixel, (silhouette, depth)) in surfaces {
        let depth = if *silhouette > 0.0 { depth / silhouette } else { 0.0 };
        assert!((images.silhouette.pixels()[pixel] - silhouette).abs() <= 1e-5);
        assert!((images.depth.pixels()[pixel] - depth).abs() <= 1e-4);
    }
    // Where nothing is observed everything counts whose weight is not negligible.
    let kept = |weight: f32| if weight >= settings.min_weight { weight } else { 0.0 };
    let mut evidence = vec![[0.0f32; 6]; SIZE.0 * SIZE.1];
    for tile in host.weights().tiles() {
        let (left, top) = tile.origin();
        for (column, gaussian) in tile.gaussians().iter().enumerate() {
            for (pixel, weight) in tile.column(column) {
                let at = (top + usize::from(pixel) / 16) * SIZE.0 + left + usize::from(pixel) % 16;
                for (id, count) in votes[*gaussian as usize].iter() {
                    evidence[at][id as usize] += kept(weight) * count;
                }
            }
        }
    }
    let (mut compared, mut wrong) = (0, 0);
    for (at, evidence) in evidence.iter().enumerate().filter(|(at, _)| frame.depth().pixels()[*at] == 0.0) {
        let best = (0..6).max_by(|one, other| evidence[*one].total_cmp(&evidence[*other]).then(other.cmp(one)));
        let best = best.filter(|id| evidence[*id] > settings.min_evidence && silhouette.pixels()[at] > 0.5);
        compared += usize::from(best.is_some_and(|id| id != 0));
        wrong += usize::from(images.belief.segments.pixels()[at] != best.unwrap_or(0) as u32);
    }
    assert!(compared > 100 && wrong <= 1, "{wrong} of {compared}");
    check_votes(&device, &host, view, &frame);
}

/// Compares the votes that the view gives with sums over the columns of the CPU's weights.
fn check_votes(device: &GpuDevice, host: &View, view: &crate::view::GpuView, frame: &RgbdFrame<'_>) {
    let labels = SegmentMap::from_fn(SIZE.0, SIZE.1, |column, row| ((column / 5 + row / 3) % 3) as u32);
    // So far apart may depths be that all pixels count.
    let tolerance = 1000.0;
    let (tiles, sent) = (&view.tiles, view.send_seen(device, &labels).unwrap());
    let totals = device.zeros(tiles.pair_count, "test").unwrap();
    let ids = device.zeros(tiles.pair_count * LABELS, "test").unwrap();
    let weights = device.zeros(tiles.pair_count * LABELS, "test").unwrap();
    count_votes::launch(
        &device.client,
        cubes(tile_count(&view.camera)),
        cube_dim(),
        tiles.pairs(),
        sent.arg(),
        view.depth.arg(),
        PairVotesLaunch::new(totals.arg(), ids.arg(), weights.arg()),
        view.args(),
        tolerance,
    );
    let read = [&ids, &weights, &tiles.splat_of_pair, &tiles.gaussians];
    let [ids, weights, of_pair, gaussians] = device.download(read).unwrap();
    let count = host.projected().last().map_or(0, |last| last.gaussian as usize + 1);
    let mut found = vec![[0.0f32; 3]; count];
    for (slot, (id, weight)) in ids.iter().zip(weights).enumerate().take(tiles.pair_count * LABELS) {
        found[gaussians[of_pair[slot / LABELS] as usize] as usize][*id as usize] += f32::from_bits(weight);
    }
    let one_hot: Vec<f32> =
        labels.pixels().iter().flat_map(|label| [0, 1, 2].map(|id| f32::from(u8::from(id == *label)))).collect();
    let expected = host.weights().gradient(&one_hot, 3, count);
    let most = expected.iter().fold(0.0f32, |most, weight| most.max(*weight));
    assert!(most > 1.0 && frame.width() == SIZE.0);
    for (found, expected) in found.as_flattened().iter().zip(expected) {
        assert!((found - expected).abs() <= 1e-4 * expected.max(1.0), "{found} instead of {expected}");
    }
}

#[test]
fn seen_gaussians_are_found_in_their_pixels() {
    let Some(device) = device() else { return };
    let (map, _, gaussians, settings) = on(&device);
    let (frame, camera) = (frame(), camera(&frame()));
    let depth = device.upload(frame.depth().pixels(), "test").unwrap();
    let sights = look(&device, &gaussians, &depth, &camera, FrameTrust::Alone, &settings).unwrap();
    let pixels = device.empty(sights.count, "test").unwrap();
    let (cubes, cube) = threads(sights.count);
    locate_seen::launch(
        &device.client,
        cubes,
        cube,
        gaussians.balls().arg(),
        sights.sights.arg(),
        sights.visible.arg(),
        pixels.arg(),
        view_args(&camera),
        sights.count as u32,
    );
    let [found, sights] = device.download([&pixels, &sights.sights]).unwrap();
    let mut expected = vec![NOWHERE; map.balls.len()];
    for splat in project(&map.balls, 0, &camera) {
        let pixel = splat.mean.y.round() as u32 * SIZE.0 as u32 + splat.mean.x.round() as u32;
        let is_seen = sights[splat.gaussian as usize] == SEEN;
        expected[splat.gaussian as usize] = if is_seen { pixel } else { HIDDEN };
    }
    assert!(found == expected);
}

#[test]
fn kept_gaussians_stay_in_their_order() {
    let Some(device) = device() else { return };
    let (map, votes, mut gaussians, _) = on(&device);
    let keep: Vec<u32> = noise(3).take(map.balls.len()).map(|value| u32::from(value % 3 > 0)).collect();
    let kept: Vec<usize> = (0..keep.len()).filter(|index| keep[*index] == 1).collect();
    gaussians.retain(&device.upload(&keep, "test").unwrap(), kept.len()).unwrap();
    gaussians.reserve(50_000).unwrap();
    let found = gaussians.read().unwrap();
    let found_votes = evidence(&MemorySettings::default()).read(&device, &gaussians).unwrap();
    let mut expected = Balls::default();
    kept.iter().for_each(|index| expected.push(map.balls.means[*index], map.balls.radii[*index]));
    assert!(found.balls == expected);
    assert!(found.colors == kept.iter().map(|index| map.colors[*index]).collect::<Vec<_>>());
    assert!(found_votes == kept.iter().map(|index| votes[*index]).collect::<Vec<_>>());
}
