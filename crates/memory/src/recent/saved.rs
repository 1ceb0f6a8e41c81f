//! Saved form of the last frames: arrays whose names begin with `recent`.
//!
//! | Array | Type | |
//! |---|---|---|
//! | `far_frames` | `u8` | frames in a row that were taken far from the map |
//! | `previous.…`, `contradicting_0.…` to `_2.…` | | a frame each, see the next three |
//! | `….camera.json` | text | intrinsics and pose of the whole frame |
//! | `….depth` | `f32 [rows, columns]` | at every few pixels, metres, 0 where missing |
//! | `….color` | `u8 [rows, columns, 3]` | sRGB, at the same pixels |
//! | `previous.state.json` | text | the camera's motion before the frame |
//! | `previous.ids`, `without_pose.ids` | `u32 [n, 2]` | runs of pixels, row-major: id and length |
//! | `without_pose.size` | `u32 [2]` | width and height of those ids |

use super::sketch::{MAX_SIDE, Sketch, grid};
use super::{CONFIRMING_FRAMES, PreviousFrame, RecentFrames};
use serde::{Deserialize, Serialize};
use splatseg_files::{MemoryLimit, StateBlock, StateError};
use splatseg_geometry::{Intrinsics, LocalPose, SegmentId, SegmentMap};

/// Saved form of [`RecentFrames`].
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct SavedRecentFrames {
    pub previous: Option<SavedPreviousFrame>,
    pub contradicting: Vec<SavedSketch>,
    pub far_frames: u8,
    pub without_pose: Option<SavedIdRuns>,
}

