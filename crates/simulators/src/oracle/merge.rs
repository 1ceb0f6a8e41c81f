//! Merges of neighbouring objects into one mask.

use super::OracleErrorModel;
use super::decision::Decision;
use crate::{Chance, FrameChance};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use splatseg_geometry::{Mask, SegmentId, SegmentMap};
use std::collections::BTreeMap;

/// Objects merged into one mask. The id of the group is their smallest id.
#[derive(Clone, Debug)]
pub(super) struct Group {
    pub(super) id: SegmentId,
    pub(super) mask: Mask,
}

/// The length of each object's border with each neighbour, in pixel edges.
type Borders = BTreeMap<SegmentId, BTreeMap<SegmentId, usize>>;

/// Merges objects at random for this frame. Returns groups by increasing id.
pub(super) fn merged(
    truth: &SegmentMap,
    objects: Vec<(SegmentId, Mask)>,
    model: &OracleErrorModel,
    chance: FrameChance,
) -> Vec<Group> {
    if model.merge_rate == 0.0 {
        return objects.into_iter().map(|(id, mask)| Group { id, mask }).collect();
    }
    let ids: Vec<SegmentId> = objects.iter().map(|(id, _)| *id).collect();
    let borders = borders(truth, &ids);
    // The group of each object. Merging two groups replaces the larger id.
    let mut group_of: BTreeMap<SegmentId, SegmentId> = ids.iter().map(|id| (*id, *id)).collect();
    for id in &ids {
        let mut random = chance.lasting_or_fresh(Decision::Merge, *id, model.persistence);
        if random.random::<f64>() < model.merge_rate
            && let Some(neighbour) = neighbour(&borders, *id, &mut random)
        {
            let (first, second) = (group_of[id], group_of[&neighbour]);
            let (kept, replaced) = (first.min(second), first.max(second));
            group_of.values_mut().filter(|group| **group == replaced).for_each(|group| *group = kept);
        }
    }
    let mut groups: BTreeMap<SegmentId, Mask> = BTreeMap::new();
    for (id, mask) in objects {
        match groups.get_mut(&group_of[&id]) {
            Some(group) => group.unite(&mask),
            None => {
                groups.insert(group_of[&id], mask);
            }
        }
    }
    groups.into_iter().map(|(id, mask)| Group { id, mask }).collect()
}

/// Draws a neighbour with a probability proportional to the length of the shared border.
///
/// Each neighbour draws the time of an event with this length as its rate, and the first event wins. The draw depends
/// only on `random` and the neighbour's id, so the next frame, with slightly different neighbours and lengths, mostly
/// has the same winner.
fn neighbour(borders: &Borders, id: SegmentId, random: &mut ChaCha8Rng) -> Option<SegmentId> {
    let race = Chance { seed: random.random() };
    let time = |neighbour: SegmentId, length: usize| {
        let uniform: f64 = race.of_object(Decision::Neighbour, neighbour).random();
        -(1.0 - uniform).ln() / length as f64
    };
    let times = borders.get(&id)?.iter().map(|(neighbour, length)| (time(*neighbour, *length), *neighbour));
    times.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, neighbour)| neighbour)
}

/// Measures the borders between `ids`, which must be sorted.
fn borders(truth: &SegmentMap, ids: &[SegmentId]) -> Borders {
    let mut borders = Borders::new();
    let mut touch = |a: SegmentId, b: SegmentId| {
        if a != b && ids.binary_search(&a).is_ok() && ids.binary_search(&b).is_ok() {
            *borders.entry(a).or_default().entry(b).or_insert(0) += 1;
            *borders.entry(b).or_default().entry(a).or_insert(0) += 1;
        }
    };
    for row in 0..truth.height() {
        for pair in truth.row(row).windows(2) {
            touch(pair[0], pair[1]);
        }
        if row > 0 {
            truth.row(row - 1).iter().zip(truth.row(row)).for_each(|(above, below)| touch(*above, *below));
        }
    }
    borders
}
