//! A live session, fed with messages from Python.

use crate::errors::{runtime_error, value_error};
use crate::settings::{add_file, layers, resolve, settings_error};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use pyo3::types::{PyBytes, PyDict};
use splatseg::settings::SettingsLayers;
use splatseg_dataset::MatchLimits;
use splatseg_live::{
    LiveError, LiveOptions, LiveRequest, LiveSession, LiveStatus, LiveStream, Outlet, Output, Requests, SavedMap,
    build_with,
};
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// Longest time that a request waits for the session.
const TIMEOUT: Duration = Duration::from_secs(20);

/// A session on a thread of its own.
#[pyclass(frozen, module = "splatseg._splatseg")]
pub struct Live {
    stream: Arc<LiveStream>,
    requests: Requests,
    results: Arc<SharedResults>,
    is_over: Arc<AtomicBool>,
    thread: Mutex<Option<JoinHandle<Result<(), LiveError>>>>,
}

/// Results that wait for Python: of each kind, the newest message.
#[derive(Default)]
struct SharedResults {
    state: Mutex<Results>,
    has_news: Condvar,
}

#[derive(Default)]
struct Results {
    wanted: BTreeSet<Output>,
    messages: BTreeMap<Output, Vec<u8>>,
    /// The latest message of each kind that is published only when it says something new.
    kept: BTreeMap<Output, Vec<u8>>,
    status: String,
    frames: usize,
}

impl SharedResults {
    fn lock(&self) -> MutexGuard<'_, Results> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

struct PythonOutlet(Arc<SharedResults>);

impl Outlet for PythonOutlet {
    fn wants(&self, output: Output) -> bool {
        self.0.lock().wanted.contains(&output)
    }

    fn publish(&mut self, output: Output, message: Vec<u8>) {
        let mut state = self.0.lock();
        if output.is_seldom() {
            state.kept.insert(output, message.clone());
        }
        if state.wanted.contains(&output) {
            state.messages.insert(output, message);
            self.0.has_news.notify_one();
        }
    }

    fn show(&mut self, status: &LiveStatus) {
        let mut state = self.0.lock();
        state.status = status.to_string();
        state.frames = status.frames;
    }
}

#[pymethods]
impl Live {
    #[new]
    #[pyo3(signature = (settings, map=None, save_interval=30.0, every_frame=false, config=None, lag=0.0))]
    fn new(
        py: Python<'_>,
        settings: &Bound<'_, PyDict>,
        map: Option<PathBuf>,
        save_interval: f64,
        every_frame: bool,
        config: Option<PathBuf>,
        lag: f64,
    ) -> PyResult<Self> {
        let mut all = SettingsLayers::default();
        if let Some(path) = &config {
            add_file(&mut all, path)?;
        }
        let mut all = all.with(layers(settings, None)?);
        let load = map.clone().filter(|map| map.exists());
        if let Some(path) = &load {
            all.add_saved_memory(path).map_err(settings_error)?;
        }
        let mut settings = resolve(&all)?;
        settings.settle_depth_of_stream("dataset.depth = none").map_err(settings_error)?;
        let seconds = |name: &str, value: f64| {
            Duration::try_from_secs_f64(value).map_err(|error| value_error(format!("{name}: {error}")))
        };
        let (save_interval, lag) = (seconds("save_interval", save_interval)?, seconds("lag", lag)?);
        if lag > LiveOptions::MAX_LAG {
            return Err(value_error(format!("lag: found {} s, expected 0 to 10 s", lag.as_secs_f64())));
        }
        let options = LiveOptions { saved_map: map.map(SavedMap::new), save_interval, lag, ..LiveOptions::default() };
        let stream = if every_frame {
            LiveStream::without_drops(&settings.dataset)
        } else {
            LiveStream::new(&settings.dataset, MatchLimits::default())
        };
        let stream = Arc::new(stream.map_err(value_error)?);
        let results = Arc::<SharedResults>::default();
        let outlet: Box<dyn Outlet> = Box::new(PythonOutlet(Arc::clone(&results)));
        let ends = (Arc::clone(&stream), outlet);
        let session = py.detach(|| LiveSession::new(build_with(settings), load.as_deref(), ends, options));
        let mut session = session.map_err(value_error)?;
        let (requests, is_over) = (session.requests(), Arc::new(AtomicBool::new(false)));
        let of_thread = Arc::clone(&is_over);
        let run = move || session.run(&mut || of_thread.load(Ordering::Relaxed));
        let thread = std::thread::Builder::new().name("splatseg-live".to_owned()).spawn(run).map_err(runtime_error)?;
        Ok(Self { stream, requests, results, is_over, thread: Mutex::new(Some(thread)) })
    }

