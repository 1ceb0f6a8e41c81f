//! Pictures of results.

use crate::arrays::{color_image, id_image, to_color_array};
use crate::errors::value_error;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use numpy::PyArray3;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use splatseg::Image;

/// The image with every segment tinted, outlined and numbered, uint8 `(height, width, 3)`.
#[pyfunction]
pub fn overlay(py: Python<'_>, rgb: &Bound<'_, PyAny>, ids: &Bound<'_, PyAny>) -> PyResult<Py<PyArray3<u8>>> {
    let drawn = drawn(py, rgb, ids)?;
    to_color_array(py, drawn.pixels(), drawn.size())
}

/// The image with every segment tinted, outlined and numbered, as a PNG.
#[pyfunction]
pub fn overlay_png<'py>(
    py: Python<'py>,
    rgb: &Bound<'_, PyAny>,
    ids: &Bound<'_, PyAny>,
) -> PyResult<Bound<'py, PyBytes>> {
    let drawn = drawn(py, rgb, ids)?;
    let encoded = py.detach(|| {
        let mut encoded = Vec::new();
        let (width, height) = (drawn.width() as u32, drawn.height() as u32);
        PngEncoder::new(&mut encoded)
            .write_image(drawn.pixels().as_flattened(), width, height, ExtendedColorType::Rgb8)
            .map(|()| encoded)
    });
    Ok(PyBytes::new(py, &encoded.map_err(value_error)?))
}

fn drawn(py: Python<'_>, rgb: &Bound<'_, PyAny>, ids: &Bound<'_, PyAny>) -> PyResult<Image<[u8; 3]>> {
    let (color, ids) = (color_image(rgb, "rgb")?, id_image(ids, "ids")?);
    py.detach(|| splatseg::output::draw_overlay(&color, &ids)).map_err(value_error)
}

/// The colour of an id in overlays, sRGB.
#[pyfunction]
pub fn segment_color(id: u32) -> (u8, u8, u8) {
    splatseg::output::segment_color(id).into()
}
