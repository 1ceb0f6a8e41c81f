//! Lens distortion, as OpenCV and ROS model it.

use glam::{DMat2, DVec2, dvec2};
use thiserror::Error;

/// The supported models with their coefficients, for messages.
const MODELS: &str = "plumb_bob (k1 k2 p1 p2 [k3]), rational_polynomial (k1 k2 p1 p2 k3 k4 k5 k6 [s1 s2 s3 s4]), \
                      equidistant (k1 k2 k3 k4) or none";
/// Maximum number of Newton steps in [`Distortion::undistort`]. Lenses need three to six.
const MAX_STEPS: usize = 30;
/// Tolerance of [`Distortion::undistort`] in units of the focal length: less than a millionth of a pixel.
const UNDISTORT_TOLERANCE: f64 = 1e-10;
/// Step of the numeric derivative.
const DERIVATIVE_STEP: f64 = 1e-6;
/// Number of rings in which [`Distortion::usable_radius`] searches for a fold.
const RADIUS_STEPS: u32 = 2000;

/// Distortion of a pinhole camera's image by a lens.
///
/// Points are normalised: a camera-frame point `(X, Y, Z)` is seen at `(X / Z, Y / Z)`, and its pixel is
/// `(fx x + cx, fy y + cy)` of the distorted point `(x, y)`. The formulas are from OpenCV's
/// [`calib3d`](https://docs.opencv.org/4.x/d9/d0c/group__calib3d.html) and
/// [`fisheye`](https://docs.opencv.org/4.x/db/d58/group__calib3d__fisheye.html), the names from ROS's
/// `sensor_msgs/CameraInfo`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Distortion {
    /// A pinhole camera, or an image that is already rectified.
    #[default]
    None,
    /// ROS's `plumb_bob` and `rational_polynomial`: radial, tangential and thin-prism distortion. For `plumb_bob`,
    /// `denominator` and `thin_prism` are 0.
    Polynomial {
        /// k1, k2, k3 of the radial factor's numerator, 1 + k1 r² + k2 r⁴ + k3 r⁶.
        numerator: [f64; 3],
        /// k4, k5, k6 of the radial factor's denominator, 1 + k4 r² + k5 r⁴ + k6 r⁶.
        denominator: [f64; 3],
        /// p1, p2.
        tangential: [f64; 2],
        /// s1 and s2 along x, s3 and s4 along y.
        thin_prism: [f64; 4],
    },
    /// ROS's `equidistant`, OpenCV's `fisheye`: k1 to k4 of θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸), where θ is the angle
    /// between the ray and the axis.
    Equidistant([f64; 4]),
}

/// Errors in a distortion model or its coefficients.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum DistortionError {
    /// The model is unknown.
    #[error("distortion model: found {0:?}, expected {MODELS}")]
    Model(String),
    /// The number of coefficients is wrong for the model.
    #[error("distortion coefficients: found {found} of them, but {model} takes {expected}")]
    Count {
        /// Name of the model.
        model: &'static str,
        /// Number of coefficients.
        found: usize,
        /// Allowed numbers.
        expected: &'static str,
    },
    /// A coefficient is NaN or infinite.
    #[error("distortion coefficients: number {} is {value}, expected a finite number", .index + 1)]
    NotFinite {
        /// Index of the coefficient.
        index: usize,
        /// Its value.
        value: f64,
    },
    /// The model of a tilted sensor, which is not supported.
    #[error(
        "distortion coefficients: tauX = {0} and tauY = {1} describe a tilted sensor, which is not supported: expected 0, \
         or rectified images"
    )]
    Tilted(f64, f64),
}

