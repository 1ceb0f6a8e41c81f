//! Segmenters: the library's for Python, and Python's for the library.

use crate::arrays::{Masks, color_image, depth_image, fractions, masks, to_color_array, to_masks, to_plain_array};
use crate::errors::{runtime_error, value_error};
use crate::pipeline::intrinsics;
use crate::settings::{layers, resolve};
use numpy::{PyArray1, PyArray3};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::pyclass::{PyTraverseError, PyVisit};
use pyo3::types::{PyDict, PyTuple};
use splatseg::segmenter::SegmenterError;
use splatseg::{CameraFrame, Intrinsics, Mask, ScoredMask, Segmentation};
use std::sync::{Arc, Mutex, PoisonError};

/// Name of a function of Python as a segmenter or depth predictor, in messages and settings.
pub const FUNCTION_NAME: &str = "python";

/// A callable of Python that a pipeline and its segmenter share. The pipeline shows it to Python's garbage collector,
/// which finds no references inside the library.
#[derive(Clone)]
pub struct SharedCallable(Arc<Mutex<Option<Py<PyAny>>>>);

impl SharedCallable {
    pub fn new(callable: Py<PyAny>) -> Self {
        Self(Arc::new(Mutex::new(Some(callable))))
    }

    /// Shows the callable to the garbage collector.
    pub fn traverse(&self, visit: &PyVisit<'_>) -> Result<(), PyTraverseError> {
        // The lock is only held while a reference is copied. An object that is not shown is not freed.
        match self.0.try_lock() {
            Ok(callable) => visit.call(&*callable),
            Err(_) => Ok(()),
        }
    }

    /// Drops the callable. A pipeline that the garbage collector frees is not used any more.
    pub fn clear(&self) {
        let callable = self.0.lock().unwrap_or_else(PoisonError::into_inner).take();
        // Dropped without the lock: that may run any code.
        drop(callable);
    }

    pub fn get(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        let callable = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let callable = callable.as_ref().map(|callable| callable.clone_ref(py));
        callable.ok_or_else(|| PyRuntimeError::new_err("the function was freed"))
    }
}

/// A callable `(rgb, depth) -> masks` as a segmenter.
pub struct PythonSegmenter {
    callable: SharedCallable,
}

impl PythonSegmenter {
    pub fn new(callable: SharedCallable) -> Self {
        Self { callable }
    }

    fn call(&self, py: Python<'_>, frame: &CameraFrame) -> PyResult<Vec<ScoredMask>> {
        let rgb = to_color_array(py, frame.color().pixels(), frame.color().size())?;
        let depth = to_plain_array(py, frame.depth().pixels(), frame.depth().size())?;
        let returned = self.callable.get(py)?.into_bound(py).call1((rgb, depth))?;
        match returned.cast::<PyTuple>() {
            Ok(pair) if pair.len() == 2 => scored(frame, &pair.get_item(0)?, Some(&pair.get_item(1)?)),
            Ok(tuple) => Err(value_error(format!(
                "the segmenter returned a tuple of length {}, expected masks or (masks, scores)",
                tuple.len()
            ))),
            Err(_) => scored(frame, &returned, None),
        }
    }
}

impl splatseg::Segmenter for PythonSegmenter {
    fn name(&self) -> &str {
        FUNCTION_NAME
    }

    fn segment(&mut self, frame: &CameraFrame) -> Result<Segmentation, SegmenterError> {
        Python::attach(|py| self.call(py, frame))
            .map(Segmentation::from)
            .map_err(|error| SegmenterError::Other { name: "the segmenter".to_owned(), source: Box::new(error) })
    }
}

