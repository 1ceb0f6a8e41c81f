//! Loops that were found and missed, by the true path.

use crate::cover::apart;
use splatseg_files::StateBlock;
use splatseg_geometry::{KeyframeId, Pose};
use std::collections::{BTreeMap, BTreeSet};
use std::error::Error;

/// Two keyframes show the same place if they are this close, metres and degrees...
const SAME_PLACE: (f64, f64) = (0.5, 30.0);
/// ...and the camera has come back to it on a path of at least this length, metres.
const MIN_PATH: f64 = 3.0;

/// A measured relative pose is wrong if it is off by more than this, metres and degrees.
const WRONG: (f64, f64) = (0.1, 5.0);

/// A keyframe is tied to an earlier one if a path in the graph is at most this much longer than the distance, metres: a
/// loop is not closed again within a metre of the last one.
const TIED: f64 = 1.5;

/// A loop may be found by this many later keyframes: it waits to be confirmed.
const WAIT: KeyframeId = 6;

/// The true pose of each keyframe, and the length of the path up to it, metres.
#[derive(Default)]
pub struct TruePath {
    keyframes: BTreeMap<KeyframeId, (Pose, f64)>,
    last: Option<Pose>,
    length: f64,
}

/// A measured relative pose.
struct Edge {
    from: KeyframeId,
    to: KeyframeId,
    measured: Pose,
    is_loop: bool,
}

/// Sizes of saved keyframes, in words.
pub fn sizes(saved: &[u8]) -> Result<String, Box<dyn Error>> {
    let saved = StateBlock::from_bytes(saved)?;
    let (keyframes, edges) = (saved.get::<u32>("id", &[])?.len(), saved.get_tuples::<u32, 2>("edges")?.len());
    Ok(format!("{keyframes} keyframes, {edges} relative poses"))
}

impl TruePath {
    /// Records a frame's keyframe and true pose. Returns true if the keyframe is new.
    pub fn record(&mut self, keyframe: KeyframeId, truth: &Pose) -> bool {
        let last = self.last.replace(*truth);
        self.length += last.map_or(0.0, |last| last.translation().distance(truth.translation()));
        let is_new = !self.keyframes.contains_key(&keyframe);
        if is_new {
            self.keyframes.insert(keyframe, (*truth, self.length));
        }
        is_new
    }

    /// Compares the loops of saved keyframes with the truth.
    pub fn print(&self, saved: &[u8]) -> Result<(), Box<dyn Error>> {
        let edges = edges(saved)?;
        let loops: Vec<&Edge> = edges.iter().filter(|edge| edge.is_loop).collect();
        let wrong: Vec<(&Edge, (f64, f64))> =
            loops.iter().filter_map(|edge| Some((*edge, self.error(edge)?))).collect();
        println!("{} relative poses, {} of them loops, {} wrong", edges.len(), loops.len(), wrong.len());
        for (Edge { from, to, .. }, (metres, degrees)) in wrong {
            println!("  wrong: {from} to {to}, by {:.1} cm and {degrees:.1} degrees", 100.0 * metres);
        }
        let known: BTreeSet<KeyframeId> = edges.iter().flat_map(|edge| [edge.from, edge.to]).collect();
        let (mut all, mut with_edge, mut tied) = (0, 0, 0);
        for (id, (pose, length)) in self.keyframes.iter().filter(|(id, _)| known.contains(id)) {
            let earlier = self.keyframes.range(..*id).filter(|(other, _)| known.contains(other));
            let same: BTreeSet<KeyframeId> = earlier
                .filter(|(_, (other, path))| length - path >= MIN_PATH && is_within(other, pose, SAME_PLACE))
                .map(|(other, _)| *other)
                .collect();
            if same.is_empty() {
                continue;
            }
            let has_edge = |edge: &&Edge| edge.to == *id && self.path_between(edge) >= MIN_PATH;
            all += 1;
            with_edge += usize::from(loops.iter().any(has_edge));
            tied += usize::from(is_tied(&edges, *id, &same));
        }
        let share = |count: usize| 100.0 * count as f64 / f64::from(all.max(1) as u32);
        println!(
            "{all} keyframes show a place again: {with_edge} ({:.0} %) have a loop, {tied} ({:.0} %) are tied to it",
            share(with_edge),
            share(tied)
        );
        Ok(())
    }

    fn path_between(&self, edge: &Edge) -> f64 {
        let length = |id| self.keyframes.get(&id).map_or(0.0, |(_, length)| *length);
        (length(edge.to) - length(edge.from)).abs()
    }

    /// Error of a measured pose that is wrong, metres and degrees.
    fn error(&self, edge: &Edge) -> Option<(f64, f64)> {
        let truth = |id| Some(self.keyframes.get(&id)?.0);
        let error = apart(&(truth(edge.from)?.inverse() * truth(edge.to)?), &edge.measured);
        (error.0 > WRONG.0 || error.1 > WRONG.1).then_some(error)
    }
}

fn is_within(one: &Pose, other: &Pose, (metres, degrees): (f64, f64)) -> bool {
    let (distance, angle) = apart(one, other);
    distance <= metres && angle <= degrees
}

fn edges(saved: &[u8]) -> Result<Vec<Edge>, Box<dyn Error>> {
    /// The kind of an edge that closes a loop.
    const LOOP: u8 = 1;
    let saved = StateBlock::from_bytes(saved)?;
    let ids: Vec<[KeyframeId; 2]> = saved.get_tuples("edges")?;
    let poses: Vec<f64> = saved.get_rows("edge_pose", ids.len(), &[4, 4])?;
    let kinds: Vec<u8> = saved.get_rows("edge_kind", ids.len(), &[])?;
    let edge = |(([from, to], pose), kind): (([KeyframeId; 2], &[f64; 16]), u8)| {
        Ok(Edge { from, to, measured: Pose::from_saved_row_major(*pose)?, is_loop: kind == LOOP })
    };
    ids.into_iter().zip(poses.as_chunks().0).zip(kinds).map(edge).collect()
}

/// True if a short path leads from a keyframe to one of `same`, by keyframes that were known soon after it.
fn is_tied(edges: &[Edge], id: KeyframeId, same: &BTreeSet<KeyframeId>) -> bool {
    let mut lengths = BTreeMap::from([(id, 0.0f64)]);
    let mut open = vec![id];
    while let Some(here) = open.pop() {
        for edge in edges.iter().filter(|edge| edge.from.max(edge.to) <= id + WAIT) {
            let other = match here {
                here if here == edge.from => edge.to,
                here if here == edge.to => edge.from,
                _ => continue,
            };
            let length = lengths[&here] + edge.measured.translation().length();
            if length <= TIED && lengths.get(&other).is_none_or(|known| length < *known) {
                lengths.insert(other, length);
                open.push(other);
            }
        }
    }
    lengths.keys().any(|other| same.contains(other))
}
