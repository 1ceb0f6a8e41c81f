//! The partition of a map's patches into objects: average linkage, as in a frame (GASP; Bailoni et al., *GASP, a
//! generalized framework for agglomerative clustering of signed graphs*, CVPR 2022), helped by the ids that frames gave.

use super::{PairEvidence, Patch, patches_of};
use splatseg_geometry::{Affinities, SegmentId};
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// Parts whose frames never gave them the same id are one object if the mean log-odds between them are above this, as the
/// regions of a frame are.
const THRESHOLD: f64 = -0.5;

/// Added to the mean log-odds if frames gave two parts the same ids; a share of it if they have some ids in common.
const AGREEMENT_WEIGHT: f64 = 3.0;

/// Merges patches into objects. `pairs` are sorted by their keys, each once. Returns the object of each patch, numbered from 0
/// in the order of their first patches.
pub(super) fn partition(patches: &[Patch], pairs: &[(u64, PairEvidence)]) -> Vec<u32> {
    let mut merging = Merging::new(patches, pairs);
    (0..patches.len() as u32).for_each(|part| merging.propose(part));
    while let Some(best) = merging.candidates.pop().filter(|best| best.score > THRESHOLD) {
        if merging.versions[best.one as usize] != best.versions.0 {
            continue;
        }
        if merging.versions[best.other as usize] == best.versions.1 {
            merging.merge(best.one, best.other);
        } else {
            merging.propose(best.one);
        }
    }
    merging.into_objects()
}

/// The pairs between a part and another one.
#[derive(Clone, Copy, Debug)]
struct Link {
    /// The other part. It may have been merged since.
    other: u32,
    count: u64,
    sum: i64,
}

/// The best link of a part at the time when it was found.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Candidate {
    score: f64,
    one: u32,
    other: u32,
    /// The part's and the other's versions at that time.
    versions: (u32, u32),
}

impl Eq for Candidate {}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> Ordering {
        let key = |candidate: &Self| (candidate.one, candidate.other, candidate.versions);
        self.score.total_cmp(&other.score).then_with(|| key(other).cmp(&key(self)))
    }
}

/// Patches that are being merged. A part is known by the number of its first patch.
struct Merging {
    /// Pixels of each part that were predicted as each id, by increasing number of the id.
    pixels_of_ids: Vec<Vec<(u32, u64)>>,
    /// Their sum.
    pixels: Vec<f64>,
    /// Shares of the part whose best link is searched for, by number of the id; 0 otherwise.
    shares: Vec<f64>,
    links: Vec<Vec<Link>>,
    /// Union-find parent of each patch.
    parents: Vec<u32>,
    /// Changes when a part is merged.
    versions: Vec<u32>,
    /// For each part, the last list of links in which it occurred, and its place there.
    slots: Vec<(u32, u32)>,
    /// Number of lists so far.
    lists: u32,
    candidates: BinaryHeap<Candidate>,
}

impl Merging {
    fn new(patches: &[Patch], pairs: &[(u64, PairEvidence)]) -> Self {
        // Ids get numbers from 0, as there may be far fewer of them than the highest one.
        let mut ids: Vec<SegmentId> =
            patches.iter().flat_map(|patch| &patch.pixels_of_ids).map(|(id, _)| *id).collect();
        ids.sort_unstable();
        ids.dedup();
        let number = |id: SegmentId| ids.partition_point(|other| *other < id) as u32;
        let wide =
            |patch: &Patch| patch.pixels_of_ids.iter().map(|(id, pixels)| (number(*id), u64::from(*pixels))).collect();
        let mut links = vec![Vec::new(); patches.len()];
        for (key, PairEvidence { sum, count }) in pairs {
            let (one, other) = patches_of(*key);
            let (count, sum) = (u64::from(*count), i64::from(*sum));
            links[one as usize].push(Link { other, count, sum });
            links[other as usize].push(Link { other: one, count, sum });
        }
        let pixels_of_ids: Vec<Vec<(u32, u64)>> = patches.iter().map(wide).collect();
        let sum = |ids: &Vec<(u32, u64)>| ids.iter().map(|(_, pixels)| pixels).sum::<u64>() as f64;
        Self {
            shares: vec![0.0; ids.len()],
            pixels: pixels_of_ids.iter().map(sum).collect(),
            pixels_of_ids,
            links,
            parents: (0..patches.len() as u32).collect(),
            versions: vec![0; patches.len()],
            slots: vec![(u32::MAX, 0); patches.len()],
            lists: 0,
            candidates: BinaryHeap::new(),
        }
    }

