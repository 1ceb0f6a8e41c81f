//! A camera given by the settings, for recordings without a calibration file.

use crate::decode::{image_size, read_color};
use crate::error::COLOR_IMAGE;
use crate::{DatasetError, DatasetSettings};
use serde::Serialize;
use splatseg_geometry::{Image, Intrinsics};
use splatseg_imaging::{FocalLength, estimated_focal_length};
use splatseg_settings::SettingError;
use std::path::{Path, PathBuf};

/// Reads a colour image.
pub(crate) type ReadColor = fn(&Path) -> Result<Image<[u8; 3]>, DatasetError>;

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

    /// A camera with this focal length.
    pub(crate) fn guessed(guess: &GuessedCamera) -> Self {
        Self { focal: (guess.fx, guess.fx), center: (None, None) }
    }

    /// Returns the intrinsics of colour images of `size`, `(width, height)`.
    pub(crate) fn intrinsics(&self, (width, height): (usize, usize)) -> Intrinsics {
        let middle = |side: usize| (side as f64 - 1.0) / 2.0;
        let (cx, cy) = (self.center.0.unwrap_or(middle(width)), self.center.1.unwrap_or(middle(height)));
        let [fx, fy, cx, cy] = [self.focal.0, self.focal.1, cx, cy].map(|number| number as f32);
        Intrinsics { fx, fy, cx, cy, width, height }
    }
}

/// The focal length of images whose camera nothing describes, in pixels of the stored images.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct GuessedCamera {
    /// The focal length that is used.
    pub fx: f64,
    /// The shortest likely one: of 19 out of 20 cameras, if it was estimated, else of a camera that sees 70 degrees.
    pub from: f64,
    /// The longest likely one: of 19 out of 20 cameras, if it was estimated, else of a camera that sees 50 degrees.
    pub to: f64,
    /// True if it was estimated from the motion in the images; false if the camera is assumed to see [`Self::DEGREES`]
    /// across the long side.
    pub estimated: bool,
    /// True if the images look like those of a lens with barrel distortion, which is not corrected: the focal length is less
    /// certain then. False if it was not estimated.
    pub distorts: bool,
}

impl GuessedCamera {
    /// Assumed angle of view across the long side, degrees: between telephones (65) and webcams (55).
    pub const DEGREES: f64 = 60.0;
    /// Angles of view of usual cameras, degrees; action cameras see more.
    const USUAL_DEGREES: [f64; 2] = [70.0, 50.0];
    /// So many deviations on each side hold the focal length in 19 of 20 cases.
    const DEVIATIONS: f64 = 1.96;

    /// Guesses the camera of images of `size`, `(width, height)`, from the motion in them if it tells. `read` reads one.
    pub(crate) fn of_images(images: &[&Path], size: (usize, usize), read: ReadColor) -> Self {
        // A damaged image is reported when its frame is read.
        let read = |index: usize| read(images[index]).ok().filter(|color| color.size() == size);
        Self::of(size, estimated_focal_length(images.len(), &read))
    }

    /// Guesses the camera of images of `size`, `(width, height)`, from what was estimated if anything was.
    fn of((width, height): (usize, usize), estimate: Option<FocalLength>) -> Self {
        let long_side = width.max(height) as f64;
        if let Some(FocalLength { long_sides, deviation, distorts }) = estimate {
            let focal =
                |deviations: f64| (10.0 * long_side * long_sides * libm::exp(deviations * deviation)).round() / 10.0;
            let [fx, from, to] = [0.0, -Self::DEVIATIONS, Self::DEVIATIONS].map(focal);
            return Self { fx, from, to, estimated: true, distorts };
        }
        let focal = |degrees: f64| 0.5 * long_side / (0.5 * degrees).to_radians().tan();
        let [from, to] = Self::USUAL_DEGREES.map(focal);
        Self { fx: focal(Self::DEGREES), from, to, estimated: false, distorts: false }
    }

    /// Tells the guess for a recording with this number of frames and the option that sets it, in one line.
    pub fn text(&self, frames: usize) -> String {
        let Self { fx, from, to, estimated, distorts } = self;
        if *estimated {
            let lens = if *distorts {
                "but the lens seems to distort, which makes it too long: give both in camera.json, or the focal length with \
                 --fx PIXELS"
            } else {
                "if the lens does not distort; --fx PIXELS sets it"
            };
            return format!(
                "camera: not known, estimated from the motion in the images: a focal length of {fx:.0} pixels, {from:.0} to \
                 {to:.0} in 19 of 20 cases {lens}"
            );
        }
        let [widest, narrowest] = Self::USUAL_DEGREES;
        let reason = if frames < 2 {
            "one image does not tell (a run looks at all)"
        } else {
            "the motion in the images does not tell"
        };
        format!(
            "camera: not known, and {reason}; guessed to see {:.0} degrees across the long side: a focal length \
             of {fx:.0} pixels, {from:.0} to {to:.0} for {widest:.0} to {narrowest:.0} degrees; --fx PIXELS sets it",
            Self::DEGREES
        )
    }
}

