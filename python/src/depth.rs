//! Depth predictors: a network of the library for Python, and a function of Python for the library.

use crate::arrays::{color_image, fractions, median_of_other_unit, numbers, to_color_array, to_plain_array};
use crate::errors::{runtime_error, value_error};
use crate::segmenter::{FUNCTION_NAME, SharedCallable};
use numpy::PyArray2;
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use splatseg::depth::{DepthPredictorError, PredictedDepth};
use splatseg::models::depth_anything::{DepthAnythingNetwork, DepthOutput};
use splatseg::pipeline::PredictedDepthUse;
use splatseg::{CameraFrame, Image};
use std::path::PathBuf;

/// A callable `rgb -> depth` or `rgb -> (depth, confidence)` as a depth predictor.
pub struct PythonDepthPredictor {
    /// The callable.
    pub callable: SharedCallable,
    /// Where its depth is used.
    pub used: PredictedDepthUse,
}

impl PythonDepthPredictor {
    fn call(&self, py: Python<'_>, frame: &CameraFrame) -> PyResult<PredictedDepth> {
        let rgb = to_color_array(py, frame.color().pixels(), frame.color().size())?;
        let returned = self.callable.get(py)?.into_bound(py).call1((rgb,))?;
        let image = |values: Vec<f64>| {
            let values = values.into_iter().map(|value| value as f32).collect();
            Image::from_pixels(frame.width(), frame.height(), values).map_err(value_error)
        };
        let shape = [frame.height(), frame.width()];
        let depth = |value: &Bound<'_, PyAny>| {
            const NAME: &str = "the depth predictor's result";
            let values = numbers(value, NAME, &shape, "depth, as large as rgb")?;
            if let Some(negative) = values.iter().find(|value| **value < 0.0) {
                let message = format!("{NAME} contains {negative}, expected depth, 0 where nothing is predicted");
                return Err(value_error(message));
            }
            // Where holes are filled, the prediction is fitted to measured depth and may have any unit.
            if self.used == PredictedDepthUse::All
                && let Some(median) = median_of_other_unit(values.iter().copied())
            {
                return Err(value_error(format!("{NAME} has a median of {median:.0}, expected metres")));
            }
            image(values)
        };
        let confidence =
            |value: &Bound<'_, PyAny>| image(fractions(value, "confidence", &shape, "0 to 1, as large as rgb")?);
        match returned.cast::<PyTuple>() {
            Ok(pair) if pair.len() == 2 => Ok(PredictedDepth {
                depth: depth(&pair.get_item(0)?)?,
                confidence: Some(confidence(&pair.get_item(1)?)?),
            }),
            _ => Ok(PredictedDepth { depth: depth(&returned)?, confidence: None }),
        }
    }
}

impl splatseg::depth::DepthPredictor for PythonDepthPredictor {
    fn name(&self) -> &str {
        FUNCTION_NAME
    }

    fn predict(&mut self, frame: &CameraFrame<'_>) -> Result<PredictedDepth, DepthPredictorError> {
        Python::attach(|py| self.call(py, frame))
            .map_err(|error| DepthPredictorError::Other { name: "of Python".to_owned(), source: Box::new(error) })
    }
}

/// A network that predicts depth.
#[pyclass(frozen, module = "splatseg._splatseg")]
pub struct Depth {
    network: DepthAnythingNetwork,
    short_side: usize,
}

#[pymethods]
impl Depth {
    #[new]
    fn new(py: Python<'_>, weights: PathBuf, short_side: usize, output: &str) -> PyResult<Self> {
        let output = match output {
            "auto" => None,
            "relative" => Some(DepthOutput::Relative),
            "indoor" => Some(DepthOutput::INDOOR),
            "outdoor" => Some(DepthOutput::OUTDOOR),
            other => {
                return Err(value_error(format!("output is {other:?}, expected auto, relative, indoor or outdoor")));
            }
        };
        if !(56..=1036).contains(&short_side) {
            return Err(value_error(format!("short_side is {short_side}, expected 56 to 1036")));
        }
        let network = py.detach(|| DepthAnythingNetwork::open(&weights, output)).map_err(value_error)?;
        Ok(Self { network, short_side })
    }

    /// True if it returns metres.
    #[getter]
    fn is_metric(&self) -> bool {
        self.network.config().output != DepthOutput::Relative
    }

    /// What the network returns, `(height, width)`.
    fn predict(&self, py: Python<'_>, rgb: &Bound<'_, PyAny>) -> PyResult<Py<PyArray2<f32>>> {
        let color = color_image(rgb, "rgb")?;
        let found = py.detach(|| self.network.predict(&color, self.short_side)).map_err(runtime_error)?;
        to_plain_array(py, found.pixels(), found.size())
    }
}
