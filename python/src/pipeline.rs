//! A method with its segmenter, run frame by frame.

use crate::arrays::{
    color_image, depth_image, id_image, numbers, to_array, to_color_array, to_masks, to_plain_array, to_rows,
};
use crate::depth::PythonDepthPredictor;
use crate::errors::{runtime_error, value_error};
use crate::names::Names;
use crate::segmenter::{FUNCTION_NAME, PythonSegmenter, SharedCallable};
use crate::settings::{add_file, layers, resolve, settings_error};
use numpy::{PyArray1, PyArray2, PyReadonlyArray1};
use pyo3::exceptions::{PyRuntimeError, PyUserWarning};
use pyo3::prelude::*;
use pyo3::pyclass::{PyTraverseError, PyVisit};
use pyo3::types::PyDict;
use rayon::ThreadPool;
use splatseg::geometry::{KeyframeId, MapView, PoseFormat};
use splatseg::names::{ClipNames, Query, find_objects};
use splatseg::objects::{FrameStamp, ObjectName, SeenObjects};
use splatseg::odometry::PoseState;
use splatseg::pipeline::{FrameResult, NameObjectsError, ObjectToName, PipelineError, PredictedDepthUse};
use splatseg::settings::{MaskFolderSettings, Requirement, SegmenterSettings, SettingsError, SettingsLayers};
use splatseg::tracking::{Hindsight, ShownFrame};
use splatseg::{CameraFrame, Intrinsics, Mask, Pose, SegmentId, Settings};
use splatseg_files::MemoryLimit;
use std::error::Error;
use std::ffi::CString;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, TryLockError};
use std::time::{Duration, Instant};

/// A method, its segmenter and its memory.
#[pyclass(frozen, module = "splatseg._splatseg")]
pub struct Pipeline {
    state: Mutex<State>,
    /// Its own thread pool, if `threads` is given.
    threads: Option<ThreadPool>,
    settings: String,
    /// The segmenter, if it is a callable of Python.
    segmenter: Option<SharedCallable>,
    /// The depth predictor, if it is a callable of Python.
    depth_predictor: Option<SharedCallable>,
    /// How the poses passed to `step` are stated.
    pose_format: PoseFormat,
    /// Input that contradicts itself is an error.
    strict_input: bool,
}

struct State {
    pipeline: splatseg::Pipeline,
    /// The network that objects were named with, if it was not one of the settings.
    network: Option<Arc<ClipNames>>,
    seen: SeenObjects,
    frames: usize,
}

/// An object of a frame: id, area, box (x, y, width, height), confidence, first and last frame.
type Sighting = (SegmentId, usize, (usize, usize, usize, usize), f32, usize, usize);

/// Result of a step: ids, confidence, objects, masks if they may overlap, milliseconds per stage, the camera's pose and
/// its state, ids that became others, the segmenter's finer cut, and the frame's keyframe.
type Step = (
    Py<PyArray2<u32>>,
    Py<PyArray2<f32>>,
    Vec<Sighting>,
    Option<Py<PyAny>>,
    Vec<(String, f64)>,
    Py<PyArray2<f64>>,
    &'static str,
    Vec<(SegmentId, SegmentId)>,
    Option<Py<PyArray2<u32>>>,
    Anchor,
);

/// The keyframe that a frame's surfaces follow, and its pose at the time, camera to world.
type Anchor = (KeyframeId, [f64; 16]);

