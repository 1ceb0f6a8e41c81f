//! Simulated time: the topic `/clock`.

use crate::Ros2Error;
use crate::endpoints::{Endpoints, Quality, Reader};
use serde::Deserialize;
use splatseg_ros::{Time, from_cdr};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};
use std::time::Duration;

/// `rosgraph_msgs/msg/Clock`.
#[derive(Deserialize)]
struct Clock {
    clock: Time,
}

/// The time of `/clock` if `use_sim_time` is set, otherwise that of the system. Clones share it.
#[derive(Clone, Debug, Default)]
pub(crate) struct SimTime(Arc<Shared>);

#[derive(Debug, Default)]
struct Shared {
    is_used: AtomicBool,
    nanoseconds: AtomicI64,
}

impl SimTime {
    pub(crate) fn is_used(&self) -> bool {
        self.0.is_used.load(Ordering::Relaxed)
    }

    pub(crate) fn set_used(&self, is_used: bool) {
        self.0.is_used.store(is_used, Ordering::Relaxed);
    }

    /// The time of `/clock`, zero before its first message; `None` if it is not used.
    pub(crate) fn now(&self) -> Option<Duration> {
        let nanoseconds = || u64::try_from(self.0.nanoseconds.load(Ordering::Relaxed)).unwrap_or(0);
        self.is_used().then(|| Duration::from_nanos(nanoseconds()))
    }

    /// A reader of `/clock`.
    pub(crate) fn reader(endpoints: &Endpoints) -> Result<Reader, Ros2Error> {
        let quality = Quality { reliable: false, latched: false, depth: 1 };
        endpoints.reader("/clock", "rosgraph_msgs/msg/Clock", quality)
    }

    /// Takes over the time that has arrived.
    pub(crate) fn follow(&self, reader: &Reader) {
        reader.drain_read_notifications();
        while let Ok(Some(message)) = reader.try_take_one() {
            if let Ok(Clock { clock }) = from_cdr(&message.into_value().0) {
                self.0.nanoseconds.store(clock.nanoseconds(), Ordering::Relaxed);
            }
        }
    }
}
