//! Recorded scenes of every format.

use crate::arrays::{to_array, to_color_array, to_plain_array};
use crate::errors::value_error;
use crate::settings::{layers, settings_error};
use numpy::{PyArray2, PyArray3};
use pyo3::exceptions::{PyIndexError, PyRuntimeError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};
use splatseg::dataset::{DatasetSettings, FrameStream, GroundTruth, RecordedFrame, StreamedFrame, open_scene};
use splatseg::{CameraFrame, Intrinsics, Pose, SegmentMap};
use std::path::PathBuf;
use std::sync::{Arc, Mutex};

/// A recorded scene.
#[pyclass(frozen, module = "splatseg._splatseg")]
pub struct Scene {
    scene: Arc<dyn splatseg::dataset::Scene>,
    dataset: DatasetSettings,
    /// Indices of the selected frames.
    selected: Vec<usize>,
}

/// A frame: index in the scene, name, colour, depth, K, camera to world if known, seconds, true ids.
type PythonFrame = (
    usize,
    String,
    Py<PyArray3<u8>>,
    Py<PyArray2<f32>>,
    Py<PyArray2<f64>>,
    Option<Py<PyArray2<f64>>>,
    Option<f64>,
    Option<Py<PyArray2<u32>>>,
);

#[pymethods]
impl Scene {
    #[new]
    fn new(py: Python<'_>, path: PathBuf, settings: &Bound<'_, PyDict>) -> PyResult<Self> {
        let settings = layers(settings, Some("dataset"))?.resolve_shared().map_err(settings_error)?;
        let dataset = settings.dataset;
        let scene = py.detach(|| open_scene(&path, &dataset)).map_err(value_error)?;
        let selected = dataset.selected_frames(scene.frame_count()).map_err(value_error)?;
        Ok(Self { scene, dataset, selected })
    }

    /// The scene's name.
    #[getter]
    fn name(&self) -> &str {
        self.scene.name()
    }

    /// The scene's format.
    #[getter]
    fn format(&self) -> Option<&'static str> {
        self.scene.format().map(splatseg::dataset::Format::name)
    }

    /// True if at least one frame is expected to have a pose.
    #[getter]
    fn has_poses(&self) -> bool {
        self.scene.has_poses()
    }

    /// False if no frame has depth.
    #[getter]
    fn has_depth(&self) -> bool {
        self.scene.has_depth()
    }

    /// The focal length if nothing describes the camera: `fx`, `from`, `to`, `estimated`, `distorts`, and a line that says so.
    #[getter]
    fn guessed_camera<'py>(&self, py: Python<'py>) -> PyResult<Option<(Bound<'py, PyDict>, String)>> {
        let Some(guess) = self.scene.guessed_camera() else { return Ok(None) };
        let camera = PyDict::new(py);
        for (name, pixels) in [("fx", guess.fx), ("from", guess.from), ("to", guess.to)] {
            camera.set_item(name, pixels)?;
        }
        for (name, is_so) in [("estimated", guess.estimated), ("distorts", guess.distorts)] {
            camera.set_item(name, is_so)?;
        }
        Ok(Some((camera, guess.text(self.scene.frame_count()))))
    }

    /// True if the scene has true ids.
    #[getter]
    fn has_ground_truth(&self) -> bool {
        self.scene.has_ground_truth()
    }

    fn __len__(&self) -> usize {
        self.selected.len()
    }

    /// One of the selected frames.
    fn frame(&self, py: Python<'_>, index: isize) -> PyResult<PythonFrame> {
        let count = self.selected.len();
        let position = if index < 0 { index.checked_add_unsigned(count) } else { Some(index) };
        let selected = position.and_then(|position| self.selected.get(usize::try_from(position).ok()?));
        let Some(&selected) = selected else {
            return Err(PyIndexError::new_err(format!("frame {index} of {count}")));
        };
        let read = py.detach(|| {
            let RecordedFrame { frame, world_from_camera } = self.scene.read_recorded(selected)?;
            let frame = self.dataset.framing().apply(frame)?;
            let truth = self.scene.read_ground_truth(selected)?;
            let truth = truth.map(|truth| self.dataset.framing().apply_to_labels(truth)).transpose()?;
            Ok::<_, splatseg::dataset::DatasetError>((frame, world_from_camera, truth))
        });
        let (frame, pose, truth) = read.map_err(value_error)?;
        python_frame(py, selected, &frame, pose.as_ref(), truth.as_ref())
    }

    /// The frames in order, read ahead.
    fn frames(&self, py: Python<'_>) -> PyResult<Frames> {
        let truth = if self.scene.has_ground_truth() { GroundTruth::Read } else { GroundTruth::Skip };
        let stream = py.detach(|| FrameStream::open(Arc::clone(&self.scene), &self.dataset, truth));
        Ok(Frames { stream: Mutex::new(stream.map_err(value_error)?) })
    }
}

/// An iterator over frames. Yields the error message of a frame that cannot be read.
#[pyclass(frozen, module = "splatseg._splatseg")]
pub struct Frames {
    stream: Mutex<FrameStream>,
}

#[pymethods]
impl Frames {
    fn __iter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    fn __next__(&self, py: Python<'_>) -> PyResult<Option<Py<PyAny>>> {
        let busy =
            |_| PyRuntimeError::new_err("another thread is waiting for a frame: use it from one thread at a time");
        let mut guard = self.stream.try_lock().map_err(busy)?;
        let stream = &mut *guard;
        let next = py.detach(|| stream.next());
        py.check_signals()?;
        Ok(match next {
            None => None,
            Some(Err(error)) => Some(PyString::new(py, &error.to_string()).into_any().unbind()),
            Some(Ok(StreamedFrame { index, frame, world_from_camera, ground_truth, .. })) => {
                let frame = python_frame(py, index, &frame, world_from_camera.as_ref(), ground_truth.as_ref())?;
                Some(frame.into_pyobject(py)?.into_any().unbind())
            }
        })
    }
}

fn python_frame(
    py: Python<'_>,
    index: usize,
    frame: &CameraFrame,
    pose: Option<&Pose>,
    truth: Option<&SegmentMap>,
) -> PyResult<PythonFrame> {
    let Intrinsics { fx, fy, cx, cy, .. } = *frame.intrinsics();
    let k = [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0].map(f64::from);
    let pose = pose.map(|pose| to_plain_array(py, &pose.to_row_major(), (4, 4))).transpose()?;
    Ok((
        index,
        frame.name().to_owned(),
        to_color_array(py, frame.color().pixels(), frame.color().size())?,
        to_plain_array(py, frame.depth().pixels(), frame.depth().size())?,
        to_plain_array(py, &k, (3, 3))?,
        pose,
        frame.timestamp().map(|time| time.as_secs_f64()),
        truth.map(|truth| to_array(py, truth.clone())).transpose()?,
    ))
}