#[pymethods]
impl Pipeline {
    #[new]
    #[pyo3(signature = (settings, segmenter=None, config=None, saved_memory=None, keep_views=false, depth_predictor=None))]
    fn new(
        py: Python<'_>,
        settings: &Bound<'_, PyDict>,
        segmenter: Option<Py<PyAny>>,
        config: Option<PathBuf>,
        saved_memory: Option<PathBuf>,
        keep_views: bool,
        depth_predictor: Option<(Py<PyAny>, Option<String>)>,
    ) -> PyResult<Self> {
        let mut all = SettingsLayers::default();
        if let Some(path) = &config {
            add_file(&mut all, path)?;
        }
        let given = layers(settings, None)?;
        let mut all = all.with(given.clone());
        if let Some(path) = &saved_memory {
            all.add_saved_memory(path).map_err(settings_error)?;
        }
        if segmenter.is_some() {
            refuse_settings_of_segmenters(&all, &given)?;
        }
        let settings = resolve(&all)?;
        if settings.run.memory_limit != MemoryLimit::Auto {
            settings.run.memory_limit.enforce();
        }
        let threads = match settings.run.threads {
            0 => None,
            count => Some(rayon::ThreadPoolBuilder::new().num_threads(count).build().map_err(runtime_error)?),
        };
        let segmenter = segmenter.map(SharedCallable::new);
        let (depth_predictor, used) = depth_predictor.unzip();
        let depth_predictor = depth_predictor.map(SharedCallable::new);
        let used = match used.flatten().as_deref() {
            None | Some("holes") => PredictedDepthUse::Holes,
            Some("all") => PredictedDepthUse::All,
            Some(other) => return Err(value_error(format!("predicted_depth is {other:?}, expected holes or all"))),
        };
        let build = || {
            let mut builder = splatseg::Pipeline::builder(&settings);
            if let Some(callable) = &segmenter {
                builder = builder.segmenter(Box::new(PythonSegmenter::new(callable.clone())));
            }
            if let Some(callable) = &depth_predictor {
                let predictor = PythonDepthPredictor { callable: callable.clone(), used };
                builder = builder.depth_predictor(Box::new(predictor), used);
            }
            if let Some(path) = &saved_memory {
                builder = builder.saved_memory(path);
            }
            if keep_views {
                builder = builder.keep_views();
            }
            builder.build()
        };
        let pipeline = py.detach(|| in_pool(threads.as_ref(), build));
        let pipeline = pipeline.map_err(value_error)?;
        let pose_format = settings.dataset.pose_format();
        let strict_input = settings.run.strict_input;
        let used = depth_predictor.is_some().then_some(used);
        let settings = shown_settings(settings, segmenter.is_some(), used)?.to_string();
        let state = Mutex::new(State { pipeline, network: None, seen: SeenObjects::default(), frames: 0 });
        Ok(Self { state, threads, settings, segmenter, depth_predictor, pose_format, strict_input })
    }

