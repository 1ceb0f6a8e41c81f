//! Where keyframes of one map are in another one, and which of these places agree.

use super::{JoinError, MAX_OTHER, MIN_AGREEING, RecognisedCount, count};
use crate::graph::Edge;
use crate::keyframe_map::KeyframeMap;
use crate::keyframes::{StoredKeyframe, apart};
use crate::loop_closing::edge;
use crate::relocalisation::Query;
use glam::DVec3;
use rayon::prelude::*;
use splatseg_geometry::{KeyframeId, Pose};
use std::collections::{BTreeMap, BTreeSet};

/// Two places agree if the later map's world then lies alike to within this, metres and radians...
const SAME_PLACE: (f64, f64) = (0.12, 0.06);
/// ...and this much per metre between them: both maps may have drifted.
const DRIFT: (f64, f64) = (0.05, 0.02);

/// A keyframe of one map that was recognised in the other one.
#[derive(Clone, Debug)]
pub(super) struct Sight {
    /// The keyframe of the earlier map, and that of the later one.
    pub(super) earlier: KeyframeId,
    pub(super) later: KeyframeId,
    /// True if it is the later map's keyframe that was recognised.
    is_later: bool,
    /// The parts of the two maps.
    parts: (u32, u32),
    /// Pose of the later map's world in the earlier one's.
    motion: Pose,
    /// Where the later keyframe is in its own world, metres.
    position: DVec3,
    /// The measured relative pose, by the keyframes' own numbers.
    pub(super) edge: Edge,
    pub(super) agreement: f32,
}

/// How the parts of a later map lie in the earlier one's world.
#[derive(Clone, Debug, Default)]
pub(super) struct Places {
    /// For each part of the later map that was found, the part of the earlier map and the motion.
    pub(super) parts: BTreeMap<u32, (u32, Pose)>,
    /// The sights that agree.
    pub(super) sights: Vec<Sight>,
    pub(super) earlier: RecognisedCount,
    pub(super) later: RecognisedCount,
    pub(super) elsewhere: usize,
}

impl Sight {
    /// True if another sight puts the later map's world to the same place.
    fn agrees(&self, other: &Self) -> bool {
        let (distance, angle) = apart(
            &(self.motion * Pose::from_translation(self.position)),
            &(other.motion * Pose::from_translation(self.position)),
        );
        let between = self.position.distance(other.position);
        self.parts == other.parts
            && distance <= SAME_PLACE.0 + DRIFT.0 * between
            && angle <= SAME_PLACE.1 + DRIFT.1 * between
    }

    /// The keyframe that was recognised: that of the later map, or not, and its number.
    fn recognised(&self) -> (bool, KeyframeId) {
        (self.is_later, if self.is_later { self.later } else { self.earlier })
    }
}

/// The places of a later map's parts if the motion of its world is known.
pub(super) fn known_places(earlier: &KeyframeMap, later: &KeyframeMap, motion: &Pose) -> Places {
    let largest = |map: &KeyframeMap| {
        let mut sizes: BTreeMap<u32, usize> = BTreeMap::new();
        map.store.iter().for_each(|keyframe| *sizes.entry(keyframe.part).or_default() += 1);
        sizes.into_iter().max_by_key(|(part, size)| (*size, std::cmp::Reverse(*part))).map(|(part, _)| part)
    };
    let parts = largest(later).zip(largest(earlier)).map(|(later, earlier)| (later, (earlier, *motion)));
    let of = |map| RecognisedCount { recognised: 0, of: count(map) };
    Places { parts: parts.into_iter().collect(), earlier: of(earlier), later: of(later), ..Places::default() }
}

/// Finds the places of a later map's parts in the earlier map, by what their keyframes show.
///
/// # Errors
/// [`JoinError::NoOverlap`], [`JoinError::Ambiguous`].
pub(super) fn places(earlier: &KeyframeMap, later: &KeyframeMap) -> Result<Places, JoinError> {
    let mut sights = sights(later, earlier, true);
    sights.extend(self::sights(earlier, later, false));
    voted(&sights, (count(earlier), count(later)))
}

/// The places that most sights agree with. `counts` are the numbers of keyframes of the earlier and the later map.
fn voted(sights: &[Sight], counts: (usize, usize)) -> Result<Places, JoinError> {
    let mut places = Places::default();
    let parts: BTreeSet<u32> = sights.iter().map(|sight| sight.parts.1).collect();
    for part in parts {
        let of_part: Vec<&Sight> = sights.iter().filter(|sight| sight.parts.1 == part).collect();
        let Some((best, agreeing)) = most_agreeing(&of_part) else { continue };
        let support = distinct(agreeing.iter().copied()).len();
        if support < MIN_AGREEING {
            continue;
        }
        let others: Vec<&Sight> = of_part.into_iter().filter(|sight| !best.agrees(sight)).collect();
        let other = most_agreeing(&others).map_or(0, |(_, agreeing)| distinct(agreeing.into_iter()).len());
        if other as f64 > MAX_OTHER * support as f64 {
            return Err(JoinError::Ambiguous { agreeing: support, other });
        }
        places.parts.insert(part, (best.parts.0, best.motion));
        places.sights.extend(agreeing.into_iter().cloned());
    }
    let agreeing = distinct(places.sights.iter());
    places.elsewhere = distinct(sights.iter()).len() - agreeing.len();
    let recognised = |is_later| agreeing.iter().filter(|(of_later, _)| *of_later == is_later).count();
    places.earlier = RecognisedCount { recognised: recognised(false), of: counts.0 };
    places.later = RecognisedCount { recognised: recognised(true), of: counts.1 };
    if places.parts.is_empty() {
        return Err(JoinError::NoOverlap { earlier: places.earlier, later: places.later });
    }
    Ok(places)
}

