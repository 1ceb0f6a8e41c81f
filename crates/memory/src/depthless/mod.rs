//! Segments without depth: black worktops, screens, glass, sky. No Gaussian can grow there, so they are kept apart from
//! the map and linked from frame to frame by where the camera's motion takes them.
//!
//! - A pixel is **bare** if it has no observed depth and the map does not cover it. If that is enough of a
//!   prediction, its pixels without depth are remembered as a flat region: as the camera saw them, on the plane of the depths around
//!   them ([`plane`]).
//! - **Expected** ([`DepthlessSegments::expect`]): a region that is warped into the new camera ([`warp`]), where pixels
//!   are bare and the map expects nothing. Of several, the one seen last; of those, the smaller id.
//! - **Replaced** ([`DepthlessSegments::take_in`]): by every new view, unless that shows only the part within the image
//!   of what the old one predicts well, or far less than the old one a few times ([`MAX_POOR_VIEWS`]).
//! - **Forgotten**: what several frames in which it should be seen contradict, and the longest unseen of too many.

mod plane;
mod region;
mod saved;
#[cfg(test)]
mod tests;
mod warp;

pub(crate) use saved::SavedDepthlessSegment;

use crate::ABSTAIN;
use crate::recall::Recall;
use plane::Plane;
use rayon::prelude::*;
use region::Region;
use splatseg_geometry::{Image, LocalPose, RgbdFrame, SegmentId, SegmentMap};
use std::cmp::Reverse;
use std::collections::BTreeMap;
use warp::{Viewpoint, Warp};

/// An id with fewer bare pixels in a frame is not remembered for them.
pub(crate) const MIN_AREA: usize = 20;
/// Nor is one of which less than this share is bare: its Gaussians remember it.
pub(crate) const MIN_BARE_SHARE_OF_ID: f32 = 0.5;
/// Segments that are remembered at most; those not seen for longest go.
pub(crate) const MAX_SEGMENTS: usize = 256;
/// How sure an expectation is: less than a fresh observation (1), for the plane is a guess.
pub(crate) const CONFIDENCE: f32 = 0.7;
/// Nothing is expected of a segment unless this share of where it should be seen is bare: the rest is hidden or gone.
const MIN_BARE_SHARE: f32 = 0.25;
/// A segment is fully in view if this share of it lies within the image.
const FULLY_IN_VIEW: f32 = 0.9;
/// An old view predicts a new one well if their bare pixels overlap so much (intersection over union)...
const MIN_AGREEMENT: f32 = 0.8;
/// ...and is complete if no more than this share of the new one's is not in it.
const MAX_REVEALED: f32 = 0.1;
/// A view is poor if it shows less than this share of what the old one says is there...
const POOR_SHARE: f32 = 0.5;
/// ...and so many in a row do not replace the old one.
const MAX_POOR_VIEWS: u8 = 3;
/// A segment is forgotten after so many contradictions, if it was not seen in between.
const MAX_CONTRADICTIONS: u8 = 5;
/// A frame contradicts a segment if this share of where it should be seen shows something else.
const CONTRADICTED_SHARE: f32 = 0.5;
/// A surface hides a plane if it is nearer by more than this fraction.
const HIDING_MARGIN: f32 = 0.05;

/// What is remembered of segments without depth, by increasing id.
#[derive(Debug, Default)]
pub(crate) struct DepthlessSegments {
    segments: Vec<DepthlessSegment>,
}

/// One view of the part of a segment that has no depth.
#[derive(Clone, Debug)]
struct DepthlessSegment {
    region: Region,
    /// In the frame of the camera at `viewpoint`.
    plane: Plane,
    viewpoint: Viewpoint,
    /// The last frame with bare pixels of the id, whether or not its view replaced this one.
    last_seen: u32,
    poor_views: u8,
    contradictions: u8,
}

/// Where a remembered segment should be seen in a frame, made by [`DepthlessSegments::expect`].
#[derive(Clone, Debug)]
pub(crate) struct DepthlessSight {
    id: SegmentId,
    warp: Warp,
    /// Bare pixels of the warp.
    bare: usize,
}

