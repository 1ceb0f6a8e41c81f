//! Agreement with `gsplat.rasterization`; `tools/make_raster_test_data.py` made the reference data in `tests/data`.

use glam::{Mat4, Quat, Vec3};
use safetensors::SafeTensors;
use splatseg_geometry::{Intrinsics, LocalPose};
use splatseg_render::{Camera, Gaussians, RasterLimits, View};
use std::path::Path;

/// One reference file.
struct Golden(Vec<u8>);

impl Golden {
    fn open(name: &str) -> Self {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name);
        Self(std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display())))
    }

    fn bytes(&self, name: &str) -> Vec<u8> {
        let tensors = SafeTensors::deserialize(&self.0).unwrap();
        tensors.tensor(name).unwrap_or_else(|error| panic!("{name}: {error}")).data().to_vec()
    }

    fn floats(&self, name: &str) -> Vec<f32> {
        self.bytes(name).as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect()
    }

    fn ints(&self, name: &str) -> Vec<i32> {
        self.bytes(name).as_chunks::<4>().0.iter().map(|bytes| i32::from_le_bytes(*bytes)).collect()
    }

    fn vectors(&self, name: &str) -> Vec<Vec3> {
        self.floats(name).as_chunks::<3>().0.iter().map(|v| Vec3::from_array(*v)).collect()
    }

    fn gaussians(&self) -> Gaussians {
        let quats = self.floats("quats");
        Gaussians {
            means: self.vectors("means"),
            quats: quats.as_chunks::<4>().0.iter().map(|[w, x, y, z]| Quat::from_xyzw(*x, *y, *z, *w)).collect(),
            scales: self.vectors("scales"),
            opacities: self.floats("opacities"),
        }
    }

    fn camera(&self, prefix: &str) -> Camera {
        let k = self.floats("K");
        let size = self.ints("width_height");
        let viewmat: [f32; 16] = self.floats(&format!("{prefix}viewmat")).try_into().unwrap();
        let camera_from_world = Mat4::from_cols_array(&viewmat).transpose();
        let intrinsics = Intrinsics {
            fx: k[0],
            fy: k[4],
            cx: k[2] - 0.5,
            cy: k[5] - 0.5,
            width: size[0] as usize,
            height: size[1] as usize,
        };
        let mut camera = Camera::new(intrinsics, &LocalPose::IDENTITY);
        camera.camera_from_world_rotation = glam::Mat3::from_mat4(camera_from_world);
        camera.camera_from_world_translation = camera_from_world.w_axis.truncate();
        camera
    }
}

/// Asserts that at pixels that are not fragile, `found` differs from `expected` by at most `allowed(expected)`.
#[track_caller]
fn assert_close(what: &str, found: &[f32], expected: &[f32], fragile: &[u8], allowed: impl Fn(f32) -> f32) {
    assert_eq!(found.len(), expected.len(), "{what}");
    let channels = found.len() / fragile.len();
    for (index, (found, expected)) in found.iter().zip(expected).enumerate() {
        let difference = (found - expected).abs();
        let stable = fragile[index / channels] == 0;
        assert!(
            !stable || difference <= allowed(*expected),
            "{what}[{index}]: {found} instead of {expected}, off by {difference}"
        );
        assert!(found.is_finite(), "{what}[{index}] is {found}");
    }
}

fn check_projection(golden: &Golden, prefix: &str, view: &View) {
    let means = golden.floats(&format!("{prefix}inter.means2d"));
    let conics = golden.floats(&format!("{prefix}inter.conics"));
    let depths = golden.floats(&format!("{prefix}inter.depths"));
    let radii = golden.ints(&format!("{prefix}inter.radii_opacity"));
    let mut seen = vec![false; depths.len()];
    for splat in view.projected() {
        let index = splat.gaussian as usize;
        seen[index] = true;
        for axis in 0..2 {
            let expected = means[2 * index + axis] - 0.5;
            let allowed = if expected.abs() < 1000.0 { 1e-3 } else { 1e-6 * expected.abs() };
            assert!((splat.mean[axis] - expected).abs() <= allowed, "mean of {index}: {:?}", splat.mean);
            // Our boxes need no cut at 3.33 deviations: with an opacity of at most 1 they are never larger.
            let radius = splat.half_extent[axis].ceil() as i32;
            assert!((radius - radii[2 * index + axis]).abs() <= 1, "radius of {index}: {radius}");
        }
        for entry in 0..3 {
            let expected = conics[3 * index + entry];
            let largest = conics[3 * index..3 * index + 3].iter().fold(0f32, |a, b| a.max(b.abs()));
            assert!((splat.conic[entry] - expected).abs() <= 1e-4 * largest, "conic of {index}: {:?}", splat.conic);
        }
        assert!((splat.depth - depths[index]).abs() <= 1e-5 * depths[index].abs());
    }
    for (index, seen) in seen.iter().enumerate() {
        let visible = radii[2 * index] > 0 && radii[2 * index + 1] > 0;
        // gsplat rounds radii up, so it keeps some Gaussians that end up to a pixel outside the image, but never culls
        // one that we keep.
        assert!(visible || !seen, "Gaussian {index} should have been culled");
    }
}

