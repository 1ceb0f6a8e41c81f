//! The frames of a run that were written, to bring their results up to date at the end: a loop closure corrects earlier
//! poses, and shows that ids are the same object.

use super::saved_run::SavedFrame;
use super::shown_frames;
use splatseg_geometry::{CameraFrame, KeyframeId, Pose, RgbdFrame, SegmentId};
use splatseg_objects::{ObjectList, RemapLog};
use splatseg_odometry::{KeyframePlace, PoseState};
use splatseg_output::FrameRecord;
use splatseg_tracking::{FrameOutput, Hindsight, ShownFrame, TrackingError};
use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::ops::Range;

/// The written frames, in order. A frame's position is its place among them.
#[derive(Debug, Default)]
pub struct FrameHistory {
    frames: Vec<WrittenFrame>,
    /// Keyframe and pose of the keyframe for all frames from a position on. Few, as most frames have that of the frame
    /// before.
    anchors: Vec<(usize, KeyframeId, Pose)>,
    remaps: RemapLog,
}

/// A frame whose images were written.
#[derive(Debug)]
pub struct WrittenFrame {
    /// Its number in the run.
    pub number: usize,
    /// Its index in the scene.
    pub index: usize,
    /// Name of its result files, without folder and extension.
    pub file_name: String,
    /// The camera's pose when it was written.
    pub world_from_camera: Pose,
    /// Whether that was known.
    pub pose_state: PoseState,
    /// The ids of its objects when it was written.
    ids: Vec<SegmentId>,
}

/// A frame to be decided again.
#[derive(Debug)]
pub struct EarlierFrame<'h> {
    /// The frame when it was written.
    pub written: &'h WrittenFrame,
    /// The frame with its final pose.
    pub frame: RgbdFrame<'static>,
    /// Its segments.
    pub shown: ShownFrame,
}

impl EarlierFrame<'_> {
    /// Decides the frame again. One whose pose is unknown shows what it showed: the map cannot be looked at from there.
    ///
    /// # Errors
    /// As [`Hindsight::look_again`].
    pub fn decided(&self, hindsight: &dyn Hindsight) -> Result<FrameOutput, TrackingError> {
        match self.written.pose_state {
            PoseState::Lost => Ok(FrameOutput::from_segments(self.shown.segments.clone())),
            _ => hindsight.look_again(&self.frame, &self.shown),
        }
    }
}

impl FrameHistory {
    /// Adds a frame whose images were written.
    pub fn add(&mut self, record: &FrameRecord) {
        let frame = SavedFrame::new(record);
        self.add_saved(record.number, &frame);
    }

    /// Adds a frame of the run that this one resumes.
    pub fn add_saved(&mut self, number: usize, frame: &SavedFrame) {
        let position = self.frames.len();
        self.remaps.add(position, &frame.remapped);
        let anchor = (frame.keyframe, frame.world_from_keyframe);
        if self.anchors.last().is_none_or(|(_, keyframe, pose)| (*keyframe, *pose) != anchor) {
            self.anchors.push((position, anchor.0, anchor.1));
        }
        self.frames.push(WrittenFrame {
            number,
            index: frame.index,
            file_name: frame.file_name.clone(),
            world_from_camera: frame.world_from_camera,
            pose_state: frame.pose_state,
            ids: frame.objects.iter().map(|object| object.id).collect(),
        });
    }

    /// The frames, in order.
    pub fn written(&self) -> &[WrittenFrame] {
        &self.frames
    }

    /// The ids that turned out to be the same object, by the position of the frame that brought them.
    pub fn remaps(&self) -> &RemapLog {
        &self.remaps
    }

    /// The frames with ids that have changed, with their positions and the changes.
    pub fn changed(&self) -> impl Iterator<Item = (usize, &WrittenFrame, BTreeMap<SegmentId, SegmentId>)> {
        self.frames.iter().enumerate().filter_map(|(position, frame)| {
            let mut ids = self.remaps.final_ids(position);
            ids.retain(|from, _| frame.ids.contains(from));
            (!ids.is_empty()).then_some((position, frame, ids))
        })
    }

    /// Number of frames that are in another part of the map than the first one. `keyframes` are those at the end.
    pub fn unjoined_frames(&self, keyframes: &BTreeMap<KeyframeId, KeyframePlace>) -> usize {
        let Some(first) = keyframes.values().map(|keyframe| keyframe.part).min() else { return 0 };
        let in_other_part = |keyframe| keyframes.get(keyframe).is_some_and(|keyframe| keyframe.part != first);
        let ranges = self.ranges().filter(|(keyframe, ..)| in_other_part(keyframe));
        let frames = ranges.flat_map(|(.., range)| self.frames.get(range).unwrap_or_default());
        frames.filter(|frame| frame.pose_state != PoseState::Lost).count()
    }

    /// The keyframes in use, each with its pose at the time and the positions of its frames.
    fn ranges(&self) -> impl Iterator<Item = (&KeyframeId, &Pose, Range<usize>)> {
        let ends = self.anchors.iter().skip(1).map(|(start, ..)| *start).chain([self.frames.len()]);
        self.anchors.iter().zip(ends).map(|((start, keyframe, pose), end)| (keyframe, pose, *start..end))
    }

