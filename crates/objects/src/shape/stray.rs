//! Stray patches, which do not belong to their object: Gaussians of the surface it stands on, which were seen as
//! either, flying pixels at depth edges, and Gaussians of other things claimed by a few wrong masks, such as the wall
//! behind the object's edge.
//!
//! Patches weigh by how often they were seen as the object ([`Patch::weight`]): what lies behind an object is large, but
//! few frames took it for the object.

use super::disputed::undisputed;
use super::patch_grid::PatchGrid;
use super::patches::Patch;
use glam::Vec3;
use std::cmp::Ordering;
use std::collections::{BTreeMap, BTreeSet, HashMap};

/// Two patches are connected if the distance between their centres is at most this many times the sum of their cover
/// radii (the patches of a surface seen at a slant of 85° are eleven of their sides apart)...
const LINK_PER_COVER: f32 = 6.0;
/// ...plus this, metres, because depth is noisy...
const LINK: f32 = 0.02;
/// ...and the gap between them is at most this, metres: beyond it, they hang together only if others bridge it.
const MAX_GAP: f32 = 0.3;
/// Unconnected parts with less than this share of the observations are stray...
const MIN_PART: f64 = 0.05;
/// ...and so are those seen hardly more than once (the median of their votes)...
const MIN_VOTES: f32 = 1.5;
/// ...and in less than this share of the frames that saw the main part.
const MIN_VOTE_SHARE: f32 = 0.5;
/// Share of the observations beyond a quantile, in a direction.
const TAIL: f64 = 0.005;
/// Patches farther outside the quantiles than this share of the distance between them are stray.
const REACH: f32 = 0.1;

/// The patches that are not stray, in their order. Never empty if there are patches.
pub(super) fn without_stray(patches: &[Patch]) -> Vec<Patch> {
    without_tails(large_parts(&undisputed(patches)))
}

/// Patches in the connected part that was seen most, the main part, and in others that were seen enough.
fn large_parts(patches: &[Patch]) -> Vec<Patch> {
    let parts = connected_parts(patches);
    let mut by_part: BTreeMap<usize, Vec<&Patch>> = BTreeMap::new();
    for (patch, part) in patches.iter().zip(&parts) {
        by_part.entry(*part).or_default().push(patch);
    }
    let weight = |of_part: &[&Patch]| of_part.iter().map(|patch| f64::from(patch.weight())).sum::<f64>();
    let weights: BTreeMap<usize, f64> = by_part.iter().map(|(part, of_part)| (*part, weight(of_part))).collect();
    let total: f64 = weights.values().sum();
    // Of equal parts, the first one.
    let Some(main) =
        weights.keys().copied().max_by(|one, other| weights[one].total_cmp(&weights[other]).then(other.cmp(one)))
    else {
        return Vec::new();
    };
    let least = MIN_VOTES.min(MIN_VOTE_SHARE * median_votes(&by_part[&main]));
    let is_kept =
        |part: usize| part == main || (weights[&part] >= MIN_PART * total && median_votes(&by_part[&part]) >= least);
    let kept: BTreeSet<usize> = weights.keys().copied().filter(|part| is_kept(*part)).collect();
    patches.iter().zip(&parts).filter(|(_, part)| kept.contains(part)).map(|(patch, _)| *patch).collect()
}

fn median_votes(patches: &[&Patch]) -> f32 {
    let mut votes: Vec<f32> = patches.iter().map(|patch| patch.votes).collect();
    votes.sort_unstable_by(f32::total_cmp);
    votes.get(votes.len() / 2).copied().unwrap_or_default()
}

/// The part number of each patch, equal for connected patches. Patches in the same small cell are connected.
fn connected_parts(patches: &[Patch]) -> Vec<usize> {
    let mut cells: HashMap<[i32; 3], usize> = HashMap::new();
    let mut largest: Vec<Patch> = Vec::new();
    let cell_of_patch: Vec<usize> = patches
        .iter()
        .map(|patch| {
            let cell = *cells.entry((patch.mean / LINK).floor().as_ivec3().to_array()).or_insert_with(|| {
                largest.push(*patch);
                largest.len() - 1
            });
            if patch.cover > largest[cell].cover {
                largest[cell] = *patch;
            }
            cell
        })
        .collect();
    let parts = linked_parts(&largest);
    cell_of_patch.into_iter().map(|cell| parts[cell]).collect()
}

