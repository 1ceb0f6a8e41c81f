//! Which Gaussians are gone: those that frames see through, and the longest unseen of too many.
//!
//! A frame that sees through a Gaussian is rendered without it at once ([`Present`]): what it hid shows again, and what
//! is missing behind it grows in the same frame. It is removed only when several frames agree ([`note_sights`]).

use crate::MemorySettings;
use crate::map::SplatMap;
use glam::Vec3;
use rayon::prelude::*;
use splatseg_geometry::RgbdFrame;
use splatseg_render::{Balls, Camera, Shape, Splats};

/// If a frame sees through more than this share of the Gaussians whose depth it can tell, its pose or its depth is
/// wrong, and it says nothing about any of them.
const MAX_SHARE_SEEN_THROUGH: f32 = 0.5;

/// What a frame says of a Gaussian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Sight {
    /// Nothing: out of view, hidden, at a depth edge, or without depth.
    Unknown,
    /// The observed surface is where the Gaussian lies.
    Seen,
    /// The observed surface lies clearly behind it: the space where it lies is free.
    Through,
}

/// A map without the Gaussians that a frame sees through: they would hide what the frame shows in their place.
pub(crate) struct Present<'a> {
    map: &'a Balls,
    sights: &'a [Sight],
}

impl<'a> Present<'a> {
    /// `sights` has one entry per Gaussian of `map`, or none at all.
    pub fn new(map: &'a Balls, sights: &'a [Sight]) -> Self {
        Self { map, sights }
    }
}

impl Splats for Present<'_> {
    fn count(&self) -> usize {
        self.map.count()
    }

    #[inline(always)]
    fn mean(&self, index: usize) -> Vec3 {
        self.map.mean(index)
    }

    #[inline(always)]
    fn opacity(&self, index: usize) -> f32 {
        if self.sights.get(index) == Some(&Sight::Through) { 0.0 } else { self.map.opacity(index) }
    }

    #[inline(always)]
    fn shape(&self, index: usize) -> Shape {
        self.map.shape(index)
    }
}

/// What `frame` says of every Gaussian, one entry each.
pub(crate) fn sights(map: &Balls, frame: &RgbdFrame, camera: &Camera, settings: &MemorySettings) -> Vec<Sight> {
    let mut sights: Vec<Sight> =
        map.means.par_iter().map(|mean| sight(camera.to_camera(*mean), frame, settings)).collect();
    let count = |kind| sights.iter().filter(|sight| **sight == kind).count() as f32;
    let (seen, through) = (count(Sight::Seen), count(Sight::Through));
    if through > MAX_SHARE_SEEN_THROUGH * (seen + through) {
        sights.iter_mut().filter(|sight| **sight == Sight::Through).for_each(|sight| *sight = Sight::Unknown);
    }
    sights
}

/// Notes what frame number `frame` says of every Gaussian, and returns those to be kept if any is to be removed: a
/// Gaussian is gone once `removal_frames` frames saw through it and none saw it in between.
pub(crate) fn note_sights(map: &mut SplatMap, sights: &[Sight], removal_frames: u8, frame: u32) -> Option<Vec<bool>> {
    let mut removed = Vec::new();
    for (index, sight) in sights.iter().enumerate() {
        match sight {
            Sight::Seen => {
                map.last_seen[index] = frame;
                map.seen_through[index] = 0;
            }
            Sight::Through if removal_frames > 0 => {
                map.seen_through[index] = map.seen_through[index].saturating_add(1);
                if map.seen_through[index] >= removal_frames {
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

/// Compares a Gaussian, camera coordinates, with the depths around its centre: a pose that is off by a pixel must not
/// make it look free.
fn sight(center: Vec3, frame: &RgbdFrame<'_>, settings: &MemorySettings) -> Sight {
    let (width, height) = (frame.width(), frame.height());
    let Some(pixel) = frame.intrinsics().project(center) else { return Sight::Unknown };
    let (column, row) = (pixel.x.round(), pixel.y.round());
    let is_inside = column >= 1.0 && row >= 1.0 && column + 2.0 <= width as f32 && row + 2.0 <= height as f32;
    if !is_inside {
        return Sight::Unknown;
    }
    let (column, row) = (column as usize, row as usize);
    let margin = settings.removal_margin.max(settings.removal_margin_relative * center.z);
    let (mut all_through, mut any_seen) = (true, false);
    for row in row - 1..=row + 1 {
        for observed in &frame.depth().row(row)[column - 1..=column + 1] {
            all_through &= *observed > center.z + margin;
            any_seen |= *observed > 0.0 && (observed - center.z).abs() <= margin;
        }
    }
    match (all_through, any_seen) {
        (true, _) => Sight::Through,
        (_, true) => Sight::Seen,
        _ => Sight::Unknown,
    }
}
