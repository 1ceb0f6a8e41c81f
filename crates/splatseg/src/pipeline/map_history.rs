//! A map's history: when objects were seen, and the rooms so far.
//!
//! It is saved with the map as arrays whose names begin with `history`:
//!
//! | Array | Type | |
//! |---|---|---|
//! | `seen.…` | | when objects were seen, see `seen_times.rs` in `objects` |
//! | `run.…` | | the same of the run that goes on, in the state of a stopped run |
//! | `rooms.…` | | the numbers of the rooms so far, see `known_rooms.rs` in `places` |

use super::PipelineError;
use splatseg_files::{StateBlock, StateError};
use splatseg_geometry::{RemappedId, SegmentId};
use splatseg_memory::SplatMemory;
use splatseg_objects::{ObjectSighting, SeenTimes};
use splatseg_odometry::StateScope;
use splatseg_places::KnownRooms;
use std::path::Path;

const SEEN: &str = "seen";
const RUN: &str = "run";
const ROOMS: &str = "rooms";

/// When objects were seen, in earlier runs and in this one, and the rooms so far.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MapHistory {
    earlier: SeenTimes,
    run: SeenTimes,
    /// The rooms of earlier plans.
    pub rooms: KnownRooms,
}

impl MapHistory {
    /// When each object was seen, over all runs of the map.
    pub fn seen(&self) -> SeenTimes {
        let mut seen = self.earlier.clone();
        seen.join(&self.run);
        seen
    }

    /// Adds times at which objects were seen in earlier runs.
    pub(crate) fn add_earlier(&mut self, seen: &SeenTimes) {
        self.earlier.join(seen);
    }

    /// Records a frame of this run with a stamp, seconds: its objects, and the ids that are new ones' from now on.
    pub(super) fn record(&mut self, time_s: Option<f64>, new: &[SegmentId], sightings: &[ObjectSighting]) {
        for id in new {
            self.earlier.forget(*id);
            self.run.forget(*id);
        }
        if let Some(time_s) = time_s {
            self.run.record(time_s, sightings);
        }
    }

    /// Replaces what was recorded of this run.
    pub(super) fn set_run(&mut self, seen: SeenTimes) {
        self.run = seen;
    }

    pub(crate) fn remap(&mut self, remapped: &[RemappedId]) {
        self.earlier.remap(remapped);
        self.run.remap(remapped);
    }

    /// The bytes of a [`StateBlock`], to be saved with a memory: of a map only what is known of its objects. `None` if there
    /// is nothing to save.
    pub(super) fn of_present(&self, memory: &SplatMemory, scope: StateScope) -> Option<Vec<u8>> {
        let mut block = StateBlock::default();
        match scope {
            StateScope::Map => {
                let mut seen = self.seen();
                seen.keep_only(&memory.map().carried_ids());
                block.put_block(SEEN, seen.to_block());
            }
            StateScope::Run => {
                block.put_block(SEEN, self.earlier.to_block());
                block.put_block(RUN, self.run.to_block());
            }
        }
        block.put_block(ROOMS, self.rooms.to_block());
        // The header of six arrays is never too long.
        (!block.is_empty()).then(|| block.to_bytes().unwrap_or_default())
    }

    fn from_bytes(bytes: &[u8]) -> Result<Self, StateError> {
        let mut block = StateBlock::from_bytes(bytes)?;
        Ok(Self {
            earlier: SeenTimes::from_block(&block.take_block(SEEN))?,
            run: SeenTimes::from_block(&block.take_block(RUN))?,
            rooms: KnownRooms::from_block(&block.take_block(ROOMS))?,
        })
    }
}

/// Takes the history of a memory that was loaded from `path`.
pub(super) fn take_history(memory: &mut SplatMemory, path: &Path) -> Result<MapHistory, PipelineError> {
    let damaged = |source| PipelineError::History { path: path.to_owned(), source };
    memory
        .take_history()
        .map_or_else(|| Ok(MapHistory::default()), |bytes| MapHistory::from_bytes(&bytes))
        .map_err(damaged)
}
