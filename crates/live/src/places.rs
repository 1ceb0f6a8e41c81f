//! The plan of a session's map: made beside the frames, and kept until there is a newer one.

use splatseg::Pipeline;
use splatseg::pipeline::{MapPlaces, PlanBeside};
use splatseg_odometry::PoseSourceError;
use splatseg_places::{Cell, PlanSettings};
use std::time::Duration;

/// The latest plan, and what makes the next one.
pub(crate) struct LivePlaces {
    interval: Duration,
    /// `None` until the first plan is wanted.
    beside: Option<PlanBeside>,
    latest: Option<MapPlaces>,
    /// Summary of the latest plan, or the reason why there is none.
    summary: Option<String>,
}

impl LivePlaces {
    /// No plan. Plans will be begun at least `interval` apart.
    pub(crate) fn new(interval: Duration) -> Self {
        Self { interval, beside: None, latest: None, summary: None }
    }

    /// The latest plan, with relations.
    pub(crate) fn latest(&self) -> Option<&MapPlaces> {
        self.latest.as_ref()
    }

    /// Summary of the latest plan, or the reason why there is none; `None` before the first.
    pub(crate) fn summary(&self) -> Option<&str> {
        self.summary.as_deref()
    }

    /// Takes a finished plan and begins the next one, if it is time and `is_wanted`. Returns true if there is a new plan, or
    /// none could be made.
    pub(crate) fn step(&mut self, pipeline: &mut Pipeline, is_wanted: bool) -> bool {
        if !is_wanted && self.beside.is_none() {
            return false;
        }
        let made = self.beside().and_then(|beside| beside.step(pipeline, is_wanted));
        made.map(|made| self.take(made)).is_some()
    }

    /// Notes that objects were merged by hand, which no frame tells.
    pub(crate) fn outdate(&mut self) {
        self.beside.iter_mut().for_each(PlanBeside::outdate);
    }

    /// Makes the plan of the map as it is at the end. Returns as [`Self::step`].
    pub(crate) fn finish(&mut self, pipeline: &mut Pipeline) -> bool {
        let made = self.beside().and_then(|beside| beside.last(pipeline));
        made.map(|made| self.take(made)).is_some()
    }

    /// Forgets the plans of a map that was replaced.
    pub(crate) fn forget(&mut self) {
        *self = Self::new(self.interval);
    }

    fn beside(&mut self) -> Option<&mut PlanBeside> {
        if self.beside.is_none() {
            match PlanBeside::start(PlanSettings::default(), self.interval) {
                Ok(beside) => self.beside = Some(beside),
                Err(error) => self.summary = Some(format!("no thread can make the plan: {error}")),
            }
        }
        self.beside.as_mut()
    }

    fn take(&mut self, made: Result<MapPlaces, PoseSourceError>) {
        self.latest = match made {
            Ok(places) => {
                self.summary = Some(match &places.plan {
                    Ok(plan) => {
                        format!("{:.1} m² free, rooms: {}", plan.grid().area(Cell::Free), plan.rooms().len())
                    }
                    Err(error) => error.to_string(),
                });
                Some(places)
            }
            Err(error) => {
                self.summary = Some(error.to_string());
                None
            }
        };
    }
}
