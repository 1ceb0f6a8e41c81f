//! SAM 2.1 alone: tracks prompted objects through a video.

use crate::arrays::{color_image, mask_image, numbers, to_masks};
use crate::errors::{runtime_error, value_error};
use crate::settings::{layers, settings_error};
use numpy::PyArray3;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use splatseg::geometry::{Click, Prompt};
use splatseg::tracking::Tracker;
use splatseg::{CameraFrame, Image, Intrinsics, Mask, SegmentId};
use std::sync::{Mutex, MutexGuard};

/// SAM 2.1 with its tracks.
#[pyclass(frozen, module = "splatseg._splatseg")]
pub struct Sam2 {
    state: Mutex<State>,
}

struct State {
    tracker: Box<dyn Tracker>,
    /// `(width, height)` of the current frame.
    size: Option<(usize, usize)>,
}

/// Ids and masks `(masks, height, width)`.
type Tracks = (Vec<SegmentId>, Py<PyArray3<bool>>);

#[pymethods]
impl Sam2 {
    #[new]
    fn new(py: Python<'_>, settings: &Bound<'_, PyDict>) -> PyResult<Self> {
        let settings = layers(settings, None)?.resolve().map_err(settings_error)?;
        let tracker = py.detach(|| splatseg::Pipeline::builder(&settings).build_tracker()).map_err(value_error)?;
        let tracker = tracker.ok_or_else(|| value_error("the method has no tracker"))?;
        Ok(Self { state: Mutex::new(State { tracker, size: None }) })
    }

    /// Propagates every track to the next frame.
    fn step(&self, py: Python<'_>, rgb: &Bound<'_, PyAny>) -> PyResult<Tracks> {
        let color = color_image(rgb, "rgb")?;
        let (width, height) = color.size();
        let camera = Intrinsics { fx: 1.0, fy: 1.0, cx: 0.0, cy: 0.0, width, height };
        let frame = CameraFrame::new("0", color, Image::filled(width, height, 0.0), camera);
        let frame = frame.map_err(value_error)?;
        let mut guard = self.lock()?;
        let state = &mut *guard;
        let tracks = py.detach(|| state.tracker.track(&frame));
        py.check_signals()?;
        let tracks = tracks.map_err(runtime_error)?;
        state.size = Some((width, height));
        to_tracks(py, &tracks, (width, height))
    }

    /// Prompts an object with its mask on the current frame.
    fn add_mask(&self, py: Python<'_>, id: SegmentId, mask: &Bound<'_, PyAny>) -> PyResult<Tracks> {
        let mask = mask_image(mask, "mask")?;
        let mask = Mask::from_fn(mask.width(), mask.height(), |column, row| mask[(column, row)]);
        self.prompt(py, id, Prompt::Mask(mask))
    }

    /// Prompts an object with clicks, a box, or both on the current frame.
    #[pyo3(signature = (id, points=None, labels=None, r#box=None, more=false))]
    fn add_points(
        &self,
        py: Python<'_>,
        id: SegmentId,
        points: Option<&Bound<'_, PyAny>>,
        labels: Option<&Bound<'_, PyAny>>,
        r#box: Option<&Bound<'_, PyAny>>,
        more: bool,
    ) -> PyResult<Tracks> {
        let clicks = points.map(|points| clicks(points, labels)).transpose()?.unwrap_or_default();
        let bounding_box =
            r#box.map(|corners| numbers(corners, "box", &[4], "x0, y0, x1, y1 in pixels")).transpose()?;
        let bounding_box = bounding_box.map(|corners| [0, 1, 2, 3].map(|index| corners[index] as f32));
        if clicks.is_empty() && bounding_box.is_none() {
            return Err(value_error("a prompt needs points or a box"));
        }
        let prompt = if more { Prompt::MoreClicks(clicks) } else { Prompt::Points { bounding_box, clicks } };
        self.prompt(py, id, prompt)
    }

    /// Stops tracking an object.
    fn remove(&self, id: SegmentId) -> PyResult<()> {
        self.lock()?.tracker.remove(id);
        Ok(())
    }
}

impl Sam2 {
    fn lock(&self) -> PyResult<MutexGuard<'_, State>> {
        let busy = |_| PyRuntimeError::new_err("the tracker is processing a frame: use it from one thread at a time");
        self.state.try_lock().map_err(busy)
    }

    fn prompt(&self, py: Python<'_>, id: SegmentId, prompt: Prompt) -> PyResult<Tracks> {
        let mut guard = self.lock()?;
        let state = &mut *guard;
        let size = state.size.ok_or_else(|| value_error("a prompt came before the first frame: call step first"))?;
        let tracks = py.detach(|| state.tracker.prompt(&[(id, prompt)]));
        py.check_signals()?;
        to_tracks(py, &tracks.map_err(value_error)?, size)
    }
}

fn to_tracks(py: Python<'_>, tracks: &[(SegmentId, Mask)], size: (usize, usize)) -> PyResult<Tracks> {
    let ids = tracks.iter().map(|(id, _)| *id).collect();
    Ok((ids, to_masks(py, tracks.iter().map(|(_, mask)| mask), size)?))
}

fn clicks(points: &Bound<'_, PyAny>, labels: Option<&Bound<'_, PyAny>>) -> PyResult<Vec<Click>> {
    let count = points.len()?;
    let points = numbers(points, "points", &[count, 2], "x and y in pixels")?;
    let labels = match labels {
        Some(labels) => numbers(labels, "labels", &[count], "1 (on the object) or 0 (beside it) for each point")?,
        None => vec![1.0; count],
    };
    if let Some(label) = labels.iter().find(|label| ![0.0, 1.0].contains(*label)) {
        return Err(value_error(format!("labels contains {label}, expected 1 (on the object) or 0 (beside it)")));
    }
    let (pairs, _) = points.as_chunks::<2>();
    let click = |(&[x, y], label): (&[f64; 2], &f64)| Click { x: x as f32, y: y as f32, positive: *label == 1.0 };
    Ok(pairs.iter().zip(&labels).map(click).collect())
}
