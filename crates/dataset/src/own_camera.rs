//! A camera given by the settings, for recordings without a calibration file.

use crate::{DatasetError, DatasetSettings};
use splatseg_geometry::Intrinsics;
use splatseg_settings::SettingError;
use std::path::{Path, PathBuf};

/// The focal lengths and the principal point of the colour images, pixels of the stored images.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct OwnCamera {
    focal: (f64, f64),
    /// The image centre where it is `None`.
    center: (Option<f64>, Option<f64>),
}

impl OwnCamera {
    /// Returns the camera of the settings; `None` if they give no focal length.
    ///
    /// # Errors
    /// [`SettingError`] if they give another value without `dataset.fx`.
    pub(crate) fn from_settings(settings: &DatasetSettings) -> Result<Option<Self>, SettingError> {
        let DatasetSettings { fx, fy, cx, cy, .. } = *settings;
        if let Some(fx) = fx {
            return Ok(Some(Self { focal: (fx, fy.unwrap_or(fx)), center: (cx, cy) }));
        }
        match [("fy", fy), ("cx", cx), ("cy", cy)].into_iter().find_map(|(name, value)| Some((name, value?))) {
            None => Ok(None),
            Some((name, found)) => Err(SettingError {
                key: format!("dataset.{name}"),
                found: found.to_string(),
                expected: "no value without dataset.fx (--fx)".to_owned(),
            }),
        }
    }

    /// Told of a scene whose camera is guessed.
    pub(crate) const GUESS_TOLD: &str =
        "camera: not known, guessed to see 60 degrees across the long side (give the focal length in pixels with --fx)";

    /// Returns a guess of the camera of images of `size`: 60 degrees across the long side, between telephones (65) and
    /// webcams (55).
    pub(crate) fn guess((width, height): (usize, usize)) -> Self {
        let focal = 0.5 * width.max(height) as f64 / 30.0f64.to_radians().tan();
        Self { focal: (focal, focal), center: (None, None) }
    }

    /// Returns the intrinsics of colour images of `size`, `(width, height)`.
    pub(crate) fn intrinsics(&self, (width, height): (usize, usize)) -> Intrinsics {
        let middle = |side: usize| (side as f64 - 1.0) / 2.0;
        let (cx, cy) = (self.center.0.unwrap_or(middle(width)), self.center.1.unwrap_or(middle(height)));
        let [fx, fy, cx, cy] = [self.focal.0, self.focal.1, cx, cy].map(|number| number as f32);
        Intrinsics { fx, fy, cx, cy, width, height }
    }
}

/// Returns the place of the intrinsics, for messages: `file`, or the settings if they give a camera.
pub(crate) fn camera_place(own: Option<&OwnCamera>, file: &Path) -> PathBuf {
    if own.is_some() { "dataset.fx, fy, cx and cy".into() } else { file.to_owned() }
}

/// Returns the error for a scene whose camera is not known. `file` would describe it.
pub(crate) fn no_camera(path: &Path, file: &'static str) -> DatasetError {
    DatasetError::NoCamera { path: path.to_owned(), file }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(change: impl FnOnce(&mut DatasetSettings)) -> Result<Option<OwnCamera>, SettingError> {
        OwnCamera::from_settings(&DatasetSettings::default().with(change))
    }

    #[test]
    fn the_rest_follows_from_fx_and_the_image() {
        assert_eq!(camera(|_| ()), Ok(None));
        let of = |change: fn(&mut DatasetSettings)| camera(change).unwrap().unwrap().intrinsics((64, 48));
        let square = Intrinsics { fx: 50.0, fy: 50.0, cx: 31.5, cy: 23.5, width: 64, height: 48 };
        assert_eq!(of(|s| s.fx = Some(50.0)), square);
        let whole = of(|s| (s.fx, s.fy, s.cx, s.cy) = (Some(50.0), Some(51.0), Some(30.0), Some(20.0)));
        assert_eq!(whole, Intrinsics { fy: 51.0, cx: 30.0, cy: 20.0, ..square });
    }

    #[test]
    fn values_without_a_focal_length_are_refused() {
        let error = camera(|s| s.cy = Some(20.0)).unwrap_err().to_string();
        assert_eq!(error, "dataset.cy is 20, expected no value without dataset.fx (--fx)");
    }
}