/// Place of a camera that the settings give, for messages.
pub(crate) const PLACE: &str = "dataset.fx, fy, cx and cy";

/// Returns the place of the intrinsics, for messages: `file`, or the settings if they give a camera.
pub(crate) fn camera_place(own: Option<&OwnCamera>, file: &Path) -> PathBuf {
    if own.is_some() { PLACE.into() } else { file.to_owned() }
}

/// Returns true if two sizes, `(width, height)`, are those of one image at different resolutions.
pub(crate) fn has_shape(one: (usize, usize), other: (usize, usize)) -> bool {
    let (across, down) = (one.0 as f64 / other.0 as f64, one.1 as f64 / other.1 as f64);
    // Half a pixel of rounding along the short side.
    (across / down - 1.0).abs() <= 1.0 / one.1.min(other.1).min(one.0).min(other.0).max(1) as f64
}

/// Returns the intrinsics of a colour image of `size` `(width, height)`, which `camera` took at its resolution or another one.
/// `source` is where the camera is from.
///
/// # Errors
/// [`DatasetError::Field`] if the image has another shape, so that it cannot be the camera's. `image` is its file.
pub(crate) fn at_resolution(
    camera: &Intrinsics,
    size: (usize, usize),
    (image, source): (&Path, &str),
) -> Result<Intrinsics, DatasetError> {
    let stated = (camera.width, camera.height);
    if has_shape(size, stated) {
        return Ok(if size == stated { *camera } else { camera.resized(size.0, size.1) });
    }
    Err(DatasetError::Field {
        path: image.to_owned(),
        field: COLOR_IMAGE.to_owned(),
        found: format!("{}x{} pixels", size.0, size.1),
        expected: format!(
            "the shape of {}x{}, as {source}; --fx (--fy, --cx, --cy) describes the camera of these images",
            stated.0, stated.1
        ),
    })
}

/// Returns the error for a scene whose camera is not known. `file` would describe it. The motion in its colour images may
/// suggest a focal length.
pub(crate) fn no_camera(path: &Path, file: &'static str, images: &[&Path]) -> DatasetError {
    let size = images.first().and_then(|image| image_size(image, COLOR_IMAGE).ok());
    let estimate = size.map(|size| GuessedCamera::of_images(images, size, read_color)).filter(|guess| guess.estimated);
    DatasetError::NoCamera { path: path.to_owned(), file, estimate }
}

/// Tells the focal length that the images suggest, for the end of a message.
pub(crate) fn suggestion(estimate: Option<&GuessedCamera>) -> String {
    estimate.map_or_else(String::new, |GuessedCamera { fx, from, to, .. }| {
        format!("; the motion in the images suggests {fx:.0}, {from:.0} to {to:.0} in 19 of 20 cases")
    })
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
    fn a_guess_tells_its_uncertainty() {
        let guess = GuessedCamera::of((480, 640), None);
        assert_eq!([guess.fx, guess.from, guess.to].map(f64::round), [554.0, 457.0, 686.0]);
        let told = guess.text(1);
        assert!(
            told.contains("60 degrees") && told.contains("554 pixels, 457 to 686") && told.contains("--fx"),
            "{told}"
        );
    }

    #[test]
    fn an_estimate_takes_the_place_of_the_guess() {
        let estimate = FocalLength { long_sides: 0.8, deviation: 0.05, distorts: false };
        let camera = GuessedCamera::of((480, 640), Some(estimate));
        assert_eq!([camera.fx, camera.from, camera.to], [512.0, 464.2, 564.7]);
        assert!(camera.estimated && camera.text(30).contains("512 pixels, 464 to 565"), "{}", camera.text(30));
        let distorted = GuessedCamera::of((480, 640), Some(FocalLength { distorts: true, ..estimate }));
        assert!(distorted.text(30).contains("give both in camera.json"), "{}", distorted.text(30));
    }

    #[test]
    fn values_without_a_focal_length_are_refused() {
        let error = camera(|s| s.cy = Some(20.0)).unwrap_err().to_string();
        assert_eq!(error, "dataset.cy is 20, expected no value without dataset.fx (--fx)");
    }
}