/// The sight that most others agree with, and those.
fn most_agreeing<'a>(sights: &[&'a Sight]) -> Option<(&'a Sight, Vec<&'a Sight>)> {
    let agreeing = |one: &Sight| sights.iter().filter(|other| one.agrees(other)).copied().collect::<Vec<&Sight>>();
    let counts: Vec<usize> = sights.par_iter().map(|one| distinct(agreeing(one).into_iter()).len()).collect();
    let best = (0..sights.len()).max_by_key(|index| (counts[*index], std::cmp::Reverse(*index)))?;
    Some((sights[best], agreeing(sights[best])))
}

/// The keyframes that were recognised: one that was recognised from two sides counts twice, since both are evidence.
fn distinct<'a>(sights: impl Iterator<Item = &'a Sight>) -> BTreeSet<(bool, KeyframeId)> {
    sights.map(Sight::recognised).collect()
}

/// The keyframes of one map that are recognised in another one.
fn sights(searched: &KeyframeMap, among: &KeyframeMap, is_later: bool) -> Vec<Sight> {
    let keyframes: Vec<&StoredKeyframe> = searched.store.iter().collect();
    let sight = |keyframe: &&StoredKeyframe| {
        let query = Query::of_keyframe(keyframe)?;
        let found = query.recognise(&among.store, |_| true, u64::from(keyframe.id))?;
        let there = among.store.get(found.keyframe)?;
        let motion = found.world_from_camera * keyframe.world_from_key.inverse();
        let edge = edge(&found, keyframe.id);
        let agreement = found.agreement;
        let sight = match is_later {
            true => Sight {
                earlier: there.id,
                later: keyframe.id,
                is_later,
                parts: (there.part, keyframe.part),
                motion,
                position: keyframe.world_from_key.translation(),
                edge,
                agreement,
            },
            false => Sight {
                earlier: keyframe.id,
                later: there.id,
                is_later,
                parts: (keyframe.part, there.part),
                motion: motion.inverse(),
                position: there.world_from_key.translation(),
                edge,
                agreement,
            },
        };
        Some(sight)
    };
    keyframes.par_iter().filter_map(sight).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::graph::EdgeKind;

    /// A later keyframe that was recognised so that its world has moved by `x` metres.
    fn sight(later: KeyframeId, part: u32, x: f64) -> Sight {
        let edge = Edge {
            from: 0,
            to: later,
            measured: Pose::IDENTITY,
            information: crate::graph::information(None),
            kind: EdgeKind::Loop,
        };
        let (motion, position) = (Pose::from_translation(DVec3::X * x), DVec3::Y * f64::from(later));
        Sight { earlier: 0, later, is_later: true, parts: (0, part), motion, position, edge, agreement: 0.9 }
    }

    fn sights(of_part: &[(u32, f64)]) -> Vec<Sight> {
        of_part.iter().enumerate().map(|(later, (part, x))| sight(later as KeyframeId, *part, *x)).collect()
    }

    #[test]
    fn wrong_places_are_outvoted() {
        let all = sights(&[(0, 1.0), (0, 1.02), (0, 7.0), (0, 0.98), (0, -3.0), (0, 1.01)]);
        let places = voted(&all, (9, 8)).unwrap();
        assert_eq!(places.later, RecognisedCount { recognised: 4, of: 8 });
        assert_eq!((places.earlier.of, places.elsewhere, places.sights.len()), (9, 2, 4));
        assert!((places.parts[&0].1.translation().x - 1.0).abs() < 0.03);
    }

    #[test]
    fn too_few_places_and_two_ways_are_refused() {
        let few = voted(&sights(&[(0, 1.0), (0, 1.0), (0, 5.0)]), (2, 3));
        assert!(matches!(few, Err(JoinError::NoOverlap { .. })), "{few:?}");
        assert!(matches!(voted(&[], (2, 3)), Err(JoinError::NoOverlap { .. })));
        let ways = voted(&sights(&[(0, 1.0), (0, 1.0), (0, 1.0), (0, 5.0), (0, 5.0)]), (2, 5));
        assert_eq!(ways.unwrap_err(), JoinError::Ambiguous { agreeing: 3, other: 2 });
        // One keyframe may be recognised twice, but only its side counts.
        let same: Vec<Sight> = (0..5).map(|_| sight(3, 0, 1.0)).collect();
        assert!(matches!(voted(&same, (2, 5)), Err(JoinError::NoOverlap { .. })));
    }

    #[test]
    fn each_part_of_a_map_has_a_place_of_its_own() {
        let all = sights(&[(0, 1.0), (0, 1.0), (0, 1.0), (2, -50.0), (2, -50.0), (2, -50.0), (3, 4.0)]);
        let places = voted(&all, (9, 9)).unwrap();
        assert_eq!(places.parts.keys().copied().collect::<Vec<_>>(), [0, 2]);
        assert!((places.parts[&2].1.translation().x + 50.0).abs() < 1e-9 && places.elsewhere == 1);
    }
}
