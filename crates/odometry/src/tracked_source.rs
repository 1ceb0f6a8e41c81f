//! [`TrackedPoses`] as a source of poses: what it gets, tells and saves.

use crate::saved::SavedPoses;
use crate::saved_keyframes;
use crate::{
    CameraPose, InputDoubt, KeyframePlace, MethodFindings, PoseEvent, PoseInput, PoseMode, PoseSource, PoseSourceError,
    PoseState, PoseUpdate, StateScope, TrackedPoses,
};
use splatseg_geometry::{CameraFrame, KeyframeId, Pose, QuarterTurn};
use std::collections::BTreeMap;

impl PoseSource for TrackedPoses {
    fn pose(&mut self, frame: &CameraFrame<'_>, input: PoseInput<'_>) -> Result<PoseUpdate, PoseSourceError> {
        let PoseInput { index, given, corrected } = input;
        self.index = index;
        self.correct_given(corrected);
        self.checks.add(frame, given.filter(|_| self.mode != PoseMode::Track));
        let pose = self.find(frame, given)?;
        self.checks.add_placed(frame, &pose);
        self.images.add(&pose);
        if self.events.iter().any(PoseEvent::changes_axes) {
            self.upright.start_map();
        }
        if pose.state != PoseState::Lost {
            self.upright.add(frame, &pose.world_from_camera);
        }
        Ok(PoseUpdate {
            pose,
            anchor: self.anchor(),
            correction: self.correction.take(),
            events: std::mem::take(&mut self.events),
            doubts: self.checks.take(),
            turn: self.upright.turn(),
        })
    }

    fn receive(&mut self, found: MethodFindings<'_>) {
        self.odometry.remap(found.remapped);
        if let Some(segments) = found.segments {
            self.odometry.set_segments(segments);
        }
    }

    fn keyframes(&self) -> BTreeMap<KeyframeId, KeyframePlace> {
        let place = |(id, world_from_keyframe)| {
            Some((id, KeyframePlace { world_from_keyframe, part: self.map.store.part_of(id)? }))
        };
        self.map.store.poses().into_iter().filter_map(place).collect()
    }

    fn keyframe(&self, id: KeyframeId) -> Option<KeyframePlace> {
        let store = &self.map.store;
        Some(KeyframePlace { world_from_keyframe: store.pose_of(id)?, part: store.part_of(id)? })
    }

    fn turn(&self) -> QuarterTurn {
        self.upright.turn()
    }

    fn finish(&mut self) -> Vec<InputDoubt> {
        let contradictions = self.checks.take_last();
        contradictions.into_iter().chain(self.odometry.focal_doubt()).chain(self.images.doubt()).collect()
    }

    fn save(&self, scope: StateScope) -> Option<Vec<u8>> {
        match scope {
            StateScope::Run => {
                let mut state = self.clone();
                state.start_bridge();
                SavedPoses::of(&state).to_bytes()
            }
            StateScope::Map => saved_keyframes::bytes(&self.map),
        }
    }

    fn restore(&mut self, scope: StateScope, state: &[u8]) -> Result<(), PoseSourceError> {
        match scope {
            StateScope::Run => {
                let saved = SavedPoses::from_bytes(state).map_err(PoseSourceError::State)?;
                saved.restore(self).map_err(PoseSourceError::State)?;
                self.bridge_from = None;
            }
            StateScope::Map => {
                let mut map = saved_keyframes::parsed(state).map_err(PoseSourceError::State)?;
                map.begin_session();
                self.odometry.next_keyframe = map.store.next;
                self.map = map;
            }
        }
        Ok(())
    }
}

impl TrackedPoses {
    /// The frame's pose, by the way that the mode says.
    fn find(&mut self, frame: &CameraFrame<'_>, given: Option<&Pose>) -> Result<CameraPose, PoseSourceError> {
        Ok(match (self.mode, given) {
            (PoseMode::Given | PoseMode::Auto, Some(pose)) => self.given(frame, pose),
            (PoseMode::Given, None) => return Err(PoseSourceError::Missing { frame: frame.name().to_owned() }),
            (PoseMode::Auto, None) if self.has_given => self.bridged(frame),
            (PoseMode::Auto, None) => self.tracked(frame, &Pose::IDENTITY),
            (PoseMode::Track, given) => self.tracked(frame, given.unwrap_or(&Pose::IDENTITY)),
            (PoseMode::Refine, given) => self.refined(frame, given),
        })
    }
}
