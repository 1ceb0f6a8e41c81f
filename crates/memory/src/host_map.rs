//! A map on the CPU, with any kind of segment store.

use crate::backend::{FrameTrust, MapBackend, MapContent, MapUpdate, VisibleGaussian};
use crate::growth::new_gaussians;
use crate::map::SplatMap;
use crate::recall::Recall;
use crate::removal::{Sight, longest_unseen, note_sights, sights};
use crate::segment_store::SegmentStore;
use crate::{GrowthRule, MemoryError, MemorySettings};
use rayon::prelude::*;
use splatseg_geometry::{LocalPose, RgbdFrame, SegmentId, SegmentMap};
use splatseg_render::{Balls, Camera};

/// The Gaussians and what they remember, in main memory.
#[derive(Debug)]
pub(crate) struct HostMap {
    pub settings: MemorySettings,
    pub map: SplatMap,
    pub store: Box<dyn SegmentStore>,
}

impl HostMap {
    /// Removes what is gone after frame number `number`.
    fn forget(&mut self, recall: &Recall<'_>, number: u32, update: &mut MapUpdate) {
        if self.settings.growth_rule() == GrowthRule::Paper {
            // Nothing is removed but what is beyond the limit: those longest out of view.
            for splat in recall.view.projected() {
                self.map.last_seen[splat.gaussian as usize] = number;
            }
            self.limit(update);
            return;
        }
        let found = match recall.sights.is_empty() {
            true => sights(&self.map.balls, recall.frame, recall.view.camera(), FrameTrust::Alone, &self.settings).0,
            false => Vec::new(),
        };
        let sights = if recall.sights.is_empty() { &found } else { &recall.sights };
        if let Some(keep) = note_sights(&mut self.map, sights, self.settings.removal_frames, number) {
            self.retain(keep, update);
        }
        self.limit(update);
    }

    /// Removes the Gaussians unseen longest if there are too many.
    fn limit(&mut self, update: &mut MapUpdate) {
        if let Some(keep) = longest_unseen(&self.map.last_seen, self.settings.max_gaussians) {
            update.was_full = true;
            self.retain(keep, update);
        }
    }

    fn retain(&mut self, keep: Vec<bool>, update: &mut MapUpdate) {
        self.map.retain(&keep);
        self.store.retain(&keep);
        update.note_kept(keep);
    }
}

impl MapBackend for HostMap {
    fn recall<'f>(
        &self,
        frame: &'f RgbdFrame<'_>,
        camera: &Camera,
        trust: FrameTrust,
    ) -> Result<Recall<'f>, MemoryError> {
        Ok(Recall::new(&self.map.balls, self.store.as_ref(), frame, camera, trust, &self.settings))
    }

    fn transform(&mut self, new_from_old: &LocalPose, _: &mut Recall<'_>) -> Result<(), MemoryError> {
        self.map.balls.means.par_iter_mut().for_each(|mean| *mean = new_from_old.to_world(*mean));
        Ok(())
    }

    fn fuse(&self, recall: &Recall<'_>, seen: &SegmentMap) -> Result<SegmentMap, MemoryError> {
        Ok(self.store.fuse(recall, seen))
    }

    fn visible_gaussians(&self, recall: &Recall<'_>) -> Result<Vec<VisibleGaussian>, MemoryError> {
        let (width, height) = (recall.frame.width(), recall.frame.height());
        let visible = recall.view.projected().iter().map(|splat| {
            let (column, row) = (splat.mean.x.round(), splat.mean.y.round());
            let is_inside = column >= 0.0 && row >= 0.0 && column < width as f32 && row < height as f32;
            let is_seen = recall.sights.get(splat.gaussian as usize) == Some(&Sight::Seen);
            let seen_at = (is_inside && is_seen).then(|| (row as usize * width + column as usize) as u32);
            VisibleGaussian { gaussian: splat.gaussian, seen_at }
        });
        Ok(visible.collect())
    }

    fn favour(&mut self, gaussians: &[u32], id: SegmentId) -> Result<(), MemoryError> {
        self.store.favour(gaussians, id);
        Ok(())
    }

    fn update(
        &mut self,
        recall: &mut Recall<'_>,
        seen: &SegmentMap,
        number: u32,
        _: &mut dyn Iterator<Item = SegmentId>,
    ) -> Result<MapUpdate, MemoryError> {
        let stage = tracing::debug_span!(target: "splatseg::stage", "grow").entered();
        let added = new_gaussians(recall, seen, &self.settings);
        self.map.add(&added, number);
        self.store.grow(&added, recall, seen);
        drop(stage);
        let stage = tracing::debug_span!(target: "splatseg::stage", "learn").entered();
        let learning = self.store.learn(recall, &self.map.balls, seen);
        drop(stage);
        let _stage = tracing::debug_span!(target: "splatseg::stage", "grow").entered();
        let mut update = MapUpdate { grown: added.len(), learning, ..MapUpdate::default() };
        self.forget(recall, number, &mut update);
        update.holds = self.store.changed_holds();
        Ok(update)
    }

    fn new_segment(&mut self, id: SegmentId) -> Result<(), MemoryError> {
        self.store.new_segment(id)
    }

    fn gaussian_count(&self) -> usize {
        self.map.len()
    }

    fn balls(&self) -> &Balls {
        &self.map.balls
    }

    fn colors(&self) -> &[[u8; 3]] {
        &self.map.colors
    }

    fn numbers_per_gaussian(&self) -> usize {
        self.store.numbers_per_gaussian()
    }

    fn segment_ids(&self) -> Result<Vec<SegmentId>, MemoryError> {
        Ok(self.store.segment_ids())
    }

    fn segment_shares(&self) -> Result<Option<Vec<f32>>, MemoryError> {
        Ok(self.store.segment_shares())
    }

    fn content(&self) -> Result<MapContent<'_>, MemoryError> {
        Ok(MapContent { map: &self.map, content: self.store.content() })
    }
}