    /// For each frame, the correction of its pose: new world coordinates from old ones. `None` if its keyframe has not
    /// moved. `keyframes` are those at the end.
    pub fn pose_corrections(&self, keyframes: &BTreeMap<KeyframeId, KeyframePlace>) -> Vec<Option<Pose>> {
        let mut corrections = vec![None; self.frames.len()];
        for (keyframe, before, range) in self.ranges() {
            let now = keyframes.get(keyframe).map(|keyframe| &keyframe.world_from_keyframe);
            let correction = now.and_then(|now| before.motion_to(now));
            corrections.get_mut(range).unwrap_or_default().fill(correction);
        }
        corrections
    }

    /// A frame with its final pose, and what it showed with the names that ids have by now. `position` is its place among the
    /// frames, `frame` what was recorded, `line` what [`shown_frames`](super::shown_frames) keeps of it, and `corrections` what
    /// [`Self::pose_corrections`] returns.
    ///
    /// # Errors
    /// If the line is damaged.
    pub fn earlier(
        &self,
        position: usize,
        (frame, line): (CameraFrame<'static>, &str),
        corrections: &[Option<Pose>],
    ) -> io::Result<EarlierFrame<'_>> {
        let written = self.frames.get(position).ok_or(io::ErrorKind::InvalidInput)?;
        let mut shown = shown_frames::parsed(line, (frame.width(), frame.height()))?;
        let names = self.remaps.final_ids(position);
        if !names.is_empty() {
            shown.segments = shown.segments.map(|id| *names.get(id).unwrap_or(id));
        }
        let correction = corrections.get(position).copied().flatten().unwrap_or(Pose::IDENTITY);
        Ok(EarlierFrame { written, frame: frame.at(correction * written.world_from_camera), shown })
    }

    /// Sets the number of frames that show each joined object. The log of objects counts frames twice that showed both
    /// parts.
    pub fn count_remapped(&self, list: &mut ObjectList) {
        let joined: BTreeSet<SegmentId> = self.remaps.entries().iter().map(|(_, remapped)| remapped.into).collect();
        if joined.is_empty() {
            return;
        }
        let mut counts: BTreeMap<SegmentId, usize> = BTreeMap::new();
        for (position, frame) in self.frames.iter().enumerate() {
            let finals = self.remaps.final_ids(position);
            let ids: BTreeSet<SegmentId> = frame.ids.iter().map(|id| *finals.get(id).unwrap_or(id)).collect();
            ids.intersection(&joined).for_each(|id| *counts.entry(*id).or_default() += 1);
        }
        list.set_frames(&counts);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use splatseg_geometry::RemappedId;
    use splatseg_objects::{BoundingBox, ObjectLog, ObjectSighting};

    fn at(x: f64) -> Pose {
        Pose::from_translation(DVec3::new(x, 0.0, 0.0))
    }

    fn frame(index: usize, ids: &[SegmentId], keyframe: (KeyframeId, f64), remapped: &[(u32, u32)]) -> SavedFrame {
        let bounding_box = BoundingBox { x: 0, y: 0, width: 1, height: 1 };
        let sighting = |id: &SegmentId| ObjectSighting {
            id: *id,
            area: 1,
            bounding_box,
            confidence: 1.0,
            first_frame: 0,
            last_frame: index,
        };
        SavedFrame {
            index,
            file_name: index.to_string(),
            world_from_camera: at(0.0),
            pose_state: PoseState::Tracked,
            keyframe: keyframe.0,
            world_from_keyframe: at(keyframe.1),
            objects: ids.iter().map(sighting).collect(),
            remapped: remapped.iter().map(|(from, into)| RemappedId { from: *from, into: *into }).collect(),
        }
    }

    #[test]
    fn frames_follow_their_keyframe_and_their_ids() {
        let mut history = FrameHistory::default();
        history.add_saved(0, &frame(10, &[3, 5], (0, 0.0), &[]));
        history.add_saved(1, &frame(11, &[3], (0, 0.0), &[]));
        history.add_saved(2, &frame(12, &[5], (1, 1.0), &[]));
        // Keyframe 1 moves here.
        history.add_saved(3, &frame(13, &[3, 9], (1, 1.5), &[(5, 3)]));
        let changed: Vec<(usize, usize)> =
            history.changed().map(|(position, frame, _)| (position, frame.index)).collect();
        assert_eq!(changed, [(0, 10), (2, 12)]);
        let keyframes = |parts: [u32; 2]| {
            let place = |x, part| KeyframePlace { world_from_keyframe: at(x), part };
            BTreeMap::from([(0, place(0.0, parts[0])), (1, place(1.5, parts[1]))])
        };
        assert_eq!(history.pose_corrections(&keyframes([0, 0])), [None, None, Some(at(0.5)), None]);
        assert_eq!(history.pose_corrections(&BTreeMap::new()), [None; 4]);
        assert_eq!(history.unjoined_frames(&keyframes([0, 1])), 2);
        assert_eq!(history.unjoined_frames(&keyframes([1, 1])), 0);
        let mut list = ObjectList::new(&ObjectLog::default(), None);
        history.count_remapped(&mut list);
        assert!(list.objects.is_empty());
    }
}
