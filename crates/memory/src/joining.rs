//! Puts two maps of one place together: the later one's Gaussians and ids become part of the earlier one.

use crate::correction::{SameObject, merge_doubles, same_objects};
use crate::doubles::Corrected;
use crate::origin::change_of_origin;
use crate::recent::RecentFrames;
use crate::{MemoryError, SplatMemory};
use glam::Vec3;
use splatseg_geometry::{KeyframeId, Pose, RemappedId, SegmentId};
use std::collections::{BTreeMap, BTreeSet};

/// The later map is taken to have been this far away, metres: farther than what a correction of one map moves.
const APART: Vec3 = Vec3::new(4096.0, 0.0, 0.0);

/// The ids of two maps in the map that was made of them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct JoinedIds {
    /// The id that each id of the later map was given at first.
    given: BTreeMap<SegmentId, SegmentId>,
    /// Then, those that turned out to be other ids' objects.
    remapped: Vec<RemappedId>,
}

impl JoinedIds {
    /// The id that an object of the earlier map has now.
    pub fn of_earlier(&self, id: SegmentId) -> SegmentId {
        self.remapped.iter().fold(id, |id, ids| if ids.from == id { ids.into } else { id })
    }

    /// The id that an object of the later map has now; `None` if the map has no such id.
    pub fn of_later(&self, id: SegmentId) -> Option<SegmentId> {
        self.given.get(&id).map(|given| self.of_earlier(*given))
    }

    /// The id that each id of the later map was given before it turned out which are objects of both.
    pub fn given(&self) -> &BTreeMap<SegmentId, SegmentId> {
        &self.given
    }

    /// The ids that turned out to be other ids' objects, in this order.
    pub fn remapped(&self) -> &[RemappedId] {
        &self.remapped
    }
}

/// Two maps may cut the same things differently, and one may have seen only the edge of a thing. Both numbers were chosen on
/// the halves of four videos (tools/compare_merge.py): 96 % of the things were united, and 82 % with the rule for loops.
const OF_TWO_MAPS: SameObject = SameObject { min_iou: 0.25, min_share: 0.05 };

/// Joins a later map: see [`SplatMemory::join`].
pub(crate) fn join(
    memory: &mut SplatMemory,
    mut later: SplatMemory,
    first_keyframe: KeyframeId,
    same: &[RemappedId],
) -> Result<JoinedIds, MemoryError> {
    if !memory.store.can_remap() || !later.store.can_remap() {
        return Err(MemoryError::CannotJoin);
    }
    let own_count = memory.map.len();
    let given = new_ids(memory, &later)?;
    later.store.remap(&given);
    later.patches.remap(&given);
    append(memory, later, first_keyframe, &given)?;
    let known = same.iter().filter_map(|same| Some(RemappedId { from: *given.get(&same.from)?, into: same.into }));
    let mut remapped: Vec<RemappedId> = known.collect();
    memory.remap(&remapped);
    remapped.extend(join_doubles(memory, own_count));
    // No frame has ever shown these ids.
    let new: BTreeSet<SegmentId> = given.values().copied().collect();
    memory.remapped.retain(|from, _| !new.contains(from));
    memory.patches.renumber();
    memory.release_ids(true);
    Ok(JoinedIds { given, remapped })
}

/// A new id for each id of another map.
fn new_ids(memory: &mut SplatMemory, other: &SplatMemory) -> Result<BTreeMap<SegmentId, SegmentId>, MemoryError> {
    let live = other.segments.saved_live();
    let sightings: BTreeMap<SegmentId, u32> = live.iter().map(|live| (live.id, live.sightings)).collect();
    let mut ids: BTreeSet<SegmentId> = sightings.keys().copied().collect();
    ids.extend(other.patches.ids());
    let mut names = BTreeMap::new();
    for id in ids {
        let new = memory.new_segment()?;
        memory.segments.recount(new, 0, sightings.get(&id).copied().unwrap_or(0));
        names.insert(id, new);
    }
    Ok(names)
}

/// Appends another map, whose ids were replaced already.
fn append(
    memory: &mut SplatMemory,
    later: SplatMemory,
    first_keyframe: KeyframeId,
    names: &BTreeMap<SegmentId, SegmentId>,
) -> Result<(), MemoryError> {
    let content = later.store.content().ok_or(MemoryError::CannotJoin)?;
    if !memory.store.append(content) {
        return Err(MemoryError::CannotJoin);
    }
    let moved = change_of_origin(&Pose::IDENTITY, later.origin, memory.origin);
    let map = &mut memory.map;
    map.balls.means.extend(later.map.balls.means.iter().map(|mean| moved.to_world(*mean)));
    map.balls.radii.extend(&later.map.balls.radii);
    map.colors.extend(&later.map.colors);
    map.last_seen.extend(later.map.last_seen.iter().map(|frame| frame.saturating_add(memory.frames)));
    map.seen_through.extend(&later.map.seen_through);
    map.anchors.extend(later.map.anchors.iter().map(|anchor| anchor.saturating_add(first_keyframe)));
    map.surfaces.extend(&later.map.surfaces);
    memory.patches.append(later.patches);
    memory.co_visible.append(&later.co_visible, names);
    memory.frames = memory.frames.saturating_add(later.frames);
    // Two runs have no common previous frame.
    memory.recent = RecentFrames::default();
    Ok(())
}

/// Joins the surfaces and ids that the first `own_count` Gaussians and the others both have.
fn join_doubles(memory: &mut SplatMemory, own_count: usize) -> Vec<RemappedId> {
    let means = &memory.map.balls.means;
    let before: Vec<Vec3> =
        means.iter().enumerate().map(|(index, mean)| if index < own_count { *mean } else { *mean + APART }).collect();
    join_surfaces(memory, &before, OF_TWO_MAPS)
}

/// Joins the surfaces that are there twice since the Gaussians have moved, and the ids on them. `before` contains the
/// centres before, metres.
pub(crate) fn join_surfaces(memory: &mut SplatMemory, before: &[Vec3], rule: SameObject) -> Vec<RemappedId> {
    let balls = &memory.map.balls;
    let corrected = Corrected { before, means: &balls.means, radii: &balls.radii, anchors: &memory.map.anchors };
    let doubles = corrected.doubles();
    if doubles.is_empty() {
        return Vec::new();
    }
    let remapped = same_objects(&doubles, &memory.store.segment_ids(), &balls.radii, &memory.co_visible, rule);
    memory.remap(&remapped);
    let keep = merge_doubles(&mut memory.map, memory.store.as_mut(), &doubles);
    let merged = doubles.iter().filter(|double| !keep[double.later]);
    memory.patches.absorb(&merged.map(|double| (double.later, double.earlier)).collect::<Vec<_>>());
    memory.retain(&keep);
    remapped
}