/// A frame that is taken in.
#[derive(Clone, Copy)]
struct View<'a> {
    frame: &'a RgbdFrame<'a>,
    number: u32,
    viewpoint: Viewpoint,
    seen: &'a SegmentMap,
    /// The id seen at each bare pixel, 0 elsewhere.
    bare: &'a SegmentMap,
    /// Rendered silhouette and z-depth of the map.
    silhouette: &'a Image<f32>,
    depth: &'a Image<f32>,
    /// A pixel is covered by the map from this silhouette on.
    covered_from: f32,
}

impl DepthlessSegments {
    /// Adds to what the map expects the remembered segments, where `recall` is bare: where there is no observed depth and
    /// the silhouette is below `covered_from`.
    pub fn expect(&self, recall: &mut Recall<'_>, covered_from: f32) {
        let to = Viewpoint { intrinsics: *recall.frame.intrinsics(), map_from_camera: recall.viewed_from };
        let (observed, silhouette) = (recall.frame.depth().pixels(), recall.silhouette.pixels());
        let bare: Vec<bool> = observed
            .iter()
            .zip(silhouette)
            .map(|(observed, silhouette)| *observed == 0.0 && *silhouette < covered_from)
            .collect();
        let mut found: Vec<(u32, DepthlessSight)> = self
            .segments
            .par_iter()
            .filter_map(|segment| {
                let warp = Warp::new(&segment.region, &segment.plane, &segment.viewpoint, &to)?;
                let bare = warp.count(&bare, |is_bare| is_bare);
                Some((segment.last_seen, DepthlessSight { id: segment.region.id, warp, bare }))
            })
            .collect();
        found.sort_by_key(|(last_seen, sight)| (Reverse(*last_seen), sight.id));
        let (segments, confidence) = (recall.belief.segments.pixels_mut(), recall.belief.confidence.pixels_mut());
        for (_, sight) in found.iter().filter(|(_, sight)| sight.is_expected()) {
            for run in &sight.warp.runs {
                for index in run.clone() {
                    if bare[index] && segments[index] == 0 {
                        (segments[index], confidence[index]) = (sight.id, CONFIDENCE);
                    }
                }
            }
        }
        recall.depthless = found.into_iter().map(|(_, sight)| sight).collect();
    }

    /// Takes in frame `number`, whose predictions are `seen`: remembers what has no depth of its segments, and forgets
    /// what it contradicts. `covered_from` is as in [`Self::expect`].
    pub fn take_in(&mut self, recall: &Recall<'_>, seen: &SegmentMap, covered_from: f32, number: u32) {
        let (depthless, bare) = depthless_segments(recall, seen, covered_from);
        let (frame, silhouette, depth) = (recall.frame, &recall.silhouette, &recall.depth);
        let viewpoint = Viewpoint { intrinsics: *frame.intrinsics(), map_from_camera: recall.map_from_camera };
        let view = View { frame, number, viewpoint, seen, bare: &bare, silhouette, depth, covered_from };
        let sights: BTreeMap<SegmentId, &DepthlessSight> =
            recall.depthless.iter().map(|sight| (sight.id, sight)).collect();
        let mut old: BTreeMap<SegmentId, DepthlessSegment> =
            self.segments.drain(..).map(|segment| (segment.region.id, segment)).collect();
        let areas = seen.areas();
        let regions: Vec<(Region, Option<DepthlessSegment>)> = Region::of_maps(&depthless, &bare, MIN_AREA)
            .into_iter()
            .filter(|region| region.bare as f32 >= MIN_BARE_SHARE_OF_ID * areas[&region.id] as f32)
            .map(|region| {
                let before = old.remove(&region.id);
                (region, before)
            })
            .collect();
        self.segments = regions
            .into_par_iter()
            .map(|(region, before)| {
                let sight = sights.get(&region.id).copied();
                view.seen_again(region, before.zip(sight))
            })
            .collect();
        self.segments.extend(old.into_values().filter_map(|segment| {
            let sight = sights.get(&segment.region.id).copied();
            view.unseen(segment, sight)
        }));
        self.segments.sort_by_key(|segment| (Reverse(segment.last_seen), segment.region.id));
        self.segments.truncate(MAX_SEGMENTS);
        self.segments.sort_by_key(|segment| segment.region.id);
    }

    /// The ids that are remembered, in increasing order.
    pub fn ids(&self) -> impl Iterator<Item = SegmentId> + '_ {
        self.segments.iter().map(|segment| segment.region.id)
    }

    /// Moves everything along with the map.
    pub fn transform(&mut self, new_from_old: &LocalPose) {
        for segment in &mut self.segments {
            segment.viewpoint.map_from_camera = *new_from_old * segment.viewpoint.map_from_camera;
        }
    }
}

