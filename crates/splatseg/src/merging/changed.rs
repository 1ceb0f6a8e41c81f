//! Changes between two maps, and their consequences for the merged one: the later map is right.

use super::MergeError;
use glam::DVec3;
use rayon::prelude::*;
use splatseg_geometry::{KeyframeId, MapCorrection, MapView, Pose, RemappedId, SegmentId};
use splatseg_memory::SplatMemory;
use splatseg_objects::{DepthView, MapChanges, ObservedMap, PlaceSight, place_sights};
use splatseg_odometry::{KeyframeView, PoseSourceError, keyframe_views};
use std::collections::BTreeSet;

/// Of the surfaces of a map that the other one looked at, at most this share may have been seen through, percent. In eight
/// synthetic rooms in which seven things changed it was 8 at most. Rooms of the same size with the same walls, which had been
/// taken for each other, had 18 or more.
const MAX_SEEN_THROUGH: u32 = 15;

/// Gaussians that are looked at for that.
const SAMPLES: usize = 20_000;

/// The changes between two maps in the same world.
pub(super) struct Changed {
    pub(super) changes: MapChanges,
    /// The later map's observation of each Gaussian of the earlier one.
    sights: Vec<PlaceSight>,
    /// Of the surfaces of each map that the other one looked at, the share that it saw through, percent.
    pub(super) seen_through: [u32; 2],
}

/// The keyframes of a map, before and after a correction.
pub(super) struct CorrectedViews {
    /// Their views after it.
    pub(super) views: Vec<DepthView>,
    /// The places of their cameras before it, world coordinates, metres.
    pub(super) cameras: Vec<(KeyframeId, DVec3)>,
}

/// The views of a map's keyframes after a correction, without those of a map that it continues, if it does.
pub(super) fn views(
    keyframes: &[u8],
    known: Option<&[u8]>,
    correction: &MapCorrection,
) -> Result<CorrectedViews, PoseSourceError> {
    let camera = |view: &KeyframeView| (view.id, view.world_from_camera.translation());
    let view = |view: KeyframeView| {
        let motion = correction.new_from_old.get(&view.id).copied().unwrap_or(Pose::IDENTITY);
        DepthView { world_from_camera: motion * view.world_from_camera, intrinsics: view.intrinsics, depth: view.depth }
    };
    let views = keyframe_views(keyframes, known)?;
    let cameras = views.iter().map(camera).collect();
    Ok(CorrectedViews { views: views.into_iter().map(view).collect(), cameras })
}

impl Changed {
    pub(super) fn new(earlier: &SplatMemory, later: &SplatMemory, views: [Vec<DepthView>; 2]) -> Self {
        let sights = sights_of(&earlier.map(), &views[1], 1);
        let of_later = later.map();
        let back = sights_of(&of_later, &views[0], of_later.means.len().div_ceil(SAMPLES).max(1));
        let seen_through = [seen_through(&sights), seen_through(&back)];
        let [of_earlier, of_later] = views;
        let (before, after) = (ObservedMap::new(&earlier.map(), of_earlier), ObservedMap::new(&later.map(), of_later));
        Self { changes: MapChanges::between(&before, &after), sights, seen_through }
    }

    /// # Errors
    /// [`MergeError::Contradiction`] if too much has changed for one place.
    pub(super) fn require_agreement(&self, earlier_from_later: Pose) -> Result<(), MergeError> {
        let percent = self.seen_through[0].max(self.seen_through[1]);
        if percent > MAX_SEEN_THROUGH {
            return Err(MergeError::Contradiction { percent, limit: MAX_SEEN_THROUGH, earlier_from_later });
        }
        Ok(())
    }

    /// The Gaussians of the earlier map that are still there: not those of things that are gone or have moved, and not those
    /// that the later map saw through.
    pub(super) fn kept_gaussians(&self, earlier: &SplatMemory) -> Vec<bool> {
        let gone = self.changes.gone.iter().map(|object| object.id);
        let gone: BTreeSet<SegmentId> = gone.chain(self.changes.moved.iter().map(|moved| moved.before.id)).collect();
        let map = earlier.map();
        let ids = map.segment_ids();
        self.sights.iter().zip(ids).map(|(sight, id)| *sight != PlaceSight::Empty && !gone.contains(&id)).collect()
    }

    /// Ids of the later map, with those of the earlier map's things that have moved there.
    pub(super) fn same(&self) -> Vec<RemappedId> {
        let moved = self.changes.moved.iter();
        moved.map(|moved| RemappedId { from: moved.after.id, into: moved.before.id }).collect()
    }
}

/// Where the Gaussians are that are not kept, world coordinates, metres.
pub(super) fn removed(map: &MapView<'_>, kept: &[bool]) -> Vec<DVec3> {
    let gone = map.means.iter().zip(kept).filter(|(_, kept)| !**kept);
    gone.map(|(mean, _)| mean.as_dvec3() + map.origin).collect()
}

/// Observations of every `step`th Gaussian of a map in views.
fn sights_of(map: &MapView<'_>, views: &[DepthView], step: usize) -> Vec<PlaceSight> {
    let places: Vec<usize> = (0..map.means.len()).step_by(step).collect();
    let points: Vec<_> = places.par_iter().map(|index| map.means[*index].as_dvec3() + map.origin).collect();
    place_sights(views, &points)
}

/// Share of the observed places that are empty, percent.
fn seen_through(sights: &[PlaceSight]) -> u32 {
    let count = |kind| sights.iter().filter(|sight| **sight == kind).count();
    let (seen, empty) = (count(PlaceSight::Seen), count(PlaceSight::Empty));
    (100 * empty / (seen + empty).max(1)) as u32
}