/// The non-empty masks that a callable has returned for a frame; without `scores`, their scores are 1.
fn scored(
    frame: &CameraFrame,
    returned: &Bound<'_, PyAny>,
    scores: Option<&Bound<'_, PyAny>>,
) -> PyResult<Vec<ScoredMask>> {
    const NAME: &str = "the segmenter's result";
    let size = (frame.width(), frame.height());
    let check_size = |found: (usize, usize)| match found == size {
        true => Ok(()),
        false => Err(value_error(format!(
            "{NAME} has masks of {}x{} pixels, expected {}x{} as in the frame",
            found.0, found.1, size.0, size.1
        ))),
    };
    let found: Vec<Mask> = match masks(returned, NAME)? {
        Masks::Stack(pixels, found) => {
            check_size(found)?;
            let mask = |pixels: &[bool]| Mask::from_fn(size.0, size.1, |column, row| pixels[row * size.0 + column]);
            pixels.chunks_exact(size.0 * size.1).map(mask).collect()
        }
        Masks::Ids(ids) => {
            check_size(ids.size())?;
            Mask::of_segments(&ids).into_iter().map(|(_, mask)| mask).collect()
        }
    };
    let scores = match scores {
        Some(scores) => fractions(scores, "scores", &[found.len()], "a score from 0 to 1 for each mask")?,
        None => vec![1.0; found.len()],
    };
    let scored = found.into_iter().zip(scores).map(|(mask, score)| ScoredMask { mask, score: score as f32 });
    Ok(scored.filter(|scored| !scored.mask.is_empty()).collect())
}

/// A segmenter of the library.
#[pyclass(frozen, module = "splatseg._splatseg")]
pub struct Segmenter {
    segmenter: Mutex<Box<dyn splatseg::Segmenter>>,
}

/// Masks `(masks, height, width)` and scores `(masks,)`.
type MasksAndScores = (Py<PyArray3<bool>>, Py<PyArray1<f32>>);

#[pymethods]
impl Segmenter {
    #[new]
    fn new(py: Python<'_>, settings: &Bound<'_, PyDict>) -> PyResult<Self> {
        let settings = resolve(&layers(settings, None)?)?;
        let segmenter = py.detach(|| splatseg::Pipeline::builder(&settings).build_segmenter());
        Ok(Self { segmenter: Mutex::new(segmenter.map_err(value_error)?) })
    }

    /// Masks `(masks, height, width)` and scores `(masks,)`.
    #[pyo3(signature = (rgb, depth=None, k=None, depth_scale=None))]
    fn segment(
        &self,
        py: Python<'_>,
        rgb: &Bound<'_, PyAny>,
        depth: Option<&Bound<'_, PyAny>>,
        k: Option<&Bound<'_, PyAny>>,
        depth_scale: Option<f64>,
    ) -> PyResult<MasksAndScores> {
        let color = color_image(rgb, "rgb")?;
        let size = color.size();
        let depth = match depth {
            Some(depth) => depth_image(depth, depth_scale)?,
            None => splatseg::Image::filled(size.0, size.1, 0.0),
        };
        let camera = match k {
            Some(k) => intrinsics(k, size)?,
            None => typical_camera(size),
        };
        let frame = CameraFrame::new("0", color, depth, camera).map_err(value_error)?;
        let busy = |_| PyRuntimeError::new_err("the segmenter is in use: use it from one thread at a time");
        let mut guard = self.segmenter.try_lock().map_err(busy)?;
        let segmenter = guard.as_mut();
        let found = py.detach(move || segmenter.segment(&frame));
        drop(guard);
        py.check_signals()?;
        let found = found.map_err(runtime_error)?.masks;
        let scores: Vec<f32> = found.iter().map(|scored| scored.score).collect();
        Ok((to_masks(py, found.iter().map(|scored| &scored.mask), size)?, PyArray1::from_vec(py, scores).unbind()))
    }
}

/// A camera with a horizontal field of view of 60 degrees.
fn typical_camera((width, height): (usize, usize)) -> Intrinsics {
    let focal = width as f32 / (2.0 * 30f32.to_radians().tan());
    let center = |side: usize| (side as f32 - 1.0) / 2.0;
    Intrinsics { fx: focal, fy: focal, cx: center(width), cy: center(height), width, height }
}