    fn root(&mut self, mut part: u32) -> u32 {
        while self.parents[part as usize] != part {
            let above = self.parents[self.parents[part as usize] as usize];
            self.parents[part as usize] = above;
            part = above;
        }
        part
    }

    /// Joins a part's links to the same part, and adds its best one to the candidates.
    fn propose(&mut self, part: u32) {
        let old = std::mem::take(&mut self.links[part as usize]);
        let mut links: Vec<Link> = Vec::with_capacity(old.len());
        self.lists += 1;
        for link in old {
            let other = self.root(link.other);
            if other == part {
                continue;
            }
            let (list, place) = self.slots[other as usize];
            if list == self.lists {
                links[place as usize].count += link.count;
                links[place as usize].sum += link.sum;
            } else {
                self.slots[other as usize] = (self.lists, links.len() as u32);
                links.push(Link { other, ..link });
            }
        }
        self.set_shares(part, |pixels, all| pixels as f64 / all);
        let mut best: Option<(f64, u32)> = None;
        for link in &links {
            let score = self.score(link);
            if best.is_none_or(|(highest, other)| score > highest || (score == highest && link.other < other)) {
                best = Some((score, link.other));
            }
        }
        self.set_shares(part, |_, _| 0.0);
        self.links[part as usize] = links;
        if let Some((score, other)) = best {
            let versions = (self.versions[part as usize], self.versions[other as usize]);
            self.candidates.push(Candidate { score, one: part, other, versions });
        }
    }

    fn set_shares(&mut self, part: u32, share: fn(u64, f64) -> f64) {
        for (id, pixels) in &self.pixels_of_ids[part as usize] {
            self.shares[*id as usize] = share(*pixels, self.pixels[part as usize]);
        }
    }

    /// The score of a link of the part with the shares that are set.
    fn score(&self, link: &Link) -> f64 {
        let log_odds = link.sum as f64 / link.count as f64 / f64::from(Affinities::UNIT);
        log_odds + AGREEMENT_WEIGHT * self.agreement(link.other as usize)
    }

    /// How much frames gave a part the same ids as the one with the shares that are set: 1 if both have the same shares of ids, 0
    /// if they have none in common.
    fn agreement(&self, part: usize) -> f64 {
        let all = self.pixels[part];
        self.pixels_of_ids[part].iter().map(|(id, pixels)| (*pixels as f64 / all).min(self.shares[*id as usize])).sum()
    }

    fn merge(&mut self, one: u32, other: u32) {
        let (kept, gone) = (one.min(other), one.max(other));
        self.parents[gone as usize] = kept;
        let moved = std::mem::take(&mut self.links[gone as usize]);
        self.links[kept as usize].extend(moved);
        let more = std::mem::take(&mut self.pixels_of_ids[gone as usize]);
        let ids = &mut self.pixels_of_ids[kept as usize];
        for (id, pixels) in more {
            match ids.binary_search_by_key(&id, |(id, _)| *id) {
                Ok(place) => ids[place].1 += pixels,
                Err(place) => ids.insert(place, (id, pixels)),
            }
        }
        self.pixels[kept as usize] += self.pixels[gone as usize];
        self.versions[kept as usize] += 1;
        self.versions[gone as usize] += 1;
        self.propose(kept);
    }