    /// The kinds of messages: name, topic, type, and whether the latest one is for those who come later.
    #[staticmethod]
    fn outputs() -> Vec<(String, &'static str, &'static str, bool)> {
        let described = |output: Output| (name(output), output.topic(), output.type_name(), output.is_latched());
        Output::ALL.map(described).to_vec()
    }

    /// Takes in a message in CDR.
    fn feed(&self, py: Python<'_>, topic: &str, type_name: &str, data: PyBackedBytes) {
        py.detach(|| self.stream.feed(topic, type_name, &data));
    }

    /// True if messages of a topic may be used.
    fn wants(&self, py: Python<'_>, topic: &str, type_name: &str) -> bool {
        py.detach(|| self.stream.wants(topic, type_name))
    }

    /// Sets the kinds of messages that `take` is to return.
    fn set_wanted(&self, names: Vec<String>) -> PyResult<()> {
        let output = |wanted: String| {
            let known = Output::ALL.into_iter().find(|output| name(*output) == wanted);
            known.ok_or_else(|| value_error(format!("{wanted:?}: not a kind of messages")))
        };
        let wanted = names.into_iter().map(output).collect::<PyResult<BTreeSet<Output>>>()?;
        let mut state = self.results.lock();
        let before = std::mem::replace(&mut state.wanted, wanted);
        let new: Vec<(Output, Vec<u8>)> = state
            .kept
            .iter()
            .filter(|(output, _)| state.wanted.contains(output) && !before.contains(output))
            .map(|(output, message)| (*output, message.clone()))
            .collect();
        state.messages.extend(new);
        self.results.has_news.notify_one();
        Ok(())
    }

    /// Waits for messages, for `timeout` seconds at most, and returns the newest of each kind.
    fn take(&self, py: Python<'_>, timeout: f64) -> PyResult<Vec<(String, Py<PyBytes>)>> {
        let timeout = Duration::try_from_secs_f64(timeout).map_err(value_error)?;
        let messages = py.detach(|| {
            let state = self.results.lock();
            let wait = self.results.has_news.wait_timeout_while(state, timeout, |state| state.messages.is_empty());
            std::mem::take(&mut wait.unwrap_or_else(PoisonError::into_inner).0.messages)
        });
        let message = |(output, bytes): (Output, Vec<u8>)| (name(output), PyBytes::new(py, &bytes).unbind());
        Ok(messages.into_iter().map(message).collect())
    }

    /// Executes `save`, `load`, `reset`, `pause` or `resume` between two frames.
    fn request(&self, py: Python<'_>, name: &str) -> PyResult<String> {
        let request = match name {
            "save" => LiveRequest::Save,
            "load" => LiveRequest::Load(None),
            "reset" => LiveRequest::Reset,
            "pause" | "resume" => LiveRequest::Pause(name == "pause"),
            other => return Err(value_error(format!("{other:?}: not a request"))),
        };
        py.detach(|| self.requests.send(request, TIMEOUT)).map_err(PyRuntimeError::new_err)
    }

    /// The objects so far, as in `objects.json`.
    fn objects(&self, py: Python<'_>) -> PyResult<String> {
        let list = py.detach(|| self.requests.look(LiveSession::objects, TIMEOUT)).map_err(PyRuntimeError::new_err)?;
        serde_json::to_string(&list).map_err(runtime_error)
    }

    /// The state in a sentence, about once a second.
    #[getter]
    fn status(&self) -> String {
        self.results.lock().status.clone()
    }

    /// Frames with a result, as of the latest status.
    #[getter]
    fn frames(&self) -> usize {
        self.results.lock().frames
    }

    /// The topics used, one line each; empty until they are chosen.
    #[getter]
    fn sources(&self, py: Python<'_>) -> Vec<String> {
        py.detach(|| self.stream.sources())
    }

    /// Ends the session, after the complete frames if `finish`, otherwise after the present one. Saves the map.
    fn close(&self, py: Python<'_>, finish: bool) -> PyResult<()> {
        self.is_over.fetch_or(!finish, Ordering::Relaxed);
        let ended = py.detach(|| {
            self.stream.end();
            let thread = self.thread.lock().unwrap_or_else(PoisonError::into_inner).take();
            thread.map_or(Ok(Ok(())), JoinHandle::join)
        });
        ended.map_err(|_| PyRuntimeError::new_err("the session has failed"))?.map_err(runtime_error)
    }
}

fn name(output: Output) -> String {
    let mut name = String::new();
    for letter in format!("{output:?}").chars() {
        if letter.is_uppercase() && !name.is_empty() {
            name.push('_');
        }
        name.extend(letter.to_lowercase());
    }
    name
}
