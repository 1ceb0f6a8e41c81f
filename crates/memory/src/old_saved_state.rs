//! The state besides the Gaussians in files of version 4, which is text: JSON, with the keyframes and names as texts in
//! it. It is only read.

use crate::patches::SavedPatches;
use crate::recent::{SavedIdRuns, SavedPreviousFrame, SavedRecentFrames, SavedSketch};
use crate::saved_state::SavedState;
use crate::segments::{SavedIds, SavedRelease};
use serde::Deserialize;
use splatseg_files::StateBlock;
use splatseg_geometry::{Intrinsics, KeyframeId, LocalPose, SegmentId, SurfaceKind};

/// Unknown fields, from files of still earlier versions, are ignored, and missing ones mean their default.
#[derive(Default, Deserialize)]
#[serde(default)]
struct OldState {
    ids: OldIds,
    recent: OldRecentFrames,
    anchors: Vec<(KeyframeId, u64)>,
    surfaces: Vec<(SurfaceKind, u64)>,
    /// For each id the larger ones.
    together: Vec<(SegmentId, Vec<SegmentId>)>,
    crowded: Vec<SegmentId>,
    remapped: Vec<[SegmentId; 2]>,
    keyframes: String,
    names: String,
}

#[derive(Default, Deserialize)]
struct OldIds {
    given: u64,
    released: Vec<(SegmentId, u32)>,
}

#[derive(Default, Deserialize)]
struct OldRecentFrames {
    previous: Option<OldPreviousFrame>,
    contradicting: Vec<OldSketch>,
    #[serde(default)]
    far_frames: u8,
    unplaced: Option<OldIdMap>,
}

#[derive(Deserialize)]
struct OldIdMap {
    width: usize,
    height: usize,
    runs: Vec<[u32; 2]>,
}

#[derive(Deserialize)]
struct OldPreviousFrame {
    sketch: OldSketch,
    ids: Vec<[u32; 2]>,
    motion: LocalPose,
    is_linked: bool,
}

#[derive(Deserialize)]
struct OldSketch {
    intrinsics: Intrinsics,
    world_from_camera: LocalPose,
    depth: Vec<f32>,
    color: Vec<[u8; 3]>,
}

/// The state of a file of version 4 in the present form.
///
/// # Errors
/// If the text is not in the form of that version. The values are checked when they are restored.
pub(crate) fn converted(text: &[u8]) -> Result<StateBlock, String> {
    if text.is_empty() {
        return Ok(StateBlock::default());
    }
    let old: OldState = serde_json::from_slice(text).map_err(|error| error.to_string())?;
    let released = old.ids.released.into_iter().map(|(id, sightings)| SavedRelease(id, sightings)).collect();
    let pairs = old.together.into_iter().flat_map(|(id, larger)| larger.into_iter().map(move |other| [id, other]));
    let saved = SavedState {
        ids: SavedIds { given: old.ids.given, released },
        patches: SavedPatches::default(),
        recent: old.recent.converted(),
        anchors: old.anchors,
        surfaces: old.surfaces,
        together: pairs.collect(),
        crowded: old.crowded,
        remapped: old.remapped,
        keyframes: with_text(old.keyframes),
        names: with_text(old.names),
        history: StateBlock::default(),
    };
    Ok(saved.into_block())
}

/// A block with a text that only another part of the program can read.
fn with_text(text: String) -> StateBlock {
    let mut block = StateBlock::default();
    if !text.is_empty() {
        block.put(StateBlock::OLD_TEXT, &[], text.into_bytes());
    }
    block
}

impl OldRecentFrames {
    fn converted(self) -> SavedRecentFrames {
        let Self { previous, contradicting, far_frames, unplaced } = self;
        let previous = previous.map(|OldPreviousFrame { sketch, ids, motion, is_linked }| SavedPreviousFrame {
            sketch: sketch.converted(),
            ids,
            motion,
            is_linked,
        });
        let contradicting = contradicting.into_iter().map(OldSketch::converted).collect();
        let without_pose = unplaced.map(|OldIdMap { width, height, runs }| SavedIdRuns { width, height, runs });
        SavedRecentFrames { previous, contradicting, far_frames, without_pose }
    }
}

impl OldSketch {
    fn converted(self) -> SavedSketch {
        let Self { intrinsics, world_from_camera, depth, color } = self;
        SavedSketch { intrinsics, map_from_camera: world_from_camera, depth, color }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA: &str = r#""intrinsics":{"fx":2.0,"fy":2.0,"cx":0.0,"cy":0.0,"width":2,"height":1}"#;
    const POSE: &str = r#"{"rotation":[1.0,0.0,0.0,0.0,1.0,0.0,0.0,0.0,1.0],"translation":[0.5,0.0,0.0]}"#;

    #[test]
    fn all_parts_of_the_text_are_converted() {
        let sketch = format!(r#"{{{CAMERA},"world_from_camera":{POSE},"depth":[1.5,0.0],"color":[[1,2,3],[4,5,6]]}}"#);
        let previous = format!(r#"{{"sketch":{sketch},"ids":[[3,2]],"motion":{POSE},"is_linked":true}}"#);
        let unplaced = r#"{"width":2,"height":1,"runs":[[1,2]]}"#;
        let recent =
            format!(r#"{{"previous":{previous},"contradicting":[{sketch}],"far_frames":2,"unplaced":{unplaced}}}"#);
        let text = format!(
            r#"{{"ids":{{"given":9,"released":[[4,1],[2,0]]}},"recent":{recent},"anchors":[[0,5],[7,2]],
            "surfaces":[["observed",4],["assumed",3]],"together":[[1,[3,5]],[2,[5]]],"crowded":[8],"remapped":[[6,3]],
            "keyframes":"{{}}","names":"[]","of_an_older_version":1}}"#
        );
        let state = SavedState::from_block(converted(text.as_bytes()).unwrap()).unwrap();
        assert_eq!(state.ids, SavedIds { given: 9, released: vec![SavedRelease(4, 1), SavedRelease(2, 0)] });
        assert_eq!(state.anchors, [(0, 5), (7, 2)]);
        assert_eq!(state.surfaces, [(SurfaceKind::Observed, 4), (SurfaceKind::Assumed, 3)]);
        assert_eq!((state.together, state.crowded), (vec![[1, 3], [1, 5], [2, 5]], vec![8]));
        assert_eq!(state.remapped, [[6, 3]]);
        assert_eq!(state.keyframes.get::<u8>(StateBlock::OLD_TEXT, &[]).unwrap(), b"{}");
        assert_eq!(state.names.get::<u8>(StateBlock::OLD_TEXT, &[]).unwrap(), b"[]");
        let previous = state.recent.previous.unwrap();
        assert_eq!((previous.ids, previous.is_linked), (vec![[3, 2]], true));
        assert_eq!((previous.sketch.depth, previous.sketch.color), (vec![1.5, 0.0], vec![[1, 2, 3], [4, 5, 6]]));
        assert_eq!(previous.motion.translation().x, 0.5);
        assert_eq!((state.recent.contradicting.len(), state.recent.far_frames), (1, 2));
        assert_eq!(state.recent.without_pose.unwrap().runs, [[1, 2]]);
        assert!(converted(b"").unwrap().is_empty() && converted(b"{").is_err() && converted(b"{\"ids\":3}").is_err());
    }
}