impl DepthlessSight {
    fn is_expected(&self) -> bool {
        self.bare > 0 && self.bare as f32 >= MIN_BARE_SHARE * self.warp.area as f32
    }
}

impl View<'_> {
    /// What is remembered of a segment with bare pixels in this view: they, or what was remembered `before`.
    fn seen_again(&self, region: Region, before: Option<(DepthlessSegment, &DepthlessSight)>) -> DepthlessSegment {
        let mut is_predicted = false;
        let mut carried_over = None;
        if let Some((segment, sight)) = before {
            let both = sight.warp.count(self.bare.pixels(), |id| id == region.id);
            is_predicted = both as f32 >= MIN_AGREEMENT * (region.bare + sight.bare - both) as f32;
            let is_complete = (region.bare - both) as f32 <= MAX_REVEALED * region.bare as f32;
            let is_cut_off = sight.warp.share_in_view < 1.0 && is_predicted && is_complete;
            let is_poor = (region.area as f32) < POOR_SHARE * sight.warp.area as f32;
            if is_cut_off || is_poor && segment.poor_views < MAX_POOR_VIEWS {
                let poor_views = if is_poor { segment.poor_views.saturating_add(1) } else { 0 };
                return DepthlessSegment { last_seen: self.number, poor_views, contradictions: 0, ..segment };
            }
            carried_over = Some(Plane { inverse: sight.warp.inverse, support: segment.plane.support });
        }
        let found = Plane::behind(&region, self.frame, self.seen);
        // Close up there may be no depth around any more: then the plane that served so far is better.
        let plane = carried_over.filter(|old| is_predicted && old.support > found.support).unwrap_or(found);
        let (viewpoint, last_seen) = (self.viewpoint, self.number);
        DepthlessSegment { region, plane, viewpoint, last_seen, poor_views: 0, contradictions: 0 }
    }

    /// What is remembered of a segment without bare pixels in this view; `None` if that has been contradicted enough.
    fn unseen(&self, mut segment: DepthlessSegment, sight: Option<&DepthlessSight>) -> Option<DepthlessSegment> {
        let is_contradicted = sight.is_some_and(|sight| {
            let pixels = sight.warp.runs.iter().cloned().flatten();
            let others = pixels.filter(|index| self.shows_another(*index, sight));
            sight.warp.share_in_view >= FULLY_IN_VIEW
                && others.count() as f32 > CONTRADICTED_SHARE * sight.warp.area as f32
        });
        segment.contradictions += u8::from(is_contradicted);
        (segment.contradictions < MAX_CONTRADICTIONS).then_some(segment)
    }

    /// Whether there is something else than the segment at a pixel, and not only before it: a surface of the frame or of
    /// the map, or another prediction.
    fn shows_another(&self, index: usize, sight: &DepthlessSight) -> bool {
        let (column, row) = (index % self.frame.width(), index / self.frame.width());
        let inverse = sight.warp.inverse_of_pixel.dot(glam::Vec3::new(column as f32, row as f32, 1.0));
        let hides = |depth: f32| depth * inverse < 1.0 - HIDING_MARGIN;
        let at = (column, row);
        let observed = self.frame.depth()[at];
        if observed > 0.0 {
            return !hides(observed);
        }
        if self.silhouette[at] >= self.covered_from {
            return !hides(self.depth[at]);
        }
        ![0, ABSTAIN, sight.id].contains(&self.seen[at])
    }
}

/// The ids of `seen` where there is no depth, and where `recall` is bare; 0 elsewhere.
fn depthless_segments(recall: &Recall<'_>, seen: &SegmentMap, covered_from: f32) -> (SegmentMap, SegmentMap) {
    let mut depthless = seen.clone();
    for (id, observed) in depthless.pixels_mut().iter_mut().zip(recall.frame.depth().pixels()) {
        *id = if *id == ABSTAIN || *observed > 0.0 { 0 } else { *id };
    }
    let mut bare = depthless.clone();
    for (id, silhouette) in bare.pixels_mut().iter_mut().zip(recall.silhouette.pixels()) {
        *id = if *silhouette >= covered_from { 0 } else { *id };
    }
    (depthless, bare)
}