    fn into_objects(mut self) -> Vec<u32> {
        let (mut of_patches, mut objects) = (vec![0; self.parents.len()], 0);
        for patch in 0..self.parents.len() {
            // The root of a part is its first patch.
            let root = self.root(patch as u32) as usize;
            if root == patch {
                of_patches[patch] = objects;
                objects += 1;
            } else {
                of_patches[patch] = of_patches[root];
            }
        }
        of_patches
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::patches::pair_key;

    /// Patches that frames gave these ids, with one pixel each.
    fn patches(ids: &[&[SegmentId]]) -> Vec<Patch> {
        let patch = |ids: &&[SegmentId]| Patch {
            gaussians: 1,
            pixels_of_ids: ids.iter().map(|id| (*id, 1)).collect(),
            ..Patch::default()
        };
        ids.iter().map(patch).collect()
    }

    fn pair(one: u32, other: u32, log_odds: f32, count: u32) -> (u64, PairEvidence) {
        let sum = (log_odds * count as f32 * Affinities::UNIT) as i32;
        (pair_key(one, other), PairEvidence { sum, count })
    }

    fn objects(patches: &[Patch], pairs: &[(u64, PairEvidence)]) -> Vec<u32> {
        partition(patches, pairs)
    }

    #[test]
    fn the_mean_of_all_pairs_decides() {
        let unknown = patches(&[&[], &[], &[]]);
        let pairs = [pair(0, 1, 2.0, 10), pair(1, 2, 1.0, 10)];
        assert_eq!(objects(&unknown, &pairs), [0, 0, 0], "linked through the middle one");
        let pairs = [pair(0, 1, 2.0, 10), pair(0, 2, -4.0, 10), pair(1, 2, 1.0, 10)];
        assert_eq!(objects(&unknown, &pairs), [0, 0, 1], "-1.5 after the first two have been merged");
        let pairs = [pair(0, 1, 2.0, 10), pair(0, 2, -4.0, 1), pair(1, 2, 1.0, 10)];
        assert_eq!(objects(&unknown, &pairs), [0, 0, 0], "one pair says little");
    }

    #[test]
    fn ids_decide_where_log_odds_are_unsure() {
        let unsure = [pair(0, 1, -2.0, 10)];
        assert_eq!(objects(&patches(&[&[4], &[4]]), &unsure), [0, 0]);
        assert_eq!(objects(&patches(&[&[4], &[5]]), &unsure), [0, 1]);
        assert_eq!(objects(&patches(&[&[4], &[]]), &unsure), [0, 1]);
        assert_eq!(objects(&patches(&[&[4, 5], &[5, 6]]), &unsure), [0, 1], "-0.5 is not above the threshold");
        assert_eq!(objects(&patches(&[&[4], &[4]]), &[pair(0, 1, -5.0, 10)]), [0, 1], "log-odds decide in the end");
        assert_eq!(objects(&patches(&[&[4], &[4]]), &[]), [0, 1], "no frame shows both");
    }

    #[test]
    fn the_shares_of_ids_agree_in_any_amount() {
        let agreement = |ids: [&[(SegmentId, u32)]; 2]| {
            let patches = ids.map(|ids| Patch { pixels_of_ids: ids.to_vec(), ..Patch::default() });
            let mut merging = Merging::new(&patches, &[]);
            let [one, other] = [(0, 1), (1, 0)].map(|(part, other)| {
                merging.set_shares(part, |pixels, all| pixels as f64 / all);
                let agreement = merging.agreement(other);
                merging.set_shares(part, |_, _| 0.0);
                agreement
            });
            assert_eq!(one, other);
            one
        };
        assert_eq!(agreement([&[(1, 10), (2, 30)], &[(1, 1), (2, 3)]]), 1.0);
        assert_eq!(agreement([&[(1, 1), (2, 1)], &[(2, 7)]]), 0.5);
        assert_eq!(agreement([&[(1, 1)], &[(2, 1)]]), 0.0);
        assert_eq!(agreement([&[], &[(2, 1)]]), 0.0);
    }
}
