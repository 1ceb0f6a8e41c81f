//! Names of objects, and what they are named from.

use crate::parts::Namer;
use splatseg_geometry::{CameraFrame, RemappedId};
use splatseg_memory::SplatMemory;
use splatseg_objects::{KeptViews, ObjectNames, ObjectSighting};
use splatseg_tracking::FrameOutput;

/// Names, and the views that objects are named from.
#[derive(Default)]
pub(super) struct KeptNames {
    pub(super) names: ObjectNames,
    pub(super) views: Option<KeptViews>,
    /// Names objects after every frame.
    pub(super) namer: Option<Box<dyn Namer>>,
}

impl KeptNames {
    /// Ids turned out to be other ids' objects.
    pub(super) fn remap(&mut self, remapped: &[RemappedId]) {
        self.names.remap(remapped);
        if let Some(views) = &mut self.views {
            views.remap(remapped);
        }
    }

    /// Keeps the views of a frame, and forgets what the ids of new objects stood for.
    pub(super) fn record(&mut self, frame: &CameraFrame, output: &FrameOutput, sightings: &[ObjectSighting]) {
        for id in &output.update.new_segments {
            self.names.forget(*id);
            if let Some(views) = &mut self.views {
                views.forget(*id);
            }
        }
        if let Some(views) = &mut self.views {
            views.record(frame.color(), &output.segments, sightings);
        }
    }

    /// The names of the objects that a memory contains, as bytes; `None` without any.
    pub(super) fn of_present(&self, memory: &SplatMemory) -> Option<Vec<u8>> {
        let mut names = self.names.clone();
        names.keep_only(&memory.map().carried_ids());
        (!names.is_empty()).then(|| names.to_bytes())
    }
}