    /// Shows Python's garbage collector what the pipeline refers to: a segmenter may refer to its pipeline.
    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        self.segmenter.iter().chain(&self.depth_predictor).try_for_each(|callable| callable.traverse(&visit))
    }

    fn __clear__(&self) {
        self.segmenter.iter().chain(&self.depth_predictor).for_each(SharedCallable::clear);
    }

    /// The settings as JSON.
    #[getter]
    fn settings(&self) -> &str {
        &self.settings
    }

    /// Number of processed frames.
    #[getter]
    fn frames(&self) -> PyResult<usize> {
        Ok(self.lock()?.frames)
    }

    #[pyo3(signature = (rgb, depth, k, camera_to_world=None, timestamp=None, name=None, depth_scale=None))]
    #[allow(clippy::too_many_arguments, reason = "the parts of a frame")]
    fn step(
        &self,
        py: Python<'_>,
        rgb: &Bound<'_, PyAny>,
        depth: &Bound<'_, PyAny>,
        k: &Bound<'_, PyAny>,
        camera_to_world: Option<&Bound<'_, PyAny>>,
        timestamp: Option<f64>,
        name: Option<String>,
        depth_scale: Option<f64>,
    ) -> PyResult<Step> {
        let (color, depth) = (color_image(rgb, "rgb")?, depth_image(depth, depth_scale)?);
        let (camera, pose) = (intrinsics(k, color.size())?, camera_to_world.map(pose).transpose()?);
        let pose = pose.map(|stated| self.pose_format.pose(&stated));
        let mut guard = self.lock()?;
        let state = &mut *guard;
        let name = name.unwrap_or_else(|| format!("{:06}", state.frames));
        let frame = CameraFrame::new(name, color, depth, camera).map_err(value_error)?;
        let frame = frame.with_timestamp(timestamp.map(time).transpose()?);
        let (result, time) = py.detach(|| in_pool(self.threads.as_ref(), || state.step(frame, pose)));
        drop(guard);
        py.check_signals()?;
        let result = result.map_err(|error| pipeline_error(py, &error))?;
        match result.doubts.first() {
            Some(doubt) if self.strict_input => Err(value_error(format!("{} (strict_input ends the run)", doubt.text))),
            _ => step_result(py, result, time),
        }
    }

    /// Decides from all frames so far which parts of the map are one object. Returns false if nothing can change.
    fn settle(&self, py: Python<'_>) -> PyResult<bool> {
        let mut guard = self.lock()?;
        let state = &mut *guard;
        Ok(py.detach(|| in_pool(self.threads.as_ref(), || state.pipeline.settle())))
    }

    /// The ids of an earlier frame as the map shows them now. With `anchor`, from where the frame is by now: its keyframe
    /// may have moved since.
    #[pyo3(signature = (rgb, depth, k, camera_to_world, ids, regions=None, depth_scale=None, anchor=None))]
    #[allow(clippy::too_many_arguments, reason = "the parts of a frame, and what it showed")]
    fn look_again(
        &self,
        py: Python<'_>,
        rgb: &Bound<'_, PyAny>,
        depth: &Bound<'_, PyAny>,
        k: &Bound<'_, PyAny>,
        camera_to_world: &Bound<'_, PyAny>,
        ids: &Bound<'_, PyAny>,
        regions: Option<&Bound<'_, PyAny>>,
        depth_scale: Option<f64>,
        anchor: Option<Anchor>,
    ) -> PyResult<Py<PyArray2<u32>>> {
        let (color, depth) = (color_image(rgb, "rgb")?, depth_image(depth, depth_scale)?);
        let (camera, pose) = (intrinsics(k, color.size())?, pose(camera_to_world)?);
        let frame = CameraFrame::new("again", color, depth, camera).map_err(value_error)?;
        let regions = regions.map(|regions| id_image(regions, "regions")).transpose()?;
        let guard = self.lock()?;
        let frame = frame.at(match anchor {
            Some((keyframe, then)) => {
                let world_from_keyframe = Pose::from_saved_row_major(then).map_err(value_error)?;
                guard.pipeline.corrected(keyframe, &world_from_keyframe, pose)
            }
            None => pose,
        });
        let mut segments = id_image(ids, "ids")?;
        if let Some(memory) = guard.pipeline.memory() {
            let names = memory.remapped_ids();
            segments = segments.map(|id| *names.get(id).unwrap_or(id));
        }
        let shown = ShownFrame { segments, regions };
        let Some(hindsight) = guard.pipeline.hindsight() else {
            let name = guard.pipeline.method_name();
            return Err(value_error(format!("the method {name} with these settings cannot look at frames again")));
        };
        let again = py.detach(|| in_pool(self.threads.as_ref(), || hindsight.look_again(&frame, &shown)));
        to_array(py, again.map_err(value_error)?.segments)
    }

    /// All objects, as the JSON of `objects.json`.
    fn objects(&self, py: Python<'_>) -> PyResult<String> {
        let mut guard = self.lock()?;
        let state = &mut *guard;
        py.detach(move || {
            let mut list = state.pipeline.object_list();
            list.add_sightings(&state.seen);
            list.to_json()
        })
        .map_err(runtime_error)
    }

    /// Names objects with a callable `(rgb, mask, JSON of the object) -> (label, embedding, score)`; returns for how many it
    /// was called.
    fn name_objects(&self, py: Python<'_>, callable: Py<PyAny>) -> PyResult<usize> {
        let mut guard = self.lock()?;
        let state = &mut *guard;
        let named = py.detach(move || {
            state.pipeline.name_objects(|object| Ok(Python::attach(|py| name_of(py, &callable, object))?))
        });
        named.map_err(|error| match error {
            NameObjectsError::Namer { .. } => raised(py, &error).unwrap_or_else(|| runtime_error(&error)),
            _ => value_error(&error),
        })
    }

    /// Names objects with a network; returns for how many it was asked. Texts are then compared with it, too.
    fn name_with_network(&self, py: Python<'_>, names: &Names) -> PyResult<usize> {
        let mut guard = self.lock()?;
        let state = &mut *guard;
        let mut network = Arc::clone(&names.0);
        state.network = Some(Arc::clone(&network));
        py.detach(|| in_pool(self.threads.as_ref(), || state.pipeline.name_with(&mut network))).map_err(value_error)
    }

    /// Names objects with the namer of the settings; returns for how many it was asked.
    fn finish_names(&self, py: Python<'_>) -> PyResult<usize> {
        let mut guard = self.lock()?;
        let state = &mut *guard;
        py.detach(move || state.pipeline.finish_names()).map_err(runtime_error)
    }

    /// Gives an object the label of a person, or takes its label away.
    #[pyo3(signature = (id, label))]
    fn name_by_hand(&self, id: SegmentId, label: Option<&str>) -> PyResult<()> {
        self.lock()?.pipeline.name_by_hand(id, label).map_err(value_error)
    }

    /// The objects most similar to an embedding, with the similarity.
    fn find(&self, embedding: PyReadonlyArray1<'_, f32>) -> PyResult<Vec<(SegmentId, f32)>> {
        self.lock()?.pipeline.find(&embedding.as_array().to_vec()).map_err(value_error)
    }

    /// The objects that fit a text, with how well they do.
    fn find_text(&self, py: Python<'_>, text: &str) -> PyResult<Vec<(SegmentId, f32)>> {
        let mut guard = self.lock()?;
        let state = &mut *guard;
        let found = py.detach(move || {
            let network = state.network.clone().or_else(|| state.pipeline.names_network());
            let list = state.pipeline.object_list();
            find_objects(&Query::new(text), &list, state.pipeline.names(), network.as_deref())
        });
        Ok(found.map_err(value_error)?.into_iter().map(|found| (found.id, found.score)).collect())
    }

    /// Drops all names.
    fn clear_names(&self) -> PyResult<()> {
        self.lock()?.pipeline.clear_names();
        Ok(())
    }

    /// Saves the memory.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let mut guard = self.lock()?;
        let state = &mut *guard;
        let saved = py.detach(move || {
            map_of(state)?;
            Ok::<_, PyErr>(state.pipeline.save_memory(&path))
        });
        saved?.map(drop).map_err(runtime_error)
    }

    /// True if a depth predictor is used in place of measured depth.
    #[getter]
    fn predicts_all_depth(&self) -> PyResult<bool> {
        Ok(self.lock()?.pipeline.map_scale().is_some())
    }

    /// True if the method has a memory.
    #[getter]
    fn has_memory(&self) -> PyResult<bool> {
        Ok(self.lock()?.pipeline.map().is_some())
    }

    /// Number of Gaussians.
    fn gaussian_count(&self) -> PyResult<usize> {
        Ok(map_of(&*self.lock()?)?.gaussian_count())
    }

    /// Centres, world coordinates, metres, `(Gaussians, 3)`.
    fn means(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f64>>> {
        let guard = self.lock()?;
        let map = map_of(&guard)?;
        to_rows(py, map.means.iter().map(|mean| (mean.as_dvec3() + map.origin).to_array()))
    }

    /// Standard deviations, metres, `(Gaussians,)`.
    fn radii(&self, py: Python<'_>) -> PyResult<Py<PyArray1<f32>>> {
        Ok(PyArray1::from_slice(py, map_of(&*self.lock()?)?.radii).unbind())
    }

    /// Colours, sRGB, `(Gaussians, 3)`.
    fn colors(&self, py: Python<'_>) -> PyResult<Py<PyArray2<u8>>> {
        to_rows(py, map_of(&*self.lock()?)?.colors.iter().copied())
    }

    /// True for each Gaussian whose distance is known, `(Gaussians,)`.
    fn has_place(&self, py: Python<'_>) -> PyResult<Py<PyArray1<bool>>> {
        let guard = self.lock()?;
        let surfaces = map_of(&guard)?.surfaces.iter();
        Ok(PyArray1::from_iter(py, surfaces.map(|surface| surface.has_place())).unbind())
    }

    /// The id of each Gaussian, `(Gaussians,)`.
    fn segment_ids(&self, py: Python<'_>) -> PyResult<Py<PyArray1<u32>>> {
        Ok(PyArray1::from_vec(py, map_of(&*self.lock()?)?.segment_ids()).unbind())
    }
}