impl Distortion {
    /// Creates a distortion from ROS's name of the model and its coefficients in OpenCV's order: `plumb_bob` (4 or 5),
    /// `rational_polynomial` (8; 12 with the thin prism; 14 if the sensor is not tilted), `equidistant` (4), and `none`
    /// or an empty name for no distortion.
    ///
    /// As in ROS's `image_geometry`, no coefficients, or all 0, mean no distortion, also for `equidistant`.
    ///
    /// ```
    /// use splatseg_geometry::Distortion;
    /// let lens = Distortion::from_coefficients("plumb_bob", &[0.1, -0.2, 0.0, 0.0, 0.05])?;
    /// assert!(lens.distort(glam::dvec2(0.5, 0.0)).x > 0.5);
    /// assert_eq!(Distortion::from_coefficients("plumb_bob", &[0.0; 5])?, Distortion::None);
    /// # Ok::<(), splatseg_geometry::DistortionError>(())
    /// ```
    ///
    /// # Errors
    /// [`DistortionError`] for an unknown name, a wrong number of coefficients, NaN, infinity, or a tilted sensor.
    pub fn from_coefficients(model: &str, coefficients: &[f64]) -> Result<Self, DistortionError> {
        let not_finite = coefficients.iter().enumerate().find(|(_, value)| !value.is_finite());
        if let Some((index, value)) = not_finite {
            return Err(DistortionError::NotFinite { index, value: *value });
        }
        let is_zero = coefficients.iter().all(|value| *value == 0.0);
        let count = |model, expected| DistortionError::Count { model, found: coefficients.len(), expected };
        match model {
            "none" | "" if is_zero => Ok(Self::None),
            "none" | "" => Err(count("none", "none, or only 0")),
            "plumb_bob" | "rational_polynomial" | "equidistant" if coefficients.is_empty() => Ok(Self::None),
            "plumb_bob" => Self::plumb_bob(coefficients).ok_or_else(|| count("plumb_bob", "4 or 5")),
            "rational_polynomial" => {
                if let [.., tau_x, tau_y] = coefficients
                    && coefficients.len() == 14
                    && (*tau_x != 0.0 || *tau_y != 0.0)
                {
                    return Err(DistortionError::Tilted(*tau_x, *tau_y));
                }
                Self::rational(coefficients).ok_or_else(|| count("rational_polynomial", "8, 12 or 14"))
            }
            "equidistant" => {
                let k = coefficients.try_into().map_err(|_| count("equidistant", "4"))?;
                Ok(Self::Equidistant(k))
            }
            other => Err(DistortionError::Model(other.to_owned())),
        }
        .map(|distortion| if is_zero { Self::None } else { distortion })
    }

    fn plumb_bob(coefficients: &[f64]) -> Option<Self> {
        let (k1, k2, p1, p2, k3) = match *coefficients {
            [k1, k2, p1, p2] => (k1, k2, p1, p2, 0.0),
            [k1, k2, p1, p2, k3] => (k1, k2, p1, p2, k3),
            _ => return None,
        };
        let numerator = [k1, k2, k3];
        Some(Self::Polynomial { numerator, denominator: [0.0; 3], tangential: [p1, p2], thin_prism: [0.0; 4] })
    }

    fn rational(coefficients: &[f64]) -> Option<Self> {
        let (&[k1, k2, p1, p2, k3, k4, k5, k6], rest) = coefficients.split_first_chunk()?;
        let thin_prism = match *rest {
            [] => [0.0; 4],
            [s1, s2, s3, s4] | [s1, s2, s3, s4, _, _] => [s1, s2, s3, s4],
            _ => return None,
        };
        let (numerator, denominator) = ([k1, k2, k3], [k4, k5, k6]);
        Some(Self::Polynomial { numerator, denominator, tangential: [p1, p2], thin_prism })
    }

    /// Distorts a normalised pinhole point.
    pub fn distort(&self, point: DVec2) -> DVec2 {
        let radius_squared = point.length_squared();
        let along_ray = point * self.radial_factor(radius_squared);
        let Self::Polynomial { tangential: [p1, p2], thin_prism: [s1, s2, s3, s4], .. } = *self else {
            return along_ray;
        };
        let DVec2 { x, y } = point;
        let decentred = dvec2(
            2.0 * p1 * x * y + p2 * (radius_squared + 2.0 * x * x),
            p1 * (radius_squared + 2.0 * y * y) + 2.0 * p2 * x * y,
        );
        let prism = dvec2(s1 + s2 * radius_squared, s3 + s4 * radius_squared) * radius_squared;
        along_ray + decentred + prism
    }

    /// Returns the normalised pinhole point that the lens maps to `distorted`. `None` if there is none, or only beyond
    /// a fold of the model.
    pub fn undistort(&self, distorted: DVec2) -> Option<DVec2> {
        if *self == Self::None {
            return Some(distorted);
        }
        let mut point = distorted;
        for _ in 0..MAX_STEPS {
            let error = self.distort(point) - distorted;
            let jacobian = self.jacobian(point);
            // The determinant is positive everywhere between the axis and the fold.
            if !error.is_finite() || jacobian.determinant() <= 0.0 {
                return None;
            }
            if error.length_squared() < UNDISTORT_TOLERANCE * UNDISTORT_TOLERANCE {
                return Some(point);
            }
            point -= jacobian.inverse() * error;
        }
        None
    }

    /// Returns the distance from the axis, at most `limit`, up to which the model is valid. A model fitted near the
    /// axis may fold farther out: it moves points back towards the axis, which would repeat the image there. In
    /// normalised, undistorted coordinates.
    pub fn usable_radius(&self, limit: f64) -> f64 {
        let distorted = |radius: f64| radius * self.radial_factor(radius * radius);
        let ring = |step: u32| limit * f64::from(step) / f64::from(RADIUS_STEPS);
        let grows = |step: u32| distorted(ring(step + 1)) > distorted(ring(step));
        (0..RADIUS_STEPS).find(|step| !grows(*step)).map_or(limit, ring)
    }

