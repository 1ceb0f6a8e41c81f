//! The memory of one object: only what attention can still see.

use super::assembly::{AssembledMemory, Assembly, DistantPointer, SpatialMemory};
use super::remembered::{RememberedMap, RememberedPointer};
use crate::sam2::Sam2PredictorSettings;
use crate::sam2::config::{MAX_OBJECT_POINTERS, NUM_MASK_MEMORIES};

/// One object's memory of a frame.
#[derive(Clone, Debug)]
struct RememberedFrame {
    frame: usize,
    /// True if a prompt on this frame conditions the tracking.
    conditioning: bool,
    /// `None` once attention can no longer see the frame.
    features: Option<RememberedMap>,
    pointer: RememberedPointer,
}

/// The memory of one object.
#[derive(Clone, Debug, Default)]
pub(crate) struct MemoryBank {
    /// In order of time. A frame that is remembered again keeps its position.
    frames: Vec<RememberedFrame>,
}

impl MemoryBank {
    /// Adds a frame, replacing an earlier memory of it.
    pub fn remember(&mut self, frame: usize, conditioning: bool, features: RememberedMap, pointer: RememberedPointer) {
        let remembered = RememberedFrame { frame, conditioning, features: Some(features), pointer };
        match self.frames.iter_mut().find(|known| known.frame == frame) {
            Some(known) => *known = remembered,
            None => self.frames.push(remembered),
        }
    }

    /// Memory features of a frame.
    pub fn features(&self, frame: usize) -> Option<&RememberedMap> {
        self.frames.iter().find(|known| known.frame == frame)?.features.as_ref()
    }

    /// Indices of the conditioning frames that attention sees: the latest `limit`.
    fn conditioning(&self, limit: Option<usize>) -> Vec<usize> {
        let all = self.frames.iter().filter(|known| known.conditioning).map(|known| known.frame);
        let all: Vec<usize> = all.collect();
        let first = limit.map_or(0, |limit| all.len().saturating_sub(limit));
        all[first..].to_vec()
    }

    /// Forgets everything that no frame after `now` can see.
    pub fn forget(&mut self, now: usize, settings: &Sam2PredictorSettings) {
        let kept = self.conditioning(settings.max_cond_frames_in_attn);
        self.frames.retain_mut(|known| {
            let prompted = kept.contains(&known.frame);
            let age = now - known.frame;
            // `age + 1` is the distance from the next frame.
            if !prompted && age + 1 >= NUM_MASK_MEMORIES {
                known.features = None;
            }
            prompted || age + 1 < MAX_OBJECT_POINTERS
        });
    }

    /// Keeps only the conditioning frames that attention sees.
    pub fn keep_conditioning(&mut self, settings: &Sam2PredictorSettings) {
        let kept = self.conditioning(settings.max_cond_frames_in_attn);
        self.frames.retain(|known| kept.contains(&known.frame));
    }

    /// Assembles the memory for frame `now`: conditioning frames, then the six previous frames from far to near;
    /// pointers of conditioning frames, then of previous frames from near to far (official
    /// `_prepare_memory_conditioned_features`).
    pub fn assemble(&self, now: usize, assembly: &Assembly, settings: &Sam2PredictorSettings) -> AssembledMemory {
        let conditioning = self.conditioning(settings.max_cond_frames_in_attn);
        let (prompted, others): (Vec<_>, Vec<_>) =
            self.frames.iter().partition(|known| conditioning.contains(&known.frame));
        let before = |distance: usize| others.iter().find(|known| known.frame + distance == now);

        let recent = (1..NUM_MASK_MEMORIES).rev();
        let recent = recent.filter_map(|distance| Some((before(distance)?.features.as_ref()?, distance - 1)));
        let spatial = prompted.iter().filter_map(|known| Some((known.features.as_ref()?, NUM_MASK_MEMORIES - 1)));
        let spatial: Vec<SpatialMemory> =
            spatial.chain(recent).map(|(features, temporal_row)| SpatialMemory { features, temporal_row }).collect();

        let longest = settings.video_length.map_or(MAX_OBJECT_POINTERS, |length| length.min(MAX_OBJECT_POINTERS));
        let share = |distance: usize| distance as f32 / (longest.max(2) - 1) as f32;
        let pointers: Vec<DistantPointer> = prompted
            .iter()
            .map(|known| (*known, share(now - known.frame)))
            .chain((1..longest).filter_map(|distance| before(distance).map(|known| (*known, share(distance)))))
            .map(|(known, distance)| DistantPointer { pointer: &known.pointer, distance })
            .collect();
        assembly.assemble(&spatial, &pointers)
    }

    /// Size of the memory in bytes.
    pub fn bytes(&self) -> usize {
        let frame_bytes =
            |known: &RememberedFrame| known.features.as_ref().map_or(0, RememberedMap::bytes) + known.pointer.bytes();
        self.frames.iter().map(frame_bytes).sum()
    }
}