impl Pipeline {
    /// Locks the state. Fails if another thread, or the segmenter's own code, is using it.
    fn lock(&self) -> PyResult<MutexGuard<'_, State>> {
        match self.state.try_lock() {
            Ok(state) => Ok(state),
            Err(TryLockError::WouldBlock) => {
                Err(PyRuntimeError::new_err("the pipeline is processing a frame: use it from one thread at a time"))
            }
            Err(TryLockError::Poisoned(_)) => {
                Err(PyRuntimeError::new_err("an earlier step panicked: create a new pipeline"))
            }
        }
    }
}

impl State {
    /// Processes the next frame; returns its result and the time that the library took.
    fn step(&mut self, frame: CameraFrame<'_>, pose: Option<Pose>) -> (Result<FrameResult, PipelineError>, Duration) {
        let stamp = FrameStamp {
            number: self.frames,
            name: Some(frame.name().to_owned()),
            file: None,
            time_s: frame.timestamp().map(|time| time.as_secs_f64()),
        };
        let size = (frame.width(), frame.height());
        let started = Instant::now();
        let result = match pose {
            Some(pose) => self.pipeline.step(&frame.at(pose)),
            None => self.pipeline.step_unposed(frame),
        };
        let time = started.elapsed();
        if let Ok(result) = &result {
            self.seen.remap(&result.remapped);
            self.seen.record(&stamp, size, &result.objects);
            self.frames += 1;
        }
        (result, time)
    }
}

