//! Pictures of results.

use crate::arrays::{color_image, id_image};
use crate::errors::value_error;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

/// The image with every segment tinted, outlined and numbered, as a PNG.
#[pyfunction]
pub fn overlay_png<'py>(
    py: Python<'py>,
    rgb: &Bound<'_, PyAny>,
    ids: &Bound<'_, PyAny>,
) -> PyResult<Bound<'py, PyBytes>> {
    let (color, ids) = (color_image(rgb, "rgb")?, id_image(ids, "ids")?);
    let encoded = py.detach(|| {
        let overlay = splatseg::output::draw_overlay(&color, &ids).map_err(|error| error.to_string())?;
        let mut encoded = Vec::new();
        let (width, height) = (overlay.width() as u32, overlay.height() as u32);
        PngEncoder::new(&mut encoded)
            .write_image(overlay.pixels().as_flattened(), width, height, ExtendedColorType::Rgb8)
            .map_err(|error| error.to_string())?;
        Ok(encoded)
    });
    Ok(PyBytes::new(py, &encoded.map_err(|error: String| value_error(error))?))
}

/// The colour of an id in overlays, sRGB.
#[pyfunction]
pub fn segment_color(id: u32) -> (u8, u8, u8) {
    splatseg::output::segment_color(id).into()
}
