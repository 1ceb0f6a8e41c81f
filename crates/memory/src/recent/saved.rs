//! Saved form of the last frames.

use super::sketch::{MAX_SIDE, Sketch, grid};
use super::{CONFIRMING_FRAMES, PreviousFrame, RecentFrames};
use serde::{Deserialize, Serialize};
use splatseg_files::MemoryLimit;
use splatseg_geometry::{Intrinsics, LocalPose, SegmentId, SegmentMap};

/// Saved form of [`RecentFrames`]. Older files lack it or have further fields.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct SavedRecentFrames {
    previous: Option<SavedPreviousFrame>,
    contradicting: Vec<SavedSketch>,
    #[serde(default)]
    far_frames: u8,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[serde(rename = "unplaced")]
    without_pose: Option<SavedIds>,
}

/// A segment map.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct SavedIds {
    width: usize,
    height: usize,
    /// Runs of pixels with the same id, row-major: id and length.
    runs: Vec<(SegmentId, u32)>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct SavedPreviousFrame {
    sketch: SavedSketch,
    /// Runs of pixels with the same id, row-major: id and length.
    ids: Vec<(SegmentId, u32)>,
    motion: LocalPose,
    is_linked: bool,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct SavedSketch {
    intrinsics: Intrinsics,
    #[serde(rename = "world_from_camera")]
    map_from_camera: LocalPose,
    depth: Vec<f32>,
    color: Vec<[u8; 3]>,
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
        let without_pose = self.without_pose.as_ref().map(|ids| SavedIds {
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
        let ids = SavedIds { width, height, runs: self.ids }.restored(highest)?;
        Ok(PreviousFrame { sketch, ids, motion: self.motion, is_linked: self.is_linked })
    }
}

impl SavedIds {
    fn restored(self, highest: SegmentId) -> Result<SegmentMap, String> {
        let Self { width, height, runs } = self;
        if let Some((id, _)) = runs.iter().find(|(id, _)| *id > highest) {
            return Err(format!("the previous frame contains the segment {id}, but the largest id is {highest}"));
        }
        let found = runs.iter().fold(0u64, |sum, (_, length)| sum.saturating_add(u64::from(*length)));
        let (expected, limit) = ((width as u64).saturating_mul(height as u64), MemoryLimit::in_force());
        if found != expected || expected.saturating_mul(4) > limit {
            return Err(format!("the previous frame has {found} ids for {width}x{height} pixels"));
        }
        let pixels = runs.iter().flat_map(|(id, length)| std::iter::repeat_n(*id, *length as usize)).collect();
        SegmentMap::from_pixels(width, height, pixels).map_err(|error| error.to_string())
    }
}

/// Runs of pixels with the same id, row-major: id and length.
fn runs(ids: &SegmentMap) -> Vec<(SegmentId, u32)> {
    ids.pixels().chunk_by(|one, other| one == other).map(|run| (run[0], run.len() as u32)).collect()
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
            ids: vec![(3, 5), (0, 7)],
            motion: LocalPose::IDENTITY,
            is_linked: true,
        };
        let without_pose = Some(SavedIds { width: 2, height: 2, runs: vec![(0, 1), (2, 3)] });
        let contradicting = vec![sketch; CONFIRMING_FRAMES];
        SavedRecentFrames { previous: Some(previous), contradicting, far_frames: 2, without_pose }
    }

    #[test]
    fn recent_frames_are_restored_as_they_were_saved() {
        assert_eq!(RecentFrames::restored(saved(), 3).unwrap().saved(), saved());
        assert_eq!(RecentFrames::restored(SavedRecentFrames::default(), 0).unwrap(), RecentFrames::default());
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
            |saved| saved.previous.as_mut().unwrap().ids[1].1 = u32::MAX,
            |saved| saved.previous.as_mut().unwrap().ids.truncate(1),
            |saved| saved.previous.as_mut().unwrap().ids[0].0 = 4,
        ];
        for (index, change) in changes.into_iter().enumerate() {
            let mut saved = saved();
            change(&mut saved);
            assert!(RecentFrames::restored(saved, 3).is_err(), "change {index}");
        }
    }
}
