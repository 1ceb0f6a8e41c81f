//! The node: its threads for topics and for services.

use crate::endpoints::Endpoints;
use crate::outlet::{Ros2Outlet, Shared};
use crate::parameters::{self, ParameterValue, Parameters};
use crate::service::Service;
use crate::sim_time::SimTime;
use crate::subscriptions::Subscriptions;
use crate::{Domain, NodeName, Ros2Error, receive_buffer, requests};
use splatseg_live::{LiveStream, Requests};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Wake, Waker};
use std::thread::{JoinHandle, Thread};
use std::time::{Duration, Instant};

/// Time between two looks at what others publish and subscribe to.
const DISCOVERY: Duration = Duration::from_millis(200);
/// Longest time that a message waits if its arrival goes unnoticed, and that the end of the node takes.
const LONGEST_WAIT: Duration = Duration::from_millis(50);

/// Time after which it is reported that nothing is published that the session may use.
const NOTHING_YET: Duration = Duration::from_secs(5);

/// Told what the node does, a sentence each: topics that it subscribes to, and problems.
pub type Report = Box<dyn Fn(&str) + Send>;

/// A node. Dropping it ends its threads.
pub struct Ros2Node {
    endpoints: Endpoints,
    domain: Domain,
    name: NodeName,
    sim_time: SimTime,
    outlet: Option<Arc<Shared>>,
    is_over: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl Ros2Node {
    /// Joins a domain. Others see the node from now on.
    ///
    /// # Errors
    /// [`Ros2Error::Network`] if there is no network.
    pub fn join(domain: Domain, name: NodeName) -> Result<Self, Ros2Error> {
        let endpoints = Endpoints::join(domain, name.clone())?;
        let is_over = Arc::new(AtomicBool::new(false));
        let (sim_time, outlet) = (SimTime::default(), None);
        Ok(Self { endpoints, domain, name, sim_time, outlet, is_over, threads: Vec::new() })
    }

    /// The full name, e.g. `/splatseg`.
    pub fn full_name(&self) -> String {
        self.name.full()
    }

    /// Sets the parameter `use_sim_time`: `/clock` gives the time of messages without a stamp of their own.
    pub fn use_sim_time(&self, is_used: bool) {
        self.sim_time.set_used(is_used);
    }

    /// The outlet that publishes a session's results.
    ///
    /// # Errors
    /// [`Ros2Error::Network`] if no thread can be started.
    pub fn outlet(&mut self) -> Result<Ros2Outlet, Ros2Error> {
        let outlet = Ros2Outlet::start(self.endpoints.clone(), self.full_name(), self.sim_time.clone());
        let outlet = outlet.map_err(|error| self.failed(&error))?;
        self.outlet = Some(outlet.shared());
        Ok(outlet)
    }

    /// Feeds `stream` from now on, and offers services that send `requests`, and `parameters`.
    ///
    /// # Errors
    /// [`Ros2Error::Network`] if a service cannot be offered.
    pub fn start(
        &mut self,
        stream: Arc<LiveStream>,
        requests: &Requests,
        parameters: BTreeMap<String, ParameterValue>,
        report: Report,
    ) -> Result<(), Ros2Error> {
        if let Some(advice) = receive_buffer::advice() {
            report(&advice);
        }
        let name = self.full_name();
        let mut services = requests::services(&self.endpoints, &name, requests)?;
        let parameters = Parameters::new(parameters, self.sim_time.clone());
        services.extend(parameters::services(&self.endpoints, &name, parameters)?);
        let topics = Topics {
            endpoints: self.endpoints.clone(),
            name,
            sim_time: self.sim_time.clone(),
            outlet: self.outlet.clone(),
            stream,
            subscriptions: Subscriptions::new(),
            nothing_since: Some(Instant::now()),
            domain: self.domain,
            report,
        };
        let is_over = || Arc::clone(&self.is_over);
        let (of_topics, of_services) = (is_over(), is_over());
        self.threads.push(self.spawn("ros2-topics", move || topics.run(&of_topics))?);
        self.threads.push(self.spawn("ros2-services", move || answer(services, &of_services))?);
        Ok(())
    }

    fn spawn(&self, name: &str, run: impl FnOnce() + Send + 'static) -> Result<JoinHandle<()>, Ros2Error> {
        std::thread::Builder::new().name(name.to_owned()).spawn(run).map_err(|error| self.failed(&error))
    }

    fn failed(&self, error: &std::io::Error) -> Ros2Error {
        Ros2Error::Network { domain_id: self.domain.id, reason: error.to_string() }
    }
}

impl Drop for Ros2Node {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            thread.thread().unpark();
            // Only a defect ends it early, and its message has been printed.
            let _ = thread.join();
        }
    }
}

/// Wakes a thread.
struct Unpark(Thread);

impl Wake for Unpark {
    fn wake(self: Arc<Self>) {
        self.0.unpark();
    }
}

fn waker() -> Waker {
    Waker::from(Arc::new(Unpark(std::thread::current())))
}

fn answer(mut services: Vec<Service>, is_over: &AtomicBool) {
    let waker = waker();
    while !is_over.load(Ordering::Relaxed) {
        services.iter_mut().for_each(|service| service.answer(&waker));
        std::thread::park_timeout(LONGEST_WAIT);
    }
}

/// State of the thread for topics.
struct Topics {
    endpoints: Endpoints,
    name: String,
    sim_time: SimTime,
    outlet: Option<Arc<Shared>>,
    stream: Arc<LiveStream>,
    subscriptions: Subscriptions,
    /// Since when nothing has been subscribed to; `None` once there is something, or it is reported.
    nothing_since: Option<Instant>,
    domain: Domain,
    report: Report,
}

impl Topics {
    fn run(mut self, is_over: &AtomicBool) {
        let waker = waker();
        let (mut discovered, mut clock) = (None::<Instant>, None);
        while !is_over.load(Ordering::Relaxed) {
            if discovered.is_none_or(|before| before.elapsed() >= DISCOVERY) {
                discovered = Some(Instant::now());
                self.discover();
                if self.sim_time.is_used() && clock.is_none() {
                    clock = SimTime::reader(&self.endpoints).map_err(|error| (self.report)(&error.to_string())).ok();
                }
            }
            if let Some(clock) = &clock {
                self.sim_time.follow(clock);
            }
            if !self.subscriptions.feed(&self.stream, &waker) {
                std::thread::park_timeout(LONGEST_WAIT);
            }
        }
    }

    fn discover(&mut self) {
        match self.subscriptions.update(&self.endpoints, &self.stream) {
            Ok(changes) => changes.iter().for_each(|change| (self.report)(change)),
            Err(error) => (self.report)(&error.to_string()),
        }
        if !self.subscriptions.is_empty() {
            self.nothing_since = None;
        } else if self.nothing_since.is_some_and(|since| since.elapsed() >= NOTHING_YET) {
            self.nothing_since = None;
            let (others, Domain { id, range }) = (Subscriptions::other_topics(&self.endpoints), self.domain);
            (self.report)(&format!("no camera yet: {others} in domain {id}, on {range}"));
        }
        if let Some(outlet) = &self.outlet {
            outlet.update_wanted(&self.endpoints, &self.name);
        }
    }
}
