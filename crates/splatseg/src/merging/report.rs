//! Report of a merge: `splatseg merge --json`, and the Python function.

use super::changed::Changed;
use super::names::LabelConflict;
use crate::pipeline::NamedMap;
use serde::Serialize;
use splatseg_geometry::SegmentId;
use splatseg_memory::JoinedIds;
use splatseg_objects::MapChanges;
use splatseg_odometry::MapFit;
use std::collections::{BTreeMap, BTreeSet};

/// Report of a merge. docs/MERGING.md describes each key.
#[derive(Clone, Debug, Serialize)]
pub struct MergeReport {
    /// [`MergeReport::FORMAT`].
    pub format: &'static str,
    /// [`MergeReport::VERSION`].
    pub version: u32,
    /// Pose of the later map's world in the earlier one's, row-major. Maps that have drifted are bent, too: this is the
    /// motion of a keyframe in the middle.
    pub transform: [[f64; 4]; 4],
    /// How keyframes were recognised.
    pub keyframes: MergedKeyframes,
    /// Median error of the poses between aligned keyframes of the two maps, metres.
    pub residual_m: f64,
    /// The same for turns, degrees.
    pub residual_deg: f64,
    /// Mean share of their measurements that agree, 0 to 1: the lower one of depth and image.
    pub agreement: f64,
    /// Of the surfaces of each map, the earlier one first, that the other one looked at, the share that it saw through, percent.
    pub seen_through_percent: [u32; 2],
    /// Parts of the later map that could not be joined.
    pub unjoined_parts: usize,
    /// The objects of both maps, by the merged map's ids; things that are gone last.
    pub objects: Vec<MergedObject>,
    /// Objects that both maps name, differently.
    pub label_conflicts: Vec<LabelConflict>,
    /// Changes between the maps, with each map's own ids, and the merged map's places.
    pub changes: MapChanges,
}

/// How keyframes of the two maps were recognised.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct MergedKeyframes {
    /// Keyframes of the earlier map.
    pub earlier: usize,
    /// Those of them that were recognised in the later map, at places that agree.
    pub earlier_recognised: usize,
    /// Keyframes of the later map.
    pub later: usize,
    /// Those of them that were recognised in the earlier map, at places that agree.
    pub later_recognised: usize,
    /// Keyframes of both that were recognised elsewhere, and left out.
    pub elsewhere: usize,
    /// Pairs of keyframes of the two maps that were aligned.
    pub aligned: usize,
}

/// An object of the earlier map, the later one, or both.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct MergedObject {
    /// Its id in the merged map; `null` if it is not in it.
    pub id: Option<SegmentId>,
    /// Ids of the earlier map's objects that it consists of.
    pub earlier: Vec<SegmentId>,
    /// Ids of the later map's objects that it consists of.
    pub later: Vec<SegmentId>,
    /// Its label in the merged map.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub label: Option<String>,
}

/// The objects of two maps.
pub(super) struct ObjectIds {
    earlier: Vec<SegmentId>,
    later: Vec<SegmentId>,
}

impl ObjectIds {
    pub(super) fn new(earlier: &NamedMap, later: &NamedMap) -> Self {
        let ids = |map: &NamedMap| map.object_list().objects.iter().map(|object| object.id).collect();
        Self { earlier: ids(earlier), later: ids(later) }
    }
}

impl MergeReport {
    /// The value of the key `format`.
    pub const FORMAT: &'static str = "splatseg-merge";
    /// The value of the key `version`.
    pub const VERSION: u32 = 1;

    pub(super) fn new(
        fit: &MapFit,
        ids: &ObjectIds,
        joined: &JoinedIds,
        merged: &NamedMap,
        changed: Changed,
        label_conflicts: Vec<LabelConflict>,
    ) -> Self {
        let rows = fit.earlier_from_later.to_row_major();
        let rounded = |number: f64| (number * 1e6).round() / 1e6;
        Self {
            format: Self::FORMAT,
            version: Self::VERSION,
            transform: std::array::from_fn(|row| std::array::from_fn(|column| rows[4 * row + column])),
            keyframes: MergedKeyframes {
                earlier: fit.earlier.of,
                earlier_recognised: fit.earlier.recognised,
                later: fit.later.of,
                later_recognised: fit.later.recognised,
                elsewhere: fit.elsewhere,
                aligned: fit.aligned,
            },
            residual_m: rounded(fit.residual_m),
            residual_deg: rounded(fit.residual_deg),
            agreement: rounded(fit.agreement),
            seen_through_percent: changed.seen_through,
            unjoined_parts: fit.unjoined_parts,
            objects: objects(ids, joined, merged),
            label_conflicts,
            changes: changed.changes,
        }
    }

    /// Number of objects that both maps have.
    pub fn united(&self) -> usize {
        self.objects.iter().filter(|object| !object.earlier.is_empty() && !object.later.is_empty()).count()
    }
}

fn objects(ids: &ObjectIds, joined: &JoinedIds, merged: &NamedMap) -> Vec<MergedObject> {
    let mut of_merged: BTreeMap<SegmentId, [Vec<SegmentId>; 2]> = BTreeMap::new();
    for id in &ids.earlier {
        of_merged.entry(joined.of_earlier(*id)).or_default()[0].push(*id);
    }
    for id in &ids.later {
        if let Some(now) = joined.of_later(*id) {
            of_merged.entry(now).or_default()[1].push(*id);
        }
    }
    let present: BTreeSet<SegmentId> = merged.memory.map().carried_ids();
    let object = |(id, [earlier, later]): (SegmentId, [Vec<SegmentId>; 2])| MergedObject {
        id: present.contains(&id).then_some(id),
        earlier,
        later,
        label: merged.names.label(id).map(str::to_owned),
    };
    let mut objects: Vec<MergedObject> = of_merged.into_iter().map(object).collect();
    objects.sort_by_key(|object| object.id.is_none());
    objects
}
