//! The keyframes of a map as named arrays, to be saved with the map or with a run.
//!
//! Their names begin with `keyframes` in the file; row `k` of the first ones belongs to keyframe `k`.
//!
//! | Array | Type | |
//! |---|---|---|
//! | `id`, `part`, `session` | `u32 [n]` | number; part of the map; number of the run that made it |
//! | `given_frame` | `i64 [n]` | index of its frame in the source of this run if its pose came with it, else -1 |
//! | `world_from_camera` | `f64 [n, 4, 4]` | pose |
//! | `size` | `u32 [n, 2]` | width and height of the view |
//! | `intrinsics` | `f32 [n, 4]` | fx, fy, cx, cy of the view |
//! | `grey`, `grey_offsets` | `u8`, `u32 [n + 1]` | luminance, compressed: see `keyframes/compact_view.rs` |
//! | `depth`, `depth_offsets` | `u8`, `u32 [n + 1]` | inverse depth, the same |
//! | `color`, `color_offsets` | `u8`, `u32 [n + 1]` | a small colour image: a JPEG file, or no bytes in maps of version 4 |
//! | `feature_points` | `i16 [f, 3]` | places in the camera's coordinates, millimetres |
//! | `feature_descriptors` | `u64 [f, 4]` | 256 bits each |
//! | `feature_offsets` | `u32 [n + 1]` | |
//! | `replaced` | `u32 [r, 2]` | dropped keyframes, each with the one that replaces it |
//! | `replaced_pose` | `f64 [r, 4, 4]` | pose of the dropped one relative to that one |
//! | `edges` | `u32 [e, 2]` | measured relative poses: from, to |
//! | `edge_pose` | `f64 [e, 4, 4]` | pose of `to` in the coordinates of `from` |
//! | `edge_information` | `f64 [e, 6, 6]` | inverse covariance |
//! | `edge_kind` | `u8 [e]` | 0 tracked, 1 loop, 2 given |
//! | `state.json` | text | searches for loops that are under way |
//!
//! The bytes of keyframe `k` in `grey` are those from `grey_offsets[k]` to `grey_offsets[k + 1]`, and so on.

use crate::PoseSourceError;
use crate::graph::{Edge, EdgeKind};
use crate::keyframe_map::KeyframeMap;
use crate::keyframes::{CompactView, StoredFeature, StoredKeyframe, decoded_color};
use crate::old_keyframes;
use crate::read_keyframes::{ReadKeyframes, SearchState};
use splatseg_files::{MemoryLimit, StateBlock, StateError, StateNumber, display_bytes};
use splatseg_geometry::{Image, Intrinsics, KeyframeId, Pose};

/// The bytes of a map's keyframes; `None` if there are none.
pub(crate) fn bytes(map: &KeyframeMap) -> Option<Vec<u8>> {
    if map.store.len() == 0 {
        return None;
    }
    block(map).to_bytes().ok()
}

/// The map of keyframes from [`bytes`].
pub(crate) fn parsed(bytes: &[u8]) -> Result<KeyframeMap, String> {
    map_of(&StateBlock::from_bytes(bytes).map_err(|error| error.to_string())?)
}

/// The arrays of a map's keyframes. Keyframes that [`map_of`] would refuse are left out.
pub(crate) fn block(map: &KeyframeMap) -> StateBlock {
    let is_saved = |keyframe: &&StoredKeyframe| keyframe.view.has_possible_size();
    let is_known = |id: KeyframeId| map.store.get(id).as_ref().is_some_and(is_saved);
    let saved: Vec<&StoredKeyframe> = map.store.iter().filter(is_saved).collect();
    let mut block = keyframes_block(&saved);
    let replaced: Vec<_> = map.store.replaced.iter().collect();
    block.put("replaced", &[2], replaced.iter().flat_map(|(id, (kept, _))| [**id, *kept]));
    block.put("replaced_pose", &[4, 4], replaced.iter().flat_map(|(_, (_, pose))| pose.to_row_major()));
    let edges = || map.graph.edges.iter().filter(|edge| is_known(edge.from) && is_known(edge.to));
    block.put("edges", &[2], edges().flat_map(|edge| [edge.from, edge.to]));
    block.put("edge_pose", &[4, 4], edges().flat_map(|edge| edge.measured.to_row_major()));
    block.put("edge_information", &[6, 6], edges().flat_map(|edge| edge.information.into_iter().flatten()));
    block.put("edge_kind", &[], edges().map(|edge| code(edge.kind)));
    let state = SearchState {
        session: map.session,
        part: map.part,
        next: map.store.next,
        latest: map.latest,
        checks: map.checks.iter().copied().collect(),
        candidates: map.candidates.iter().cloned().collect(),
        closed: map.closed.clone(),
    };
    block.put_json("state.json", &state);
    block
}

