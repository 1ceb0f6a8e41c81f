//! Reading of `camera.json` in a plain folder.

use crate::depth_scale::DepthScale;
use crate::files::read_file;
use crate::text::{not_text, parse_json};
use crate::{DatasetError, DatasetSettings};
use serde::Deserialize;
use splatseg_files::text_of;
use splatseg_geometry::{Distortion, Intrinsics};
use std::path::Path;

/// Maximum file size. Larger files are not camera descriptions.
const MAX_BYTES: u64 = 64 << 10;

/// Valid keys of the file.
const KEYS: [&str; 9] =
    ["width", "height", "fx", "fy", "cx", "cy", "depth_scale", "distortion_model", "distortion_coefficients"];

/// Name of `depth_scale` in files of earlier versions.
const EARLIER_DEPTH_SCALE: &str = "depth_units_per_metre";

/// Camera of the colour and depth images.
#[derive(Clone, Copy, Debug)]
pub(super) struct FolderCamera {
    pub(super) intrinsics: Intrinsics,
    pub(super) depth_scale: DepthScale,
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
    #[serde(alias = "depth_units_per_metre")]
    depth_scale: f64,
    distortion_model: Option<String>,
    #[serde(default)]
    distortion_coefficients: Vec<f64>,
}

impl FolderCamera {
    /// Returns the camera for images without a camera file: depth in millimetres, unless the settings say otherwise, and
    /// no lens distortion.
    pub(super) fn without_file(intrinsics: Intrinsics, settings: &DatasetSettings) -> Self {
        Self { intrinsics, depth_scale: DepthScale::MILLIMETRES.or_of(settings), distortion: Distortion::None }
    }

    /// Reads the file. The settings may replace its unit of depth.
    pub(super) fn read(path: &Path, settings: &DatasetSettings) -> Result<Self, DatasetError> {
        let what = "camera file";
        let text = text_of(read_file(path, what, MAX_BYTES)?).map_err(|error| not_text(path, what, error))?;
        check_keys(path, &text)?;
        let file: CameraFile = parse_json(path, &text)?;
        let CameraFile { width, height, fx, fy, cx, cy, depth_scale, .. } = file;
        let field = |field: &str, found: String, expected: &str| DatasetError::Field {
            path: path.to_owned(),
            field: field.to_owned(),
            found,
            expected: expected.to_owned(),
        };
        let depth_scale = DepthScale::stated(depth_scale, (path, "depth_scale"), settings)?;
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
        Ok(Self { intrinsics, depth_scale, distortion })
    }
}

/// Checks that an object has only [`KEYS`] and [`EARLIER_DEPTH_SCALE`]. Other problems are reported when its values are read.
fn check_keys(path: &Path, text: &str) -> Result<(), DatasetError> {
    let Ok(object) = serde_json::from_str::<serde_json::Map<String, serde_json::Value>>(text) else { return Ok(()) };
    let is_known = |key: &str| key == EARLIER_DEPTH_SCALE || KEYS.contains(&key);
    let Some(key) = object.keys().find(|key| !is_known(key)) else { return Ok(()) };
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
    let similarity = |key: &'static str| (strsim::jaro_winkler(&plain(key), &wrong), key);
    let earlier = std::iter::once((similarity(EARLIER_DEPTH_SCALE).0, "depth_scale"));
    let similar = KEYS.into_iter().map(similarity).chain(earlier).filter(|(similarity, _)| *similarity > 0.8);
    similar.max_by(|(a, _), (b, _)| a.total_cmp(b)).map(|(_, key)| key)
}
