//! The session's results as topics.

use crate::endpoints::{Endpoints, Quality, Writer};
use crate::names::dds_topic;
use crate::raw_cdr::RawCdr;
use crate::sim_time::SimTime;
use splatseg_live::{LiveStatus, Outlet, Output};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// Longest time that the end waits for readers to get the last messages.
const LAST_MESSAGES: Duration = Duration::from_millis(300);
/// Messages of a topic that is not latched and not large.
const DEPTH: i32 = 10;

/// Publishes messages on a thread of its own. Of each kind, the newest message replaces one that was not sent yet, so a
/// slow network delays no frame.
pub struct Ros2Outlet {
    shared: Arc<Shared>,
    sim_time: SimTime,
    thread: Option<JoinHandle<()>>,
}

/// State shared by the session, the publishing thread and discovery.
pub(crate) struct Shared {
    state: Mutex<State>,
    has_news: Condvar,
}

#[derive(Default)]
struct State {
    wanted: BTreeSet<Output>,
    messages: BTreeMap<Output, Vec<u8>>,
    is_over: bool,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Finds out which topics have subscribers.
    pub(crate) fn update_wanted(&self, endpoints: &Endpoints, node: &str) {
        let readers = endpoints.participant().discovered_readers();
        let topics: BTreeSet<&str> = readers
            .iter()
            .filter(|reader| !endpoints.is_own(reader.reader_proxy.remote_reader_guid))
            .map(|reader| reader.subscription_topic_data.topic_name().as_str())
            .collect();
        let is_wanted = |output: &Output| topics.contains(dds_topic(&output.topic_of(node)).as_str());
        self.lock().wanted = Output::ALL.into_iter().filter(is_wanted).collect();
    }
}

impl Ros2Outlet {
    /// Starts the thread for a node with a full name.
    pub(crate) fn start(endpoints: Endpoints, node: String, sim_time: SimTime) -> std::io::Result<Self> {
        let shared = Arc::new(Shared { state: Mutex::default(), has_news: Condvar::new() });
        let of_thread = Arc::clone(&shared);
        let publish = move || Publishers { endpoints, node, writers: BTreeMap::new() }.run(&of_thread);
        let thread = std::thread::Builder::new().name("ros2-publish".to_owned()).spawn(publish)?;
        Ok(Self { shared, sim_time, thread: Some(thread) })
    }

    pub(crate) fn shared(&self) -> Arc<Shared> {
        Arc::clone(&self.shared)
    }
}

impl Outlet for Ros2Outlet {
    fn wants(&self, output: Output) -> bool {
        self.shared.lock().wanted.contains(&output)
    }

    fn publish(&mut self, output: Output, message: Vec<u8>) {
        self.shared.lock().messages.insert(output, message);
        self.shared.has_news.notify_one();
    }

    fn show(&mut self, _: &LiveStatus) {}

    fn clock(&self) -> Option<Duration> {
        self.sim_time.now()
    }
}

impl Drop for Ros2Outlet {
    fn drop(&mut self) {
        self.shared.lock().is_over = true;
        self.shared.has_news.notify_one();
        if let Some(thread) = self.thread.take() {
            // Only a defect ends it early, and its message has been printed.
            let _ = thread.join();
        }
    }
}

/// The writers, each with its first message or, if anyone is to see the topic before, from the start.
struct Publishers {
    endpoints: Endpoints,
    node: String,
    writers: BTreeMap<Output, Writer>,
}

impl Publishers {
    fn run(mut self, shared: &Shared) {
        // Transforms are published by others, too, and by this node only if it has some.
        let is_shared = |output: &Output| matches!(output, Output::Transform | Output::MapFrame);
        for output in Output::ALL.into_iter().filter(|output| !is_shared(output)) {
            self.writer(output);
        }
        loop {
            let mut state = shared.lock();
            while state.messages.is_empty() && !state.is_over {
                state = shared.has_news.wait(state).unwrap_or_else(PoisonError::into_inner);
            }
            let (messages, is_over) = (std::mem::take(&mut state.messages), state.is_over);
            drop(state);
            for (output, message) in messages {
                if let Some(writer) = self.writer(output)
                    && let Err(error) = writer.write(RawCdr(message), None)
                {
                    tracing::debug!("{}: {error}", output.topic());
                }
            }
            if is_over {
                break;
            }
        }
        for output in [Output::Objects, Output::Markers, Output::Map, Output::SceneGraph] {
            if let Some(writer) = self.writers.get(&output) {
                let _ = writer.wait_for_acknowledgments(LAST_MESSAGES);
            }
        }
    }

    fn writer(&mut self, output: Output) -> Option<&Writer> {
        if !self.writers.contains_key(&output) {
            let depth = if output.is_latched() || matches!(output, Output::Ids | Output::Overlay) { 1 } else { DEPTH };
            let quality = Quality { reliable: true, latched: output.is_latched(), depth };
            match self.endpoints.writer(&output.topic_of(&self.node), output.type_name(), quality) {
                Ok(writer) => drop(self.writers.insert(output, writer)),
                Err(error) => tracing::warn!("{}: {error}", output.topic()),
            }
        }
        self.writers.get(&output)
    }
}