/// The map of keyframes from [`block`].
pub(crate) fn map_of(block: &StateBlock) -> Result<KeyframeMap, String> {
    let text: Vec<u8> = block.get(StateBlock::OLD_TEXT, &[]).map_err(|error| error.to_string())?;
    if !text.is_empty() {
        return old_keyframes::converted(&text)?.checked();
    }
    let text = |error: StateError| format!("keyframes: {error}");
    let state: Option<SearchState> = block.get_json("state.json").map_err(text)?;
    ReadKeyframes {
        keyframes: keyframes_of(block)?,
        replaced: replaced_of(block).map_err(text)?,
        edges: edges_of(block).map_err(text)?,
        state: state.ok_or("keyframes: state.json is missing")?,
    }
    .checked()
}

fn code(kind: EdgeKind) -> u8 {
    match kind {
        EdgeKind::Tracked => 0,
        EdgeKind::Loop => 1,
        EdgeKind::Given => 2,
    }
}

fn replaced_of(block: &StateBlock) -> Result<Vec<(KeyframeId, KeyframeId, Pose)>, StateError> {
    let ids = block.get_tuples("replaced")?;
    let poses = poses(block, "replaced_pose", ids.len())?;
    Ok(ids.into_iter().zip(poses).map(|([id, kept], pose)| (id, kept, pose)).collect())
}

fn edges_of(block: &StateBlock) -> Result<Vec<Edge>, StateError> {
    let ids: Vec<[KeyframeId; 2]> = block.get_tuples("edges")?;
    let poses = poses(block, "edge_pose", ids.len())?;
    let information: Vec<f64> = block.get_rows("edge_information", ids.len(), &[6, 6])?;
    let kinds: Vec<u8> = block.get_rows("edge_kind", ids.len(), &[])?;
    let known = [EdgeKind::Tracked, EdgeKind::Loop, EdgeKind::Given];
    let edge = |(index, ([from, to], measured)): (usize, ([KeyframeId; 2], Pose))| {
        let kind = known.into_iter().find(|known| code(*known) == kinds[index]);
        let kind = kind.ok_or_else(|| impossible("edge_kind", &kinds[index], "0, 1 or 2"))?;
        let row = |row: usize| std::array::from_fn(|column| information[36 * index + 6 * row + column]);
        Ok(Edge { from, to, measured, information: std::array::from_fn(row), kind })
    };
    ids.into_iter().zip(poses).enumerate().map(edge).collect()
}

fn poses(block: &StateBlock, name: &str, count: usize) -> Result<Vec<Pose>, StateError> {
    let numbers: Vec<f64> = block.get_rows(name, count, &[4, 4])?;
    let pose = |matrix: &[f64; 16]| {
        Pose::from_saved_row_major(*matrix).map_err(|error| impossible(name, &error, "a rigid pose"))
    };
    numbers.as_chunks().0.iter().map(pose).collect()
}

fn impossible(name: &str, found: &dyn std::fmt::Display, expected: &str) -> StateError {
    StateError::Array { name: name.to_owned(), found: found.to_string(), expected: expected.to_owned() }
}

/// The arrays of keyframes.
pub(crate) fn keyframes_block(keyframes: &[&StoredKeyframe]) -> StateBlock {
    let mut block = StateBlock::default();
    let all = || keyframes.iter();
    block.put("id", &[], all().map(|keyframe| keyframe.id));
    block.put("part", &[], all().map(|keyframe| keyframe.part));
    block.put("session", &[], all().map(|keyframe| keyframe.session));
    let given = |keyframe: &&StoredKeyframe| keyframe.given_frame.map_or(-1, |index| index as i64);
    block.put("given_frame", &[], all().map(given));
    block.put("world_from_camera", &[4, 4], all().flat_map(|keyframe| keyframe.world_from_key.to_row_major()));
    let cameras = || all().map(|keyframe| keyframe.view.intrinsics);
    block.put("size", &[2], cameras().flat_map(|camera| [camera.width as u32, camera.height as u32]));
    block.put("intrinsics", &[4], cameras().flat_map(|camera| [camera.fx, camera.fy, camera.cx, camera.cy]));
    let mut put_images = |name: &str, image: fn(&StoredKeyframe) -> &[u8]| {
        block.put(name, &[], all().flat_map(|keyframe| image(keyframe).iter().copied()));
        block.put(&format!("{name}_offsets"), &[], offsets(all().map(|keyframe| image(keyframe).len())));
    };
    put_images("grey", |keyframe| &keyframe.view.grey);
    put_images("depth", |keyframe| &keyframe.view.depth);
    put_images("color", |keyframe| &keyframe.color);
    let features = || all().flat_map(|keyframe| &keyframe.features);
    block.put("feature_points", &[3], features().flat_map(|feature| feature.point));
    block.put("feature_descriptors", &[4], features().flat_map(|feature| feature.descriptor));
    block.put("feature_offsets", &[], offsets(all().map(|keyframe| keyframe.features.len())));
    block
}