/// The part number of each patch, equal for patches connected by a chain of links.
fn linked_parts(patches: &[Patch]) -> Vec<usize> {
    let mut parts = Parts::new(patches.len());
    // Each patch searches for patches that are not larger, in a grid for its size, so that a single large patch, e.g.
    // of a flying pixel far away, does not make the cells of all others large.
    let sizes: BTreeMap<i32, f32> = patches.iter().fold(BTreeMap::new(), |mut sizes, patch| {
        let largest = sizes.entry(size_class(patch)).or_insert(0.0);
        *largest = patch.cover.max(*largest);
        sizes
    });
    for (size, largest) in sizes {
        let smaller = (0..patches.len()).filter(|index| size_class(&patches[*index]) <= size);
        let grid = PatchGrid::of(patches, smaller, link(2.0 * largest));
        // Most cells soon are in one part. They need not be searched for patches in that part.
        let mut is_in_one_part = vec![false; grid.patches().len()];
        grid.for_each_cell(|cell, around| {
            for index in grid.patches()[cell].iter().filter(|index| size_class(&patches[**index]) == size) {
                for near in around {
                    let others = &grid.patches()[near.clone()];
                    if is_in_one_part[near.start] && parts.of(others[0]) == parts.of(*index) {
                        continue;
                    }
                    let is_linked = |other: &&usize| are_linked(&patches[*index], &patches[**other]);
                    others.iter().filter(is_linked).for_each(|other| parts.join(*index, *other));
                    let part = parts.of(others[0]);
                    is_in_one_part[near.start] = others.iter().all(|other| parts.of(*other) == part);
                }
            }
        });
    }
    (0..patches.len()).map(|index| parts.of(index)).collect()
}

fn are_linked(one: &Patch, other: &Patch) -> bool {
    let link = link(one.cover + other.cover);
    one.mean.distance_squared(other.mean) <= link * link
}

/// Maximum distance between the centres of two connected patches, metres, from the sum of their cover radii.
fn link(covers: f32) -> f32 {
    (LINK_PER_COVER * covers + LINK).min(covers + MAX_GAP)
}

/// Patches of one class differ in size by less than a factor of two.
fn size_class(patch: &Patch) -> i32 {
    patch.cover.max(LINK).log2().floor() as i32
}

/// Union-find: each element points towards the first element of its part.
struct Parts(Vec<usize>);

impl Parts {
    fn new(count: usize) -> Self {
        Self((0..count).collect())
    }

    fn of(&mut self, index: usize) -> usize {
        let mut first = index;
        while self.0[first] != first {
            first = self.0[first];
        }
        // Path compression.
        let mut at = index;
        while self.0[at] != first {
            at = std::mem::replace(&mut self.0[at], first);
        }
        first
    }

    fn join(&mut self, one: usize, other: usize) {
        let (one, other) = (self.of(one), self.of(other));
        self.0[one.max(other)] = one.min(other);
    }
}

/// Removes the patches far outside the bulk in any of 13 directions. The end of a thin part stays: patches may lie up
/// to a tenth of the object's extent outside the quantiles.
fn without_tails(patches: Vec<Patch>) -> Vec<Patch> {
    let mut keep = vec![true; patches.len()];
    for direction in directions() {
        let mut along: Vec<(f32, f32)> =
            patches.iter().map(|patch| (patch.mean.dot(direction), patch.weight())).collect();
        let (low, high) = weighted_quantiles(&mut along, TAIL);
        let reach = REACH * (high - low) + LINK;
        for (keep, patch) in keep.iter_mut().zip(&patches) {
            let at = patch.mean.dot(direction);
            *keep &= at >= low - reach && at <= high + reach;
        }
    }
    let mut keep = keep.into_iter();
    patches.into_iter().filter(|_| keep.next().unwrap_or(true)).collect()
}