/// A segment map.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SavedIdRuns {
    pub width: usize,
    pub height: usize,
    /// Runs of pixels with the same id, row-major: id and length.
    pub runs: Vec<[u32; 2]>,
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SavedPreviousFrame {
    pub sketch: SavedSketch,
    /// Runs of pixels with the same id, row-major: id and length.
    pub ids: Vec<[u32; 2]>,
    pub motion: LocalPose,
    pub is_linked: bool,
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SavedSketch {
    pub intrinsics: Intrinsics,
    pub map_from_camera: LocalPose,
    pub depth: Vec<f32>,
    pub color: Vec<[u8; 3]>,
}

/// The camera of a [`SavedSketch`], saved as JSON.
#[derive(Serialize, Deserialize)]
struct SketchCamera {
    intrinsics: Intrinsics,
    map_from_camera: LocalPose,
}

/// The part of a [`SavedPreviousFrame`] that is not an array.
#[derive(Serialize, Deserialize)]
struct PreviousState {
    motion: LocalPose,
    is_linked: bool,
}

impl SavedRecentFrames {
    /// The arrays for a file.
    pub fn into_block(self) -> StateBlock {
        let mut block = StateBlock::default();
        if self.far_frames > 0 {
            block.put_number("far_frames", self.far_frames);
        }
        if let Some(SavedPreviousFrame { sketch, ids, motion, is_linked }) = self.previous {
            let mut previous = sketch.into_block();
            previous.put_json("state.json", &PreviousState { motion, is_linked });
            previous.put("ids", &[2], ids.into_iter().flatten());
            block.put_block("previous", previous);
        }
        for (index, sketch) in self.contradicting.into_iter().enumerate() {
            block.put_block(&contradicting(index), sketch.into_block());
        }
        if let Some(SavedIdRuns { width, height, runs }) = self.without_pose {
            block.put("without_pose.size", &[], [width as u32, height as u32]);
            block.put("without_pose.ids", &[2], runs.into_iter().flatten());
        }
        block
    }

    /// Reads the arrays of a file.
    ///
    /// # Errors
    /// If an array has another form than [`Self::into_block`] gives it.
    pub fn from_block(block: &mut StateBlock) -> Result<Self, StateError> {
        let mut previous = block.take_block("previous");
        let state: Option<PreviousState> = previous.get_json("state.json")?;
        let ids = previous.get_tuples("ids")?;
        let previous = SavedSketch::from_block(&mut previous)?.zip(state).map(|(sketch, state)| {
            let PreviousState { motion, is_linked } = state;
            SavedPreviousFrame { sketch, ids, motion, is_linked }
        });
        let sketches = (0..CONFIRMING_FRAMES).map(|index| {
            let mut sketch = block.take_block(&contradicting(index));
            SavedSketch::from_block(&mut sketch)
        });
        let contradicting = sketches.collect::<Result<Vec<_>, _>>()?.into_iter().flatten().collect();
        let size: Vec<u32> = block.get("without_pose.size", &[])?;
        let without_pose = match *size {
            [width, height] => {
                let runs = block.get_tuples("without_pose.ids")?;
                Some(SavedIdRuns { width: width as usize, height: height as usize, runs })
            }
            _ => None,
        };
        Ok(Self { previous, contradicting, far_frames: block.get_number("far_frames")?.unwrap_or(0), without_pose })
    }
}

/// Name of a frame that contradicts the map.
fn contradicting(index: usize) -> String {
    format!("contradicting_{index}")
}

impl SavedSketch {
    fn into_block(self) -> StateBlock {
        let Self { intrinsics, map_from_camera, depth, color } = self;
        let mut block = StateBlock::default();
        let (columns, _) = grid(&intrinsics);
        block.put_json("camera.json", &SketchCamera { intrinsics, map_from_camera });
        block.put("depth", &[columns], depth);
        block.put("color", &[columns, 3], color.into_iter().flatten());
        block
    }

    fn from_block(block: &mut StateBlock) -> Result<Option<Self>, StateError> {
        let camera: Option<SketchCamera> = block.get_json("camera.json")?;
        let Some(SketchCamera { intrinsics, map_from_camera }) = camera else { return Ok(None) };
        let (columns, _) = grid(&intrinsics);
        let depth = block.get("depth", &[columns])?;
        let color: Vec<u8> = block.get("color", &[columns, 3])?;
        Ok(Some(Self { intrinsics, map_from_camera, depth, color: color.as_chunks().0.to_vec() }))
    }
}

impl RecentFrames {
    /// Returns the saved form.
    pub fn saved(&self) -> SavedRecentFrames {
        let previous = self.previous.as_ref().map(|previous| SavedPreviousFrame {
            sketch: previous.sketch.saved(),
            ids: runs(&previous.ids),
            motion: previous.motion,
            is_linked: previous.is_linked,
        });
        let contradicting = self.contradicting.iter().map(Sketch::saved).collect();
        let without_pose = self.without_pose.as_ref().map(|ids| SavedIdRuns {
            width: ids.width(),
            height: ids.height(),
            runs: runs(ids),
        });
        SavedRecentFrames { previous, contradicting, far_frames: self.far_frames, without_pose }
    }

    /// Restores the frames of a memory whose largest id is `highest`.
    ///
    /// # Errors
    /// If the values are invalid, or the ids would take more memory than the limit.
    pub fn restored(saved: SavedRecentFrames, highest: SegmentId) -> Result<Self, String> {
        let SavedRecentFrames { previous, contradicting, far_frames, without_pose } = saved;
        if contradicting.len() > CONFIRMING_FRAMES {
            return Err(format!("{} contradicting frames, expected at most {CONFIRMING_FRAMES}", contradicting.len()));
        }
        let previous = previous.map(|previous| previous.restored(highest)).transpose()?;
        let contradicting = contradicting.into_iter().map(SavedSketch::restored).collect::<Result<_, _>>()?;
        let without_pose = without_pose.map(|ids| ids.restored(highest)).transpose()?;
        Ok(Self { previous, contradicting, far_frames, without_pose, starts_session: false })
    }
}

impl Sketch {
    fn saved(&self) -> SavedSketch {
        let Self { intrinsics, map_from_camera, depth, color } = self.clone();
        SavedSketch { intrinsics, map_from_camera, depth, color }
    }
}

impl SavedSketch {
    fn restored(self) -> Result<Sketch, String> {
        let Self { intrinsics, map_from_camera, depth, color } = self;
        let intrinsics = intrinsics.validated().map_err(|error| error.to_string())?;
        let (columns, rows) = grid(&intrinsics);
        let is_depth = |depth: &f32| depth.is_finite() && *depth >= 0.0;
        let is_complete = columns.max(rows) <= MAX_SIDE && [depth.len(), color.len()] == [columns * rows; 2];
        if !is_complete || !depth.iter().all(is_depth) {
            let (depths, colors) = (depth.len(), color.len());
            return Err(format!("a recent frame has {depths} depths and {colors} colours, expected {columns}x{rows}"));
        }
        Ok(Sketch { intrinsics, map_from_camera, depth, color })
    }
}

impl SavedPreviousFrame {
    fn restored(self, highest: SegmentId) -> Result<PreviousFrame, String> {
        let sketch = self.sketch.restored()?;
        let Intrinsics { width, height, .. } = sketch.intrinsics;
        let ids = SavedIdRuns { width, height, runs: self.ids }.restored(highest)?;
        Ok(PreviousFrame { sketch, ids, motion: self.motion, is_linked: self.is_linked })
    }
}

impl SavedIdRuns {
    fn restored(self, highest: SegmentId) -> Result<SegmentMap, String> {
        let Self { width, height, runs } = self;
        if let Some([id, _]) = runs.iter().find(|[id, _]| *id > highest) {
            return Err(format!("the previous frame contains the segment {id}, but the largest id is {highest}"));
        }
        let found = runs.iter().fold(0u64, |sum, [_, length]| sum.saturating_add(u64::from(*length)));
        let (expected, limit) = ((width as u64).saturating_mul(height as u64), MemoryLimit::in_force());
        if found != expected || expected.saturating_mul(4) > limit {
            return Err(format!("the previous frame has {found} ids for {width}x{height} pixels"));
        }
        let pixels = runs.iter().flat_map(|[id, length]| std::iter::repeat_n(*id, *length as usize)).collect();
        SegmentMap::from_pixels(width, height, pixels).map_err(|error| error.to_string())
    }
}

/// Runs of pixels with the same id, row-major: id and length.
fn runs(ids: &SegmentMap) -> Vec<[u32; 2]> {
    ids.pixels().chunk_by(|one, other| one == other).map(|run| [run[0], run.len() as u32]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn saved() -> SavedRecentFrames {
        let intrinsics = Intrinsics { fx: 50.0, fy: 50.0, cx: 1.5, cy: 1.0, width: 4, height: 3 };
        let sketch = SavedSketch {
            intrinsics,
            map_from_camera: LocalPose::IDENTITY,
            depth: vec![1.0; 12],
            color: vec![[7; 3]; 12],
        };
        let previous = SavedPreviousFrame {
            sketch: sketch.clone(),
            ids: vec![[3, 5], [0, 7]],
            motion: LocalPose::IDENTITY,
            is_linked: true,
        };
        let without_pose = Some(SavedIdRuns { width: 2, height: 2, runs: vec![[0, 1], [2, 3]] });
        let contradicting = vec![sketch; CONFIRMING_FRAMES];
        SavedRecentFrames { previous: Some(previous), contradicting, far_frames: 2, without_pose }
    }

    #[test]
    fn recent_frames_are_restored_as_they_were_saved() {
        assert_eq!(RecentFrames::restored(saved(), 3).unwrap().saved(), saved());
        assert_eq!(RecentFrames::restored(SavedRecentFrames::default(), 0).unwrap(), RecentFrames::default());
        assert_eq!(SavedRecentFrames::from_block(&mut saved().into_block()).unwrap(), saved());
        assert!(SavedRecentFrames::default().into_block().is_empty());
    }

    #[test]
    fn arrays_of_another_size_are_refused() {
        let changes: [fn(&mut StateBlock); 5] = [
            |block| block.put("previous.depth", &[3], [1.0f32; 12]),
            |block| block.put("contradicting_1.color", &[4], [1u8; 36]),
            |block| block.put("previous.ids", &[], [1u32; 4]),
            |block| block.put("previous.state.json", &[], *b"{}"),
            |block| block.put_number("far_frames", 3u32),
        ];
        for (index, change) in changes.into_iter().enumerate() {
            let mut block = saved().into_block();
            change(&mut block);
            assert!(SavedRecentFrames::from_block(&mut block).is_err(), "change {index}");
        }
    }

    #[test]
    fn damaged_ones_are_refused() {
        let changes: [fn(&mut SavedRecentFrames); 9] = [
            |saved| saved.without_pose.as_mut().unwrap().height = 3,
            |saved| saved.contradicting.push(saved.contradicting[0].clone()),
            |saved| saved.contradicting[1].depth.truncate(11),
            |saved| saved.contradicting[1].depth[3] = f32::NAN,
            |saved| saved.contradicting[1].color.push([0; 3]),
            |saved| saved.contradicting[1].intrinsics.fx = 0.0,
            |saved| saved.previous.as_mut().unwrap().ids[1][1] = u32::MAX,
            |saved| saved.previous.as_mut().unwrap().ids.truncate(1),
            |saved| saved.previous.as_mut().unwrap().ids[0][0] = 4,
        ];
        for (index, change) in changes.into_iter().enumerate() {
            let mut saved = saved();
            change(&mut saved);
            assert!(RecentFrames::restored(saved, 3).is_err(), "change {index}");
        }
    }
}