    /// The factor by which a point at this squared distance from the axis is scaled.
    fn radial_factor(&self, radius_squared: f64) -> f64 {
        let series = |[a, b, c]: [f64; 3]| 1.0 + radius_squared * (a + radius_squared * (b + radius_squared * c));
        match *self {
            Self::None => 1.0,
            Self::Polynomial { numerator, denominator, .. } => series(numerator) / series(denominator),
            Self::Equidistant([k1, k2, k3, k4]) => {
                let radius = radius_squared.sqrt();
                // The limit on the axis.
                if radius < 1e-8 {
                    return 1.0;
                }
                let angle = radius.atan();
                let square = angle * angle;
                angle * (1.0 + square * (k1 + square * (k2 + square * (k3 + square * k4)))) / radius
            }
        }
    }

    fn jacobian(&self, point: DVec2) -> DMat2 {
        let along = |step: DVec2| (self.distort(point + step) - self.distort(point - step)) / (2.0 * DERIVATIVE_STEP);
        DMat2::from_cols(along(DVec2::X * DERIVATIVE_STEP), along(DVec2::Y * DERIVATIVE_STEP))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn invalid_models_are_refused() {
        let error = |model: &str, coefficients: &[f64]| {
            Distortion::from_coefficients(model, coefficients).map_or_else(|error| error.to_string(), |_| String::new())
        };
        assert!(error("plum_bob", &[0.0; 5]).starts_with("distortion model: found \"plum_bob\", expected plumb_bob"));
        assert_eq!(
            error("plumb_bob", &[0.1; 8]),
            "distortion coefficients: found 8 of them, but plumb_bob takes 4 or 5"
        );
        assert_eq!(
            error("equidistant", &[0.0; 5]),
            "distortion coefficients: found 5 of them, but equidistant takes 4"
        );
        assert!(error("rational_polynomial", &[0.1; 9]).contains("takes 8, 12 or 14"));
        assert!(error("plumb_bob", &[0.1, f64::NAN, 0.0, 0.0]).contains("number 2 is NaN"));
        assert!(error("none", &[0.1]).contains("none, or only 0"));
        let mut tilted = [0.1; 14];
        assert!(error("rational_polynomial", &tilted).contains("tauX = 0.1"));
        tilted[12..].fill(0.0);
        assert!(Distortion::from_coefficients("rational_polynomial", &tilted).is_ok());
    }

    #[test]
    fn zeros_mean_no_distortion() {
        for (model, count) in [("plumb_bob", 5), ("rational_polynomial", 14), ("equidistant", 4), ("none", 0), ("", 3)]
        {
            assert_eq!(Distortion::from_coefficients(model, &vec![0.0; count]), Ok(Distortion::None));
            assert_eq!(Distortion::from_coefficients(model, &[]), Ok(Distortion::None));
        }
    }

    #[test]
    fn a_model_that_folds_the_image_is_used_up_to_the_fold() {
        // r (1 - r²/3) grows up to r = 1.
        let barrel = Distortion::from_coefficients("plumb_bob", &[-1.0 / 3.0, 0.0, 0.0, 0.0]).unwrap();
        assert!((barrel.usable_radius(3.0) - 1.0).abs() < 0.002);
        assert_eq!(barrel.usable_radius(0.9), 0.9);
        assert_eq!(barrel.undistort(dvec2(0.7, 0.0)), None, "the lens shows nothing beyond 2/3");
        assert!((barrel.undistort(dvec2(0.6, 0.0)).unwrap().x - 0.7).abs() < 0.1);
    }

    fn lens() -> impl Strategy<Value = Distortion> {
        let rational = (prop::array::uniform8(-0.05f64..0.05), prop::array::uniform4(-0.002f64..0.002));
        prop_oneof![
            prop::array::uniform5(-0.05f64..0.05).prop_map(|k| ("plumb_bob", k.to_vec())),
            rational.prop_map(|(k, s)| ("rational_polynomial", [&k[..], &s].concat())),
            prop::array::uniform4(-0.02f64..0.02).prop_map(|k| ("equidistant", k.to_vec())),
        ]
        .prop_map(|(model, k)| Distortion::from_coefficients(model, &k).unwrap())
    }

    proptest! {
        #[test]
        fn undistorting_inverts_distorting(lens in lens(), x in -0.7f64..0.7, y in -0.5f64..0.5) {
            let point = dvec2(x, y);
            let back = lens.undistort(lens.distort(point)).expect("a mild lens folds nothing");
            prop_assert!((back - point).length() < 1e-8);
        }

        #[test]
        fn any_numbers_give_an_answer(k in prop::array::uniform8(-1e30f64..1e30), x in -1e6f64..1e6, y in -1e6f64..1e6) {
            let lens = Distortion::from_coefficients("rational_polynomial", &k).unwrap();
            let radius = lens.usable_radius(2.0);
            prop_assert!((0.0..=2.0).contains(&radius));
            if let Some(point) = lens.undistort(dvec2(x, y)) {
                prop_assert!((lens.distort(point) - dvec2(x, y)).length() < 1e-6);
            }
        }
    }
}