/// The directions to the faces, edges and corners of a cube, one of each opposite pair.
fn directions() -> impl Iterator<Item = Vec3> {
    let all = (0..27).map(|index| Vec3::new((index % 3) as f32, (index / 3 % 3) as f32, (index / 9) as f32) - 1.0);
    all.skip(14).map(Vec3::normalize)
}

/// The positions with `tail` of the weight below and above them, respectively; `weighted` are positions and weights.
pub(super) fn weighted_quantiles(weighted: &mut [(f32, f32)], tail: f64) -> (f32, f32) {
    let total: f64 = weighted.iter().map(|(_, weight)| f64::from(*weight)).sum();
    let outside = tail * total;
    let low = first_inside(weighted, outside, |one, other| one.total_cmp(&other));
    let high = first_inside(weighted, outside, |one, other| other.total_cmp(&one));
    (low.min(high), high.max(low))
}

/// In the order of positions, the first with more than the weight `outside` up to it; 0 of nothing.
fn first_inside(weighted: &mut [(f32, f32)], outside: f64, order: fn(f32, f32) -> Ordering) -> f32 {
    let (mut passed, mut start) = (0.0, 0);
    // A few are enough, mostly: only they are put in order.
    while start < weighted.len() {
        let rest = &mut weighted[start..];
        let count = (rest.len() / 16).max(16).min(rest.len());
        if count < rest.len() {
            rest.select_nth_unstable_by(count, |one, other| order(one.0, other.0));
        }
        rest[..count].sort_unstable_by(|one, other| order(one.0, other.0));
        for (position, weight) in &rest[..count] {
            passed += f64::from(*weight);
            if passed > outside {
                return *position;
            }
        }
        start += count;
    }
    0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A patch of 2 cm.
    fn patch(x: f32, y: f32, z: f32) -> Patch {
        Patch::seen(Vec3::new(x, y, z), 0.02)
    }

    /// A square of patches, 40 cm wide.
    fn square() -> Vec<Patch> {
        (0..400).map(|index| patch((index % 20) as f32 * 0.02, (index / 20) as f32 * 0.02, 0.0)).collect()
    }

    #[test]
    fn a_thin_part_stays_and_what_lies_apart_goes() {
        let mut patches = square();
        // A pole of 60 cm, 7 % of the area; and a few patches far away, near each other.
        patches.extend((1..30).map(|step| patch(0.2, 0.2, step as f32 * 0.02)));
        let whole = patches.clone();
        patches.extend((0..10).map(|step| patch(1.5, 0.02 * step as f32, 0.3)));
        assert_eq!(without_stray(&patches), whole);
    }

    #[test]
    fn a_thread_of_patches_does_not_make_the_object_longer_than_a_tenth() {
        let mut patches = square();
        // Flying pixels: a line away from the corner of the square, 0.4 % of the weight.
        patches.extend((1..80).map(|step| Patch {
            side: 0.003,
            votes: 0.3,
            ..patch(0.38 + 0.02 * step as f32, 0.38, 0.0)
        }));
        let kept = without_stray(&patches);
        let farthest = kept.iter().map(|patch| patch.mean.x).fold(0.0, f32::max);
        assert!(farthest > 0.38 && farthest < 0.48, "{farthest}");
    }

    #[test]
    fn a_face_seen_at_a_slant_stays() {
        // Columns ten sides apart, none of them 5 % of the area.
        let mut patches = square();
        patches.extend((0..60).map(|index| patch(0.0, (index % 15) as f32 * 0.02, 0.2 * (1 + index / 15) as f32)));
        assert_eq!(without_stray(&patches), patches);
    }

    /// Rows of patches of 1 cm along z.
    fn leg(x: f32, y: f32) -> impl Iterator<Item = Patch> {
        (0..210).map(move |index| {
            Patch::seen(Vec3::new(x + 0.01 * (index % 3) as f32, y, -0.01 * (1 + index / 3) as f32), 0.01)
        })
    }

    #[test]
    fn the_legs_of_a_table_stay() {
        let top = (0..2400).map(|index| patch((index % 60) as f32 * 0.02, (index / 60) as f32 * 0.02, 0.0));
        let table: Vec<Patch> = top.chain(leg(0.02, 0.02)).chain(leg(1.1, 0.7)).collect();
        assert_eq!(without_stray(&table), table);
    }

    #[test]
    fn the_wall_behind_an_object_goes_if_one_frame_took_it_for_the_object() {
        // A fifth of the area, because patches far away are large.
        let wall = |votes: f32| {
            (0..12).map(move |index| Patch { votes, ..Patch::seen(Vec3::new(0.03 * index as f32, 1.5, 0.1), 0.06) })
        };
        let thing: Vec<Patch> = square().into_iter().map(|patch| Patch { votes: 4.0, ..patch }).collect();
        let with = |votes: f32| [thing.clone(), wall(votes).collect()].concat();
        assert_eq!(without_stray(&with(1.0)), thing);
        // Seen as often as the object, it is a part of it.
        let both: Vec<Patch> =
            [square(), square().iter().map(|near| patch(near.mean.x, 1.5, near.mean.y)).collect()].concat();
        assert_eq!(without_stray(&both), both);
        // If no part was seen more than once, nothing is known.
        let new: Vec<Patch> = both.into_iter().map(|patch| Patch { votes: 1.0, ..patch }).collect();
        assert_eq!(without_stray(&new), new);
    }

    #[test]
    fn a_gap_of_more_than_thirty_centimetres_parts_even_large_patches() {
        let large = |x: f32| Patch { cover: 0.1, ..patch(x, 0.0, 0.0) };
        assert_eq!(linked_parts(&[large(0.0), large(0.49)]), [0, 0], "29 cm between their edges");
        assert_eq!(linked_parts(&[large(0.0), large(0.51)]), [0, 1], "31 cm");
    }

    #[test]
    fn two_halves_of_an_object_both_stay() {
        let mut patches = square();
        patches.extend(square().into_iter().map(|near| patch(near.mean.x + 2.0, near.mean.y, 0.0)));
        assert_eq!(without_stray(&patches).len(), 800);
        assert_eq!(without_stray(&patches[..1]).len(), 1);
        assert!(without_stray(&[]).is_empty());
    }

    proptest! {
        /// Also if one patch is much larger and far away.
        #[test]
        fn parts_are_those_of_all_links(
            places in proptest::collection::vec((prop::array::uniform3(-1.0f32..1.0), 0.001f32..0.03), 1..60),
            far in prop::option::of((prop::array::uniform3(-20.0f32..20.0), 0.1f32..5.0)),
        ) {
            let patch = |(mean, cover): ([f32; 3], f32)| Patch { cover, ..patch(mean[0], mean[1], mean[2]) };
            let patches: Vec<Patch> = places.into_iter().chain(far).map(patch).collect();
            let mut expected: Vec<usize> = (0..patches.len()).collect();
            for _ in 0..patches.len() {
                for (one, a) in patches.iter().enumerate() {
                    for (other, b) in patches.iter().enumerate() {
                        if are_linked(a, b) {
                            expected[one] = expected[one].min(expected[other]);
                        }
                    }
                }
            }
            prop_assert_eq!(linked_parts(&patches), expected);
        }
    }

    #[test]
    fn quantiles_are_by_weight() {
        let mut weighted: Vec<(f32, f32)> = (0..100).map(|at| (at as f32, 1.0)).collect();
        weighted.reverse();
        assert_eq!(weighted_quantiles(&mut weighted, 0.105), (10.0, 89.0));
        assert_eq!(weighted_quantiles(&mut [(3.0, 2.0)], 0.01), (3.0, 3.0));
        assert_eq!(weighted_quantiles(&mut [(1.0, 0.001), (2.0, 9.0)], 0.01), (2.0, 2.0));
    }
}
