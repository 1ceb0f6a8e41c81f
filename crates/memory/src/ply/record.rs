//! One Gaussian as the bytes of one PLY vertex, and back.

use super::SplatFileView;
use super::error::SplatFileError;
use glam::{Quat, Vec3};
use splatseg_render::Gaussians;
use std::path::Path;

/// Y_00, the spherical harmonic of degree 0: 1 / (2 √π).
const HARMONIC_0: f64 = 0.28209479177387814;
/// Stands for opacity 1: its sigmoid is 1 in `f32`.
const LOGIT_OF_1: f32 = 20.0;
/// Stands for opacity 0: its sigmoid is 0 in `f32`, below half of the smallest denormal.
const LOGIT_OF_0: f32 = -110.0;

/// The float properties before the features, in the order of the file.
pub const FLOAT_PROPERTIES: [&str; 17] = [
    "x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0",
    "rot_1", "rot_2", "rot_3",
];

/// Bytes of a record with features of dimension `feature_dim`.
pub const fn record_bytes(feature_dim: usize) -> usize {
    4 * (FLOAT_PROPERTIES.len() + feature_dim + 1)
}

/// Appends the record of Gaussian `index`.
pub fn encode(view: &SplatFileView<'_>, index: usize, path: &Path, bytes: &mut Vec<u8>) -> Result<(), SplatFileError> {
    let invalid = |property: &str, found: f32, expected: &str| value_error(path, index, property, found, expected);
    let (mean, quat) = (view.gaussians.means[index], view.gaussians.quats[index]);
    let (scale, opacity) = (view.gaussians.scales[index], view.gaussians.opacities[index]);
    if !(0.0..=1.0).contains(&opacity) {
        return Err(invalid("opacity", opacity, "a value in [0, 1]"));
    }
    for (value, property) in scale.to_array().into_iter().zip(&FLOAT_PROPERTIES[10..]) {
        if !(value > 0.0 && value.is_finite()) {
            return Err(invalid(property, value, "a positive finite value"));
        }
    }
    let color = view.colors[index].map(|channel| (f64::from(channel.clamp(0.0, 1.0)) - 0.5) / HARMONIC_0);
    let [red, green, blue] = color.map(|value| value as f32);
    let [scale_0, scale_1, scale_2] = scale.to_array().map(|value| f64::from(value).ln() as f32);
    let floats = [
        mean.x,
        mean.y,
        mean.z,
        0.0,
        0.0,
        0.0,
        red,
        green,
        blue,
        logit(opacity),
        scale_0,
        scale_1,
        scale_2,
        quat.w,
        quat.x,
        quat.y,
        quat.z,
    ];
    if let Some(at) = floats.iter().position(|value| !value.is_finite()) {
        return Err(invalid(FLOAT_PROPERTIES[at], floats[at], "a finite value"));
    }
    let dim = view.codebook.feature_dim();
    let feature = &view.features[index * dim..(index + 1) * dim];
    if let Some(at) = feature.iter().position(|value| !value.is_finite()) {
        return Err(invalid(&format!("feature_{at}"), feature[at], "a finite value"));
    }
    let id = check_segment_id(view.segment_ids[index], view.codebook.len(), index, path)?;
    bytes.extend(floats.iter().chain(feature).flat_map(|value| value.to_le_bytes()));
    bytes.extend(id.to_le_bytes());
    Ok(())
}

/// The Gaussians of a file, as [`SplatFile`](super::SplatFile) has them but for the ids, still to be checked.
pub struct Records {
    /// Geometry, N entries.
    pub gaussians: Gaussians,
    /// In [0, 1], `[N]`.
    pub colors: Vec<[f32; 3]>,
    /// Row-major `[N, D]`.
    pub features: Vec<f32>,
    /// As they stand in the file, `[N]`.
    pub segment_ids: Vec<u32>,
}

impl Records {
    /// No Gaussians, but room for `count`.
    pub fn with_capacity(count: usize, feature_dim: usize) -> Self {
        let gaussians = Gaussians {
            means: Vec::with_capacity(count),
            quats: Vec::with_capacity(count),
            scales: Vec::with_capacity(count),
            opacities: Vec::with_capacity(count),
        };
        Self {
            gaussians,
            colors: Vec::with_capacity(count),
            features: Vec::with_capacity(count * feature_dim),
            segment_ids: Vec::with_capacity(count),
        }
    }
}

/// Appends the Gaussian of one record.
pub fn decode(record: &[u8], records: &mut Records, path: &Path) -> Result<(), SplatFileError> {
    let index = records.gaussians.len();
    let (words, _) = record.as_chunks::<4>();
    let (floats, id) = words.split_at(words.len().saturating_sub(1));
    let Some((fixed, feature)) = floats.split_first_chunk::<{ FLOAT_PROPERTIES.len() }>() else {
        return Ok(());
    };
    let fixed = fixed.map(f32::from_le_bytes);
    if let Some(at) = fixed.iter().position(|value| !value.is_finite()) {
        return Err(value_error(path, index, FLOAT_PROPERTIES[at], fixed[at], "a finite value"));
    }
    let [x, y, z, _, _, _, red, green, blue, opacity, scale_0, scale_1, scale_2, w, i, j, k] = fixed;
    let scale = [scale_0, scale_1, scale_2].map(|value| f64::from(value).exp() as f32);
    if let Some(at) = scale.iter().position(|value| !(*value > 0.0 && value.is_finite())) {
        return Err(value_error(path, index, FLOAT_PROPERTIES[10 + at], fixed[10 + at], "the logarithm of an f32"));
    }
    for (at, value) in feature.iter().map(|&bytes| f32::from_le_bytes(bytes)).enumerate() {
        if !value.is_finite() {
            return Err(value_error(path, index, &format!("feature_{at}"), value, "a finite value"));
        }
        records.features.push(value);
    }
    let color = [red, green, blue].map(|value| (f64::from(value) * HARMONIC_0 + 0.5).clamp(0.0, 1.0) as f32);
    records.colors.push(color);
    records.segment_ids.extend(id.iter().map(|&bytes| u32::from_le_bytes(bytes)));
    records.gaussians.push(Vec3::new(x, y, z), Quat::from_xyzw(i, j, k, w), Vec3::from(scale), sigmoid(opacity));
    Ok(())
}

/// The id as the file's `int`, if it is that of a code or 0.
pub fn check_segment_id(id: u32, codes: usize, gaussian: usize, path: &Path) -> Result<i32, SplatFileError> {
    match i32::try_from(id) {
        Ok(valid) if id as usize <= codes => Ok(valid),
        _ => Err(value_error(path, gaussian, "segment_id", id, &format!("an id from 0 to {codes}"))),
    }
}

fn value_error(
    path: &Path,
    gaussian: usize,
    property: &str,
    found: impl std::fmt::Display,
    expected: &str,
) -> SplatFileError {
    SplatFileError::Value {
        path: path.to_owned(),
        gaussian,
        property: property.to_owned(),
        found: found.to_string(),
        expected: expected.to_owned(),
    }
}

fn logit(opacity: f32) -> f32 {
    let opacity = f64::from(opacity);
    ((opacity / (1.0 - opacity)).ln() as f32).clamp(LOGIT_OF_0, LOGIT_OF_1)
}

fn sigmoid(logit: f32) -> f32 {
    (1.0 / (1.0 + (-f64::from(logit)).exp())) as f32
}
