//! Names of objects, and what they are named from.

use super::FrameResult;
use super::frame_gate::ClosedGate;
use super::naming_beside::NamingBeside;
use crate::names::ClipNames;
use crate::parts::Namer;
use splatseg_geometry::{CameraFrame, RemappedId};
use splatseg_memory::SplatMemory;
use splatseg_objects::{KeptViews, ObjectNames, ViewedFrame};
use splatseg_odometry::PoseState;
use std::sync::{Arc, Mutex};

/// A namer, also for the thread that names objects beside the frames.
pub(super) type SharedNamer = Arc<Mutex<Box<dyn Namer>>>;

/// Names, and the views that objects are named from.
#[derive(Default)]
pub(super) struct KeptNames {
    pub(super) names: ObjectNames,
    pub(super) views: Option<KeptViews>,
    pub(super) namer: Option<SharedNamer>,
    /// The namer's [`Namer::cpu_share`].
    pub(super) cpu_share: Option<f64>,
    /// The namer's [`Namer::network`].
    pub(super) network: Option<Arc<ClipNames>>,
    pub(super) beside: Option<NamingBeside>,
    /// Objects were named, but labels have not been chosen for all together since.
    pub(super) is_unlabelled: bool,
}

impl KeptNames {
    pub(super) fn set_namer(&mut self, namer: Box<dyn Namer>) {
        (self.cpu_share, self.network) = (namer.cpu_share(), namer.network());
        self.namer = Some(Arc::new(Mutex::new(namer)));
    }

    /// Lets a thread that names beside the frames rest until the guard is dropped.
    pub(super) fn rest_during_frame(&self) -> Option<ClosedGate> {
        self.beside.as_ref().map(NamingBeside::rest_during_frame)
    }

    /// Ids turned out to be other ids' objects.
    pub(super) fn remap(&mut self, remapped: &[RemappedId]) {
        self.names.remap(remapped);
        if let Some(views) = &mut self.views {
            views.remap(remapped);
        }
        if let Some(beside) = &mut self.beside {
            remapped.iter().flat_map(|remapped| [remapped.from, remapped.into]).for_each(|id| beside.forget(id));
        }
    }

    /// Keeps the views of a frame, and forgets what the ids of new objects stood for.
    pub(super) fn record(&mut self, frame: &CameraFrame<'_>, result: &FrameResult) {
        let FrameResult { output, objects, pose, .. } = result;
        for id in &output.update.new_segments {
            self.names.forget(*id);
            if let Some(views) = &mut self.views {
                views.forget(*id);
            }
            if let Some(beside) = &mut self.beside {
                beside.forget(*id);
            }
        }
        if let Some(views) = &mut self.views {
            let known = (pose.state != PoseState::Lost).then_some(&pose.world_from_camera);
            views.record(&ViewedFrame::new(frame, &output.segments, known), objects);
        }
    }

    /// The names of the objects that a memory contains, as bytes; `None` without any.
    pub(super) fn of_present(&self, memory: &SplatMemory) -> Option<Vec<u8>> {
        let mut names = self.names.clone();
        names.keep_only(&memory.map().carried_ids());
        (!names.is_empty()).then(|| names.to_bytes())
    }
}
