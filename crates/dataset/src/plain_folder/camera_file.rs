//! Reading of `camera.json` in a plain folder.

use crate::DatasetError;
use crate::files::read_file;
use serde::Deserialize;
use splatseg_geometry::{Distortion, Intrinsics};
use std::path::Path;

/// Maximum file size. Larger files are not camera descriptions.
const MAX_BYTES: u64 = 64 << 10;

/// Valid keys of the file.
const KEYS: [&str; 9] =
    ["width", "height", "fx", "fy", "cx", "cy", "depth_units_per_metre", "distortion_model", "distortion_coefficients"];

/// Camera of the colour and depth images.
#[derive(Clone, Copy, Debug)]
pub(super) struct FolderCamera {
    pub(super) intrinsics: Intrinsics,
    pub(super) units_per_metre: f32,
    pub(super) distortion: Distortion,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraFile {
    width: usize,
    height: usize,
    fx: f32,
    fy: f32,
    cx: f32,
    cy: f32,
    depth_units_per_metre: f32,
    distortion_model: Option<String>,
    #[serde(default)]
    distortion_coefficients: Vec<f64>,
}

/// Depth units per metre without a camera file: millimetres.
const DEFAULT_UNITS_PER_METRE: f32 = 1000.0;

impl FolderCamera {
    /// Returns the camera for images without a camera file: depth in millimetres, no lens distortion.
    pub(super) fn without_file(intrinsics: Intrinsics) -> Self {
        Self { intrinsics, units_per_metre: DEFAULT_UNITS_PER_METRE, distortion: Distortion::None }
    }

    pub(super) fn read(path: &Path) -> Result<Self, DatasetError> {
        let bytes = read_file(path, "camera file", MAX_BYTES)?;
        check_keys(path, &bytes)?;
        let file: CameraFile =
            serde_json::from_slice(&bytes).map_err(|source| DatasetError::Json { path: path.to_owned(), source })?;
        let CameraFile { width, height, fx, fy, cx, cy, depth_units_per_metre: units_per_metre, .. } = file;
        let field = |field: &str, found: String, expected: &str| DatasetError::Field {
            path: path.to_owned(),
            field: field.to_owned(),
            found,
            expected: expected.to_owned(),
        };
        if !(units_per_metre.is_finite() && units_per_metre > 0.0) {
            let expected = "a positive number: 1000 where depth images hold millimetres";
            return Err(field("depth_units_per_metre", units_per_metre.to_string(), expected));
        }
        let intrinsics = Intrinsics { fx, fy, cx, cy, width, height }
            .validated()
            .map_err(|source| DatasetError::Intrinsics { path: path.to_owned(), source })?;
        let model = match file.distortion_model {
            Some(model) => model,
            None if file.distortion_coefficients.is_empty() => "none".to_owned(),
            None => {
                let expected = "plumb_bob, rational_polynomial or equidistant";
                return Err(field(
                    "distortion_model",
                    "nothing, although distortion_coefficients are given".to_owned(),
                    expected,
                ));
            }
        };
        let distortion = Distortion::from_coefficients(&model, &file.distortion_coefficients)
            .map_err(|source| DatasetError::Distortion { path: path.to_owned(), source })?;
        Ok(Self { intrinsics, units_per_metre, distortion })
    }
}

/// Checks that an object has only [`KEYS`]. Other problems are reported when its values are read.
fn check_keys(path: &Path, bytes: &[u8]) -> Result<(), DatasetError> {
    let Ok(object) = serde_json::from_slice::<serde_json::Map<String, serde_json::Value>>(bytes) else { return Ok(()) };
    let Some(key) = object.keys().find(|key| !KEYS.contains(&key.as_str())) else { return Ok(()) };
    Err(DatasetError::UnknownKey {
        path: path.to_owned(),
        key: key.chars().take(40).collect(),
        nearest: nearest_key(key),
        known: KEYS.join(", "),
    })
}

/// Returns the most similar key, if any is similar enough. Compares only letters and digits.
fn nearest_key(wrong: &str) -> Option<&'static str> {
    let plain = |key: &str| key.chars().filter(|letter| letter.is_alphanumeric()).collect::<String>().to_lowercase();
    let wrong = plain(wrong);
    let similarity = |key: &&'static str| (strsim::jaro_winkler(&plain(key), &wrong), *key);
    let similar = KEYS.iter().map(similarity).filter(|(similarity, _)| *similarity > 0.8);
    similar.max_by(|(a, _), (b, _)| a.total_cmp(b)).map(|(_, key)| key)
}
