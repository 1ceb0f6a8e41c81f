//! Correction of the lens of frames that arrive one by one.

use crate::arrays::{color_image, depth_image, to_array, to_color_array};
use crate::errors::value_error;
use crate::pipeline::intrinsics;
use numpy::{PyArray2, PyArray3};
use pyo3::prelude::*;
use splatseg::geometry::Distortion;
use splatseg_dataset::LensCorrection;

/// Colour `[height, width, 3]` and depth `[height, width]`.
type ColorAndDepth = (Py<PyArray3<u8>>, Py<PyArray2<f32>>);

/// The lens of a camera. Its map is computed once.
#[pyclass(frozen, module = "splatseg._splatseg")]
#[derive(Default)]
pub struct Lens {
    correction: LensCorrection,
}

#[pymethods]
impl Lens {
    #[new]
    fn new() -> Self {
        Self::default()
    }

    /// Colour and depth, in metres, as a pinhole camera with the same matrix sees them.
    #[pyo3(signature = (rgb, depth, k, distortion, depth_scale=None))]
    fn undistort(
        &self,
        py: Python<'_>,
        rgb: &Bound<'_, PyAny>,
        depth: &Bound<'_, PyAny>,
        k: &Bound<'_, PyAny>,
        distortion: (String, Vec<f64>),
        depth_scale: Option<f64>,
    ) -> PyResult<ColorAndDepth> {
        let (model, coefficients) = distortion;
        let (color, depth) = (color_image(rgb, "rgb")?, depth_image(depth, depth_scale)?);
        let camera = intrinsics(k, color.size())?;
        let wrong = |error: &dyn std::fmt::Display| value_error(format!("distortion: {error}"));
        let distortion = Distortion::from_coefficients(&model, &coefficients).map_err(|error| wrong(&error))?;
        let corrected = py.detach(|| self.correction.correct((color, depth), (&camera, &distortion), "frame"));
        let (color, depth) = corrected.map_err(value_error)?;
        Ok((to_color_array(py, color.pixels(), color.size())?, to_array(py, depth)?))
    }
}