/// Where each part begins, and the end of the last one.
fn offsets(lengths: impl Iterator<Item = usize>) -> Vec<u32> {
    let mut end = 0;
    let ends = lengths.map(|length| {
        end += length as u32;
        end
    });
    std::iter::once(0).chain(ends).collect()
}

/// An array cut into parts, one for each keyframe.
struct Parts<T> {
    entries: Vec<T>,
    offsets: Vec<u32>,
}

impl<T: Copy> Parts<T> {
    fn new(block: &StateBlock, name: &str, count: usize, entries: Vec<T>) -> Result<Self, StateError> {
        let name = format!("{name}_offsets");
        let offsets: Vec<u32> = block.get_rows(&name, count + 1, &[])?;
        let ends = (offsets.first(), offsets.last().map(|end| *end as usize));
        if !offsets.is_sorted() || ends != (Some(&0), Some(entries.len())) {
            return Err(impossible(&name, &"other numbers", "increasing ones from 0 to the number of entries"));
        }
        Ok(Self { entries, offsets })
    }

    /// The bytes of compressed images. In a block without them, all parts are empty.
    fn of_bytes(block: &StateBlock, name: &str, count: usize) -> Result<Parts<u8>, StateError> {
        let bytes: Vec<u8> = block.get(name, &[])?;
        if bytes.is_empty() {
            return Ok(Parts { entries: bytes, offsets: vec![0; count + 1] });
        }
        Parts::new(block, name, count, bytes)
    }

    fn get(&self, index: usize) -> &[T] {
        &self.entries[self.offsets[index] as usize..self.offsets[index + 1] as usize]
    }
}

/// The arrays of keyframes as they are read.
struct KeyframeArrays {
    ids: Vec<KeyframeId>,
    parts: Vec<u32>,
    sessions: Vec<u32>,
    given_frames: Vec<i64>,
    poses: Vec<Pose>,
    sizes: Vec<[u32; 2]>,
    intrinsics: Vec<[f32; 4]>,
    grey: Parts<u8>,
    depth: Parts<u8>,
    color: Parts<u8>,
    features: Parts<StoredFeature>,
}

impl KeyframeArrays {
    fn new(block: &StateBlock) -> Result<Self, StateError> {
        let ids: Vec<KeyframeId> = block.get("id", &[])?;
        let count = ids.len();
        Ok(Self {
            parts: block.get_rows("part", count, &[])?,
            sessions: block.get_rows("session", count, &[])?,
            given_frames: block.get_rows("given_frame", count, &[])?,
            poses: poses(block, "world_from_camera", count)?,
            sizes: tuples(block, "size", count)?,
            intrinsics: tuples(block, "intrinsics", count)?,
            grey: Parts::<u8>::of_bytes(block, "grey", count)?,
            depth: Parts::<u8>::of_bytes(block, "depth", count)?,
            color: Parts::<u8>::of_bytes(block, "color", count)?,
            features: Parts::new(block, "feature", count, features_of(block)?)?,
            ids,
        })
    }

    fn keyframe(&self, index: usize) -> Result<StoredKeyframe, String> {
        let ([fx, fy, cx, cy], [width, height]) = (self.intrinsics[index], self.sizes[index]);
        let intrinsics = Intrinsics { fx, fy, cx, cy, width: width as usize, height: height as usize };
        let [grey, depth, color] = [&self.grey, &self.depth, &self.color].map(|part| part.get(index).to_vec());
        let keyframe = StoredKeyframe {
            id: self.ids[index],
            world_from_key: self.poses[index],
            part: self.parts[index],
            session: self.sessions[index],
            view: CompactView { intrinsics, grey, depth },
            color,
            features: self.features.get(index).to_vec(),
            given_frame: usize::try_from(self.given_frames[index]).ok(),
        };
        keyframe.checked()
    }
}