/// Runs work in a pipeline's own thread pool, if there is one, or in the process's.
fn in_pool<R: Send>(pool: Option<&ThreadPool>, work: impl FnOnce() -> R + Send) -> R {
    match pool {
        Some(pool) => pool.install(work),
        None => work(),
    }
}

/// Refuses keyword arguments for segmenters of the library: the segmenter is a function. A file may have them, as that of
/// an earlier run.
fn refuse_settings_of_segmenters(all: &SettingsLayers, given: &SettingsLayers) -> PyResult<()> {
    let is_of_segmenter = |need: &Requirement| need.choices().iter().any(|choice| choice.key == "segmenter");
    // No setting of segmenters is used by both.
    for other in ["masks", "graph"] {
        let mut all = all.clone();
        all.add("segmenter", other);
        for error in all.unused() {
            if let SettingsError::Unused { key, need, .. } = &error
                && given.get(key).is_some()
                && is_of_segmenter(need)
            {
                let message = format!("{key} is not used here: it needs {need}, but segmenter is a function");
                return Err(value_error(message));
            }
        }
    }
    Ok(())
}

/// The settings as JSON. Functions of Python have a name there, and no settings.
fn shown_settings(
    mut settings: Settings,
    is_segmenter_function: bool,
    predictor_function: Option<PredictedDepthUse>,
) -> PyResult<serde_json::Value> {
    if is_segmenter_function {
        // Has no settings.
        settings.segmenter = SegmenterSettings::of(MaskFolderSettings::default());
    }
    if predictor_function.is_some() {
        settings.depth_predictor = None;
    }
    let mut shown = serde_json::to_value(&settings).map_err(runtime_error)?;
    if let Some(segmenter) = shown.get_mut("segmenter").filter(|_| is_segmenter_function) {
        *segmenter = FUNCTION_NAME.into();
    }
    if let Some(used) = predictor_function {
        shown["depth_predictor"] = FUNCTION_NAME.into();
        shown["predicted_depth"] = serde_json::to_value(used).map_err(runtime_error)?;
    }
    Ok(shown)
}

fn map_of(state: &State) -> PyResult<MapView<'_>> {
    let name = state.pipeline.method_name();
    state.pipeline.map().ok_or_else(|| value_error(format!("the method {name} has no memory")))
}

fn step_result(
    py: Python<'_>,
    FrameResult { output, regions, objects, times, pose, anchor, turn: _, remapped, events: _, doubts }: FrameResult,
    time: Duration,
) -> PyResult<Step> {
    for doubt in doubts {
        let text = CString::new(doubt.text).map_err(runtime_error)?;
        PyErr::warn(py, &py.get_type::<PyUserWarning>(), &text, 2)?;
    }
    let ids = to_array(py, output.segments.clone())?;
    let confidence = to_array(py, output.confidence)?;
    let masks = |masks: &[(SegmentId, Mask)]| {
        // In the order of the objects, which omit empty masks.
        let of = |id: SegmentId| masks.iter().find(|(other, _)| *other == id).map(|(_, mask)| mask);
        to_masks(py, objects.iter().filter_map(|object| of(object.id)), output.segments.size())
    };
    let masks = if output.masks.is_empty() { None } else { Some(masks(&output.masks)?.into_any()) };
    let whole = ("step".to_owned(), time.as_secs_f64() * 1e3);
    let stages = times
        .stages()
        .iter()
        .map(|(stage, time)| ((*stage).to_owned(), time.as_secs_f64() * 1e3))
        .chain([whole])
        .collect();
    let sightings = objects.iter().map(|object| {
        let inner = object.bounding_box;
        let inner = (inner.x, inner.y, inner.width, inner.height);
        (object.id, object.area, inner, object.confidence, object.first_frame, object.last_frame)
    });
    let state = match pose.state {
        PoseState::Given => "given",
        PoseState::Tracked => "tracked",
        PoseState::Lost => "lost",
    };
    let matrix = pose.world_from_camera.to_matrix().transpose().to_cols_array_2d();
    let matrix = to_rows(py, matrix.into_iter())?;
    let remapped = remapped.iter().map(|ids| (ids.from, ids.into)).collect();
    let regions = regions.map(|regions| to_array(py, regions)).transpose()?;
    let anchor = (anchor.keyframe, anchor.world_from_keyframe.to_row_major());
    Ok((ids, confidence, sightings.collect(), masks, stages, matrix, state, remapped, regions, anchor))
}

