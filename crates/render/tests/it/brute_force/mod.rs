//! The slow, obvious twin of the rasteriser: every Gaussian at every pixel, in f64, no tiles and no boxes.

use glam::{DMat3, DVec3};
use splatseg_render::{Camera, Gaussians};

/// Dense blend weights, `[pixels][gaussians]`, and flags for pixels where rounding may change the blended Gaussians.
pub struct DenseWeights {
    pub weights: Vec<Vec<f64>>,
    pub fragile: Vec<bool>,
}

struct Splat {
    index: usize,
    mean: (f64, f64),
    conic: (f64, f64, f64),
    opacity: f64,
}

fn project(gaussians: &Gaussians, index: usize, camera: &Camera) -> Option<(f32, Splat)> {
    // Gaussians are ordered by depth in f32, so depths come from the same arithmetic.
    let depth = camera.to_camera(gaussians.means[index]).z;
    let rotation = camera.camera_from_world_rotation.as_dmat3();
    let center = rotation * gaussians.means[index].as_dvec3() + camera.camera_from_world_translation.as_dvec3();
    if depth <= camera.limits.near_plane || depth >= camera.limits.far_plane {
        return None;
    }
    let i = camera.intrinsics;
    let (fx, fy) = (f64::from(i.fx), f64::from(i.fy));
    let (cx, cy) = (f64::from(i.cx) + 0.5, f64::from(i.cy) + 0.5);
    let (w, h) = (i.width as f64, i.height as f64);
    let z = center.z;
    let limit = |value: f64, f: f64, c: f64, size: f64| {
        z * (value / z).clamp(-(c / f + 0.15 * size / f), (size - c) / f + 0.15 * size / f)
    };
    let (tx, ty) = (limit(center.x, fx, cx, w), limit(center.y, fy, cy, h));
    let (jx, jy) = (DVec3::new(fx / z, 0.0, -fx * tx / (z * z)), DVec3::new(0.0, fy / z, -fy * ty / (z * z)));
    let axes = rotation
        * DMat3::from_quat(gaussians.quats[index].as_dquat().normalize())
        * DMat3::from_diagonal(gaussians.scales[index].as_dvec3());
    let covariance = axes * axes.transpose();
    let low_pass = f64::from(camera.limits.low_pass);
    let a = jx.dot(covariance * jx) + low_pass;
    let b = jx.dot(covariance * jy);
    let c = jy.dot(covariance * jy) + low_pass;
    let determinant = a * c - b * b;
    let splat = Splat {
        index,
        mean: (fx * center.x / z + cx - 0.5, fy * center.y / z + cy - 0.5),
        conic: (c / determinant, -b / determinant, a / determinant),
        opacity: f64::from(gaussians.opacities[index]),
    };
    Some((depth, splat))
}

/// Blend weights of every Gaussian at every pixel.
pub fn blend_weights(gaussians: &Gaussians, camera: &Camera) -> DenseWeights {
    let mut splats: Vec<(f32, Splat)> =
        (0..gaussians.len()).filter_map(|index| project(gaussians, index, camera)).collect();
    splats.sort_by(|left, right| left.0.total_cmp(&right.0));
    let (width, height) = (camera.intrinsics.width, camera.intrinsics.height);
    let mut dense = DenseWeights {
        weights: vec![vec![0.0; gaussians.len()]; width * height],
        fragile: vec![false; width * height],
    };
    let limits = &camera.limits;
    let (min_alpha, min_t) = (f64::from(limits.min_alpha), f64::from(limits.min_transmittance));
    for pixel in 0..width * height {
        let mut transmittance = 1.0;
        for (_, splat) in &splats {
            let dx = splat.mean.0 - (pixel % width) as f64;
            let dy = splat.mean.1 - (pixel / width) as f64;
            let (a, b, c) = splat.conic;
            let sigma = 0.5 * (a * dx * dx + c * dy * dy) + b * dx * dy;
            let alpha = (splat.opacity * (-sigma).exp()).min(f64::from(limits.max_alpha));
            dense.fragile[pixel] |= (alpha / min_alpha - 1.0).abs() < 1e-3;
            if sigma < 0.0 || alpha < min_alpha {
                continue;
            }
            let next = transmittance * (1.0 - alpha);
            dense.fragile[pixel] |= (next / min_t - 1.0).abs() < 1e-2;
            if next <= min_t {
                break;
            }
            dense.weights[pixel][splat.index] = alpha * transmittance;
            transmittance = next;
        }
    }
    dense
}