fn check_scene(golden: &Golden, prefix: &str, alpha_tolerance: f32, depth_tolerance: f32) {
    let gaussians = golden.gaussians();
    let view = View::new(&gaussians, &golden.camera(prefix));
    check_projection(golden, prefix, &view);
    let weights = view.weights();
    let out = |name: &str| golden.floats(&format!("{prefix}out.{name}"));
    let fragile = golden.bytes(&format!("{prefix}out.fragile"));
    assert_close("color", &weights.render(&golden.floats("colors"), 3), &out("color"), &fragile, |_| 5e-5);
    assert_close("feature", &weights.render(&golden.floats("features"), 28), &out("feature"), &fragile, |_| 5e-5);
    assert_close("alpha", weights.silhouette().pixels(), &out("alpha"), &fragile, |_| alpha_tolerance);
    let depth = weights.accumulated_depth();
    assert_close("depth", depth.pixels(), &out("depth_acc"), &fragile, |d| depth_tolerance * d.abs().max(1.0));
    check_blended(golden, prefix, &view, &fragile);
}

/// The number of Gaussians blended at each pixel and the last of them.
fn check_blended(golden: &Golden, prefix: &str, view: &View, fragile: &[u8]) {
    let weights = view.weights();
    let mut counts = vec![0; fragile.len()];
    let mut last = vec![-1; fragile.len()];
    for tile in weights.tiles() {
        for (column, gaussian) in tile.gaussians().iter().enumerate() {
            for (pixel, _) in tile.column(column) {
                let (left, top) = tile.origin();
                let index = (top + pixel as usize / 16) * weights.width() + left + pixel as usize % 16;
                counts[index] += 1;
                last[index] = *gaussian as i32;
            }
        }
    }
    let (expected_counts, expected_last) =
        (golden.ints(&format!("{prefix}out.n_contrib")), golden.ints(&format!("{prefix}out.last_id")));
    for index in 0..fragile.len() {
        if fragile[index] == 0 {
            assert_eq!((counts[index], last[index]), (expected_counts[index], expected_last[index]), "pixel {index}");
        }
    }
}

#[test]
fn anisotropic_gaussians_agree() {
    check_scene(&Golden::open("scene1.safetensors"), "", 1e-5, 2e-5);
}

#[test]
fn a_depth_image_of_gaussians_agrees_from_two_views() {
    let golden = Golden::open("scene2.safetensors");
    check_scene(&golden, "same.", 1e-5, 2e-5);
    check_scene(&golden, "moved.", 1e-5, 2e-5);
}

#[test]
fn edge_cases_agree() {
    check_scene(&Golden::open("scene3.safetensors"), "", 2e-5, 2e-5);
}

/// gsplat 1.6 caps alpha at 0.99.
#[test]
fn the_alpha_cap_is_a_setting() {
    let golden = Golden::open("scene2.safetensors");
    for prefix in ["same.", "moved."] {
        let mut camera = golden.camera(prefix);
        camera.limits = RasterLimits { max_alpha: 0.99, ..RasterLimits::default() };
        let view = View::new(&golden.gaussians(), &camera);
        let fragile = golden.bytes(&format!("{prefix}out_max099.fragile"));
        let expected = golden.floats(&format!("{prefix}out_max099.color"));
        assert_close("color", &view.weights().render(&golden.floats("colors"), 3), &expected, &fragile, |_| 5e-5);
    }
}

#[test]
fn feature_gradients_agree() {
    let (scene, grads) = (Golden::open("scene1.safetensors"), Golden::open("scene1_grads.safetensors"));
    let gaussians = scene.gaussians();
    let view = View::new(&gaussians, &scene.camera(""));
    for (weight, grad, channels) in [("weight.feature", "grad.features", 28), ("weight.color", "grad.colors", 3)] {
        // The loss's weights are zero at fragile pixels, so the whole gradient is compared.
        let found = view.weights().gradient(&grads.floats(weight), channels, gaussians.len());
        assert_close(grad, &found, &grads.floats(grad), &vec![0; gaussians.len()], |_| 1e-4);
    }
    let scene = Golden::open("scene2.safetensors");
    let gaussians = scene.gaussians();
    for prefix in ["same.", "moved."] {
        let view = View::new(&gaussians, &scene.camera(prefix));
        let found = view.weights().gradient(&scene.floats(&format!("{prefix}grad.weight")), 28, gaussians.len());
        let expected = scene.floats(&format!("{prefix}grad.features"));
        assert_close("grad.features", &found, &expected, &vec![0; gaussians.len()], |_| 1e-4);
    }
}