fn tuples<T: StateNumber, const N: usize>(
    block: &StateBlock,
    name: &str,
    count: usize,
) -> Result<Vec<[T; N]>, StateError> {
    Ok(block.get_rows(name, count, &[N])?.as_chunks().0.to_vec())
}

fn features_of(block: &StateBlock) -> Result<Vec<StoredFeature>, StateError> {
    let points: Vec<[i16; 3]> = block.get_tuples("feature_points")?;
    let descriptors: Vec<[u64; 4]> = tuples(block, "feature_descriptors", points.len())?;
    let feature = |(point, descriptor)| StoredFeature { point, descriptor };
    Ok(points.into_iter().zip(descriptors).map(feature).collect())
}

/// The keyframes of [`keyframes_block`].
///
/// # Errors
/// If an array is damaged, or an image cannot be read.
pub(crate) fn keyframes_of(block: &StateBlock) -> Result<Vec<StoredKeyframe>, String> {
    let arrays = KeyframeArrays::new(block).map_err(|error| format!("keyframes: {error}"))?;
    (0..arrays.ids.len()).map(|index| arrays.keyframe(index)).collect()
}

/// A keyframe of a saved map, as others see it.
#[derive(Clone, Debug)]
pub struct KeyframeView {
    /// Its number.
    pub id: KeyframeId,
    /// Its pose, camera to world.
    pub world_from_camera: Pose,
    /// The camera of its image.
    pub intrinsics: Intrinsics,
    /// z-depth, metres, 0 where missing, `[height, width]`, at most 200 pixels wide.
    pub depth: Image<f32>,
    /// A JPEG file; empty if there is none.
    color: Vec<u8>,
}

impl KeyframeView {
    /// A small colour image of the same view, sRGB, `[height, width]`, at most 320 pixels wide and high. `None` in maps of
    /// earlier versions, or if it is damaged.
    pub fn color(&self) -> Option<Image<[u8; 3]>> {
        decoded_color(&self.color)
    }
}

/// The keyframes that a saved map contains, without those that it has in common with an earlier one: `keyframes` and
/// `earlier` are bytes from [`PoseSource::save`](crate::PoseSource::save) for a map.
///
/// # Errors
/// [`PoseSourceError::State`] if the bytes are damaged, or the views would take more than the memory limit.
pub fn keyframe_views(keyframes: &[u8], earlier: Option<&[u8]>) -> Result<Vec<KeyframeView>, PoseSourceError> {
    let map = |bytes| parsed(bytes).map_err(PoseSourceError::State);
    let earlier = earlier.map(map).transpose()?;
    let is_known = |keyframe: &StoredKeyframe| {
        let same = earlier.as_ref().and_then(|earlier| earlier.store.get(keyframe.id));
        same.is_some_and(|same| same.view == keyframe.view && same.session == keyframe.session)
    };
    let map = map(keyframes)?;
    let others = || map.store.iter().filter(|keyframe| !is_known(keyframe));
    require_memory(others()).map_err(PoseSourceError::State)?;
    let view = |keyframe: &StoredKeyframe| {
        Some(KeyframeView {
            id: keyframe.id,
            world_from_camera: keyframe.world_from_key,
            intrinsics: keyframe.view.intrinsics,
            depth: keyframe.view.depth()?,
            color: keyframe.color.clone(),
        })
    };
    Ok(others().filter_map(view).collect())
}

/// Checks that the depth of keyframes fits into the memory limit.
fn require_memory<'a>(keyframes: impl Iterator<Item = &'a StoredKeyframe>) -> Result<(), String> {
    let bytes = |keyframe: &StoredKeyframe| 4 * keyframe.view.intrinsics.width * keyframe.view.intrinsics.height;
    let (needed, limit) = (keyframes.map(|keyframe| bytes(keyframe) as u64).sum(), MemoryLimit::in_force());
    if needed <= limit {
        return Ok(());
    }
    let (needed, limit) = (display_bytes(needed), display_bytes(limit));
    Err(format!("the views of the keyframes take {needed}, but the memory limit is {limit}: raise memory_limit"))
}