/// The name that a callable gives an object.
fn name_of(
    py: Python<'_>,
    callable: &Py<PyAny>,
    ObjectToName { object, view, .. }: ObjectToName<'_>,
) -> PyResult<ObjectName> {
    let size = view.image.size();
    let rgb = to_color_array(py, view.image.pixels(), size)?;
    let mask = to_plain_array(py, view.mask.pixels(), size)?;
    let object = serde_json::to_string(object).map_err(runtime_error)?;
    let named = callable.bind(py).call1((rgb, mask, object))?;
    let (label, embedding, score): (Option<String>, PyReadonlyArray1<'_, f32>, Option<f32>) = named.extract()?;
    Ok(ObjectName { label, embedding: embedding.as_array().to_vec(), score, ..ObjectName::default() })
}

/// The exception raised by a segmenter in Python, or the error as `RuntimeError`.
fn pipeline_error(py: Python<'_>, error: &PipelineError) -> PyErr {
    raised(py, error).unwrap_or_else(|| runtime_error(error))
}

/// The Python exception that caused an error.
fn raised(py: Python<'_>, error: &(dyn Error + 'static)) -> Option<PyErr> {
    let mut source = Some(error);
    while let Some(inner) = source {
        if let Some(raised) = inner.downcast_ref::<PyErr>() {
            return Some(raised.clone_ref(py));
        }
        source = inner.source();
    }
    None
}

/// The camera with a 3×3 matrix.
pub fn intrinsics(k: &Bound<'_, PyAny>, (width, height): (usize, usize)) -> PyResult<Intrinsics> {
    const MEANING: &str = "the camera's matrix [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels";
    let k = numbers(k, "K", &[3, 3], MEANING)?;
    let rest = [k[1], k[3], k[6], k[7], k[8] - 1.0];
    if rest.iter().any(|number| number.abs() > 1e-6) {
        return Err(value_error(format!(
            "K is [[{}, {}, {}], [{}, {}, {}], [{}, {}, {}]], expected {MEANING}",
            k[0], k[1], k[2], k[3], k[4], k[5], k[6], k[7], k[8]
        )));
    }
    let [fx, fy, cx, cy] = [k[0], k[4], k[2], k[5]].map(|number| number as f32);
    Intrinsics { fx, fy, cx, cy, width, height }.validated().map_err(value_error)
}

/// The pose with a 4×4 matrix.
pub fn pose(matrix: &Bound<'_, PyAny>) -> PyResult<Pose> {
    let meaning = "the matrix from the camera's to the world's coordinates";
    let entries = numbers(matrix, "camera_to_world", &[4, 4], meaning)?;
    let entries: [f64; 16] = entries.try_into().map_err(|_| value_error("not 4x4"))?;
    let wrong = |error: &dyn std::fmt::Display| value_error(format!("camera_to_world: {error}"));
    Pose::from_row_major(entries).map_err(|error| wrong(&error))
}

/// The last time of messages in ROS 2.
const LAST_TIME: Duration = Duration::from_secs(i32::MAX as u64);

/// A time in seconds.
fn time(seconds: f64) -> PyResult<Duration> {
    let time = Duration::try_from_secs_f64(seconds).ok().filter(|time| *time <= LAST_TIME);
    time.ok_or_else(|| {
        let expected = "seconds, from 0 to 2147483647 (before 2038), not another unit";
        value_error(format!("timestamp is {seconds}, expected {expected}"))
    })
}
