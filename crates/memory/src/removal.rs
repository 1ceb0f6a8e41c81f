//! Which Gaussians are gone: those that frames see through, and the longest unseen of too many.

use crate::MemorySettings;
use crate::map::SplatMap;
use crate::recall::Recall;
use rayon::prelude::*;
use splatseg_geometry::Image;
use splatseg_render::ProjectedGaussian;

/// If a frame sees through more than this share of the Gaussians whose depth it can tell, its pose or its depth is
/// wrong, and it says nothing about any of them.
const MAX_SHARE_SEEN_THROUGH: f32 = 0.5;

/// What a frame says of a Gaussian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Sight {
    /// Nothing: out of view, hidden, at a depth edge, or without depth.
    Unknown,
    /// The observed surface is where the Gaussian lies.
    Seen,
    /// The observed surface lies clearly behind it: the space where it lies is free.
    Through,
}

/// Notes what the frame says of every Gaussian, and returns those to be kept if any is to be removed: a Gaussian is
/// gone once `removal_frames` frames saw through it and none saw it in between.
pub(crate) fn note_sights(
    map: &mut SplatMap,
    recall: &Recall<'_>,
    settings: &MemorySettings,
    frame: u32,
) -> Option<Vec<bool>> {
    let depth = recall.frame.depth();
    let sights: Vec<(u32, Sight)> = recall
        .view
        .projected()
        .par_iter()
        .map(|splat| (splat.gaussian, sight(splat, depth, settings)))
        .filter(|(_, sight)| *sight != Sight::Unknown)
        .collect();
    let through = sights.iter().filter(|(_, sight)| *sight == Sight::Through).count();
    let is_plausible = through as f32 <= MAX_SHARE_SEEN_THROUGH * sights.len() as f32;
    let mut removed = Vec::new();
    for (gaussian, sight) in sights {
        let index = gaussian as usize;
        match sight {
            Sight::Seen => {
                map.last_seen[index] = frame;
                map.seen_through[index] = 0;
            }
            Sight::Through if is_plausible && settings.removal_frames > 0 => {
                map.seen_through[index] = map.seen_through[index].saturating_add(1);
                if map.seen_through[index] >= settings.removal_frames {
                    removed.push(index);
                }
            }
            _ => {}
        }
    }
    (!removed.is_empty()).then(|| {
        let mut keep = vec![true; map.len()];
        removed.into_iter().for_each(|index| keep[index] = false);
        keep
    })
}

/// The Gaussians to be kept so that at most `max` are: those seen last, earlier ones of those seen in the same frame.
/// `None` if there are no more than that.
pub(crate) fn longest_unseen(map: &SplatMap, max: usize) -> Option<Vec<bool>> {
    if map.len() <= max {
        return None;
    }
    let mut order: Vec<usize> = (0..map.len()).collect();
    order.select_nth_unstable_by_key(max, |index| (std::cmp::Reverse(map.last_seen[*index]), *index));
    let mut keep = vec![false; map.len()];
    order[..max].iter().for_each(|index| keep[*index] = true);
    Some(keep)
}

/// Compares a Gaussian with the depths around its centre: a pose that is off by a pixel must not make it look free.
fn sight(splat: &ProjectedGaussian, depth: &Image<f32>, settings: &MemorySettings) -> Sight {
    let (width, height) = depth.size();
    let (column, row) = (splat.mean.x.round(), splat.mean.y.round());
    if !(column >= 1.0 && row >= 1.0 && column + 2.0 <= width as f32 && row + 2.0 <= height as f32) {
        return Sight::Unknown;
    }
    let (column, row) = (column as usize, row as usize);
    let margin = settings.removal_margin.max(settings.removal_margin_relative * splat.depth);
    let (mut all_through, mut any_seen) = (true, false);
    for row in row - 1..=row + 1 {
        for observed in &depth.row(row)[column - 1..=column + 1] {
            all_through &= *observed > splat.depth + margin;
            any_seen |= *observed > 0.0 && (observed - splat.depth).abs() <= margin;
        }
    }
    match (all_through, any_seen) {
        (true, _) => Sight::Through,
        (_, true) => Sight::Seen,
        _ => Sight::Unknown,
    }
}
