//! A map of evidence on a device, as a memory asks for it.

use crate::GpuError;
use crate::device::{Buffer, GpuDevice, threads};
use crate::gaussians::{DeviceGaussians, packed};
use crate::kernels::forget::{CARRIED, NOWHERE, REMOVED, VOTED, locate_seen, mark_carried, note_frame};
use crate::kernels::fuse::fuse;
use crate::kernels::vote::{LABELS, VoteRuleLaunch, count_votes, give_votes};
use crate::view::{GpuView, Sights, look, render, tile_count};
use cubecl::prelude::CubeDim;
use splatseg_geometry::{RgbdFrame, SegmentId, SegmentMap};
use splatseg_memory::{
    ABSTAIN, EvidenceDevice, GrowthRule, LearningExtent, MapBackend, MapContent, MapUpdate, MemoryError,
    MemorySettings, NewGaussian, Recall, SplatContentView, SplatMap, VisibleGaussian, Votes, longest_unseen,
    new_gaussians,
};
use splatseg_render::{Balls, Camera};
use std::sync::OnceLock;

/// The map: its Gaussians are on the device; the host knows where they are, which never changes, but not what they remember.
#[derive(Debug)]
struct GpuMap {
    device: GpuDevice,
    settings: MemorySettings,
    gaussians: DeviceGaussians,
    /// Where the Gaussians are, and their colours; when they were seen is known on the device alone.
    host: SplatMap,
    /// What was read to be saved or shown, until the map changes.
    copy: OnceLock<HostCopy>,
}

/// All that the device holds.
#[derive(Debug)]
struct HostCopy {
    map: SplatMap,
    votes: Vec<Votes>,
}

impl EvidenceDevice for GpuDevice {
    fn take_over(
        &self,
        settings: &MemorySettings,
        map: SplatMap,
        votes: Vec<Votes>,
    ) -> Result<Box<dyn MapBackend>, MemoryError> {
        let mut gaussians = DeviceGaussians::new(self)?;
        let balls = map.balls.means.iter().zip(&map.balls.radii).zip(&votes);
        let added: Vec<_> = balls.map(|((mean, radius), votes)| packed(*mean, *radius, votes)).collect();
        gaussians.add(&added, 0)?;
        if !added.is_empty() {
            gaussians.restore_sights(&map.last_seen, &map.seen_through)?;
        }
        let (device, settings) = (self.clone(), settings.clone());
        Ok(Box::new(GpuMap { device, settings, gaussians, host: map, copy: OnceLock::new() }))
    }
}

/// The device's part of a recall.
fn view_of<'a>(recall: &'a Recall<'_>) -> Result<&'a GpuView, GpuError> {
    recall.device_view().ok_or(GpuError::ForeignView)
}

impl GpuMap {
    /// What the device holds, read if it was not since the map changed.
    fn copy(&self) -> Result<&HostCopy, GpuError> {
        if let Some(copy) = self.copy.get() {
            return Ok(copy);
        }
        let states = self.gaussians.states()?;
        let map =
            SplatMap { last_seen: states.last_seen, seen_through: states.seen_through, ..self.host.clone() };
        Ok(self.copy.get_or_init(|| HostCopy { map, votes: states.votes }))
    }

    /// Adds Gaussians that frame number `number` saw first.
    fn grow(&mut self, added: &[NewGaussian], seen: &SegmentMap, number: u32) -> Result<(), GpuError> {
        let votes_at = |pixel: usize| match seen.pixels()[pixel] {
            0 => Votes::one(0, self.settings.no_segment_weight),
            ABSTAIN => Votes::default(),
            id => Votes::one(id, 1.0),
        };
        let sent: Vec<_> =
            added.iter().map(|new| packed(new.mean, new.radius, &votes_at(new.pixel))).collect();
        self.gaussians.add(&sent, number)?;
        for new in added {
            self.host.balls.push(new.mean, new.radius);
            self.host.colors.push(new.color);
        }
        Ok(())
    }

    /// Gives the votes of a frame, and counts the Gaussians that have any in `report`.
    fn learn(&self, view: &GpuView, seen: &SegmentMap, report: &Buffer) -> Result<(), GpuError> {
        let (device, tiles) = (&self.device, &view.tiles);
        let labels = view.send_seen(device, seen)?;
        let pairs = tiles.pair_count;
        let totals = device.zeros(pairs, "votes of pairs")?;
        let label_ids = device.empty(pairs * LABELS, "votes of pairs")?;
        let label_weights = device.empty(pairs * LABELS, "votes of pairs")?;
        count_votes::launch(
            &device.client,
            crate::device::cubes(tile_count(&view.camera)),
            crate::device::cube_dim(),
            tiles.splats.arg(),
            tiles.splat_of_pair.arg(),
            tiles.pairs.arg(),
            tiles.begins.arg(),
            tiles.ends.arg(),
            labels.arg(),
            view.depth.arg(),
            totals.arg(),
            label_ids.arg(),
            label_weights.arg(),
            view.args(),
            self.settings.depth_tolerance,
        );
        let (cubes, cube) = threads(tiles.visible_count);
        give_votes::launch(
            &device.client,
            cubes,
            cube,
            tiles.order.arg(),
            tiles.starts.arg(),
            tiles.tile_counts.arg(),
            tiles.gaussians.arg(),
            totals.arg(),
            label_ids.arg(),
            label_weights.arg(),
            self.gaussians.vote_ids().arg(),
            self.gaussians.votes().arg(),
            report.arg(),
            VoteRuleLaunch::new(self.settings.no_segment_weight, self.settings.max_votes),
            tiles.visible_count as u32,
        );
        Ok(())
    }

    /// Notes what frame number `number` says of each Gaussian; returns 1 for those that are to be kept.
    fn note_frame(&self, sights: &Sights, number: u32, report: &Buffer) -> Result<Buffer, GpuError> {
        let count = self.gaussians.len();
        let keep = self.device.empty(count, "which Gaussians are kept")?;
        let (cubes, cube) = threads(count);
        note_frame::launch(
            &self.device.client,
            cubes,
            cube,
            sights.sights.arg(),
            sights.counters.arg(),
            self.gaussians.last_seen().arg(),
            self.gaussians.seen_through().arg(),
            keep.arg(),
            report.arg(),
            number,
            u32::from(self.settings.removal_frames),
            sights.count as u32,
            count as u32,
        );
        Ok(keep)
    }

    fn mark_carried(&self, keep: &Buffer, report: &Buffer) {
        let (cubes, cube): (_, CubeDim) = threads(self.gaussians.len());
        mark_carried::launch(
            &self.device.client,
            cubes,
            cube,
            self.gaussians.vote_ids().arg(),
            self.gaussians.votes().arg(),
            keep.arg(),
            report.arg(),
            self.settings.min_evidence,
            self.gaussians.len() as u32,
        );
    }

    /// Removes what is gone after frame number `number`, and reports what is left.
    fn forget(
        &mut self,
        view: &GpuView,
        number: u32,
        segments: usize,
        report: Buffer,
        update: &mut MapUpdate,
    ) -> Result<(), GpuError> {
        let is_full = self.gaussians.len() > self.settings.max_gaussians;
        let removes = self.settings.growth_rule() != GrowthRule::Paper || is_full;
        let keep = if removes {
            // The first frame says nothing of an empty map: it is asked again about what has grown.
            let first = match view.sights.count {
                0 => Some(look(&self.device, &self.gaussians, &view.depth, &view.camera, &self.settings)?),
                _ => None,
            };
            self.note_frame(first.as_ref().unwrap_or(&view.sights), number, &report)?
        } else {
            self.device.filled(self.gaussians.len(), 1, "which Gaussians are kept")?
        };
        self.mark_carried(&keep, &report);
        let [found] = self.device.download([&report])?;
        update.learning.active_gaussians = found[VOTED] as usize;
        let flags = found[CARRIED..].iter().take(segments + 1);
        update.carried = Some(flags.map(|flag| *flag == 1).collect());
        if found[REMOVED] > 0 {
            self.retain(&keep, update)?;
        }
        if is_full && self.gaussians.len() > self.settings.max_gaussians {
            self.shrink(update)?;
        }
        Ok(())
    }

    /// Keeps the Gaussians whose entry is 1.
    fn retain(&mut self, keep: &Buffer, update: &mut MapUpdate) -> Result<(), GpuError> {
        let [flags] = self.device.download([keep])?;
        let flags: Vec<bool> = flags.iter().take(self.gaussians.len()).map(|flag| *flag == 1).collect();
        let kept = flags.iter().filter(|is_kept| **is_kept).count();
        self.gaussians.retain(keep, kept)?;
        self.host = retained(&self.host, &flags);
        update.note_kept(flags);
        Ok(())
    }

    /// Removes those not seen for longest.
    fn shrink(&mut self, update: &mut MapUpdate) -> Result<(), GpuError> {
        let [mut last_seen] = self.device.download([self.gaussians.last_seen()])?;
        last_seen.truncate(self.gaussians.len());
        if let Some(flags) = longest_unseen(&last_seen, self.settings.max_gaussians) {
            let flags: Vec<u32> = flags.into_iter().map(u32::from).collect();
            let keep = self.device.upload(&flags, "which Gaussians are kept")?;
            update.was_full = true;
            self.retain(&keep, update)?;
            // Known again when it is asked for.
            update.carried = None;
        }
        Ok(())
    }
}

/// The Gaussians for which `keep` holds, in their order.
fn retained(map: &SplatMap, keep: &[bool]) -> SplatMap {
    let mut kept = SplatMap::default();
    for (index, _) in keep.iter().enumerate().filter(|(_, is_kept)| **is_kept) {
        kept.balls.push(map.balls.means[index], map.balls.radii[index]);
        kept.colors.push(map.colors[index]);
    }
    kept
}

impl MapBackend for GpuMap {
    fn recall<'f>(&self, frame: &'f RgbdFrame<'_>, camera: &Camera) -> Result<Recall<'f>, MemoryError> {
        let (view, images) = render(&self.device, &self.gaussians, frame, camera, &self.settings)?;
        Ok(Recall::of_device(frame, camera, images, Box::new(view)))
    }

    fn fuse(&self, recall: &Recall<'_>, seen: &SegmentMap) -> Result<SegmentMap, MemoryError> {
        let view = view_of(recall)?;
        let sent = view.send_seen(&self.device, seen)?;
        let pixels = seen.pixels().len();
        let fused = self.device.empty(pixels, "fused segments")?;
        let observed = self.settings.observation_weight;
        let (cubes, cube) = threads(pixels);
        fuse::launch(
            &self.device.client,
            cubes,
            cube,
            view.images.arg(),
            view.table_ids.arg(),
            view.table_evidence.arg(),
            sent.arg(),
            fused.arg(),
            observed,
            observed * self.settings.no_segment_weight,
            pixels as u32,
        );
        let [found] = self.device.download([&fused])?;
        let (width, height) = seen.size();
        let failed = |_| GpuError::Failed { reason: "the fused segments have another size".to_owned() };
        Ok(SegmentMap::from_pixels(width, height, found).map_err(failed)?)
    }

    fn visible_gaussians(&self, recall: &Recall<'_>) -> Result<Vec<VisibleGaussian>, MemoryError> {
        let view = view_of(recall)?;
        let count = view.sights.count;
        let pixels = self.device.empty(count, "places of Gaussians")?;
        let (cubes, cube) = threads(count);
        locate_seen::launch(
            &self.device.client,
            cubes,
            cube,
            self.gaussians.balls().arg(),
            view.sights.sights.arg(),
            view.sights.visible.arg(),
            pixels.arg(),
            view.args(),
            count as u32,
        );
        let [found] = self.device.download([&pixels])?;
        let visible = (0..).zip(found).take(count).filter(|(_, pixel)| *pixel != NOWHERE);
        let limit = (view.camera.intrinsics.width * view.camera.intrinsics.height) as u32;
        let located = visible
            .map(|(gaussian, pixel)| VisibleGaussian { gaussian, seen_at: (pixel < limit).then_some(pixel) });
        Ok(located.collect())
    }

    fn favour(&mut self, gaussians: &[u32], id: SegmentId) -> Result<(), MemoryError> {
        self.copy = OnceLock::new();
        self.gaussians.favour(gaussians, id, self.settings.max_votes)?;
        Ok(())
    }

    fn update(
        &mut self,
        recall: &mut Recall<'_>,
        seen: &SegmentMap,
        number: u32,
        segments: usize,
    ) -> Result<MapUpdate, MemoryError> {
        self.copy = OnceLock::new();
        let stage = tracing::debug_span!(target: "splatseg::stage", "grow").entered();
        let added = new_gaussians(recall, seen, &self.settings);
        self.grow(&added, seen, number)?;
        drop(stage);
        let _stage = tracing::debug_span!(target: "splatseg::stage", "learn").entered();
        let view = view_of(recall)?;
        let report = self.device.zeros(CARRIED + segments + 1, "report of a frame")?;
        self.learn(view, seen, &report)?;
        let learning = LearningExtent { active_pixels: seen.pixels().len(), active_gaussians: 0 };
        let mut update = MapUpdate { grown: added.len(), learning, ..MapUpdate::default() };
        self.forget(view, number, segments, report, &mut update)?;
        Ok(update)
    }

    fn new_segment(&mut self, _: SegmentId) -> Result<(), MemoryError> {
        Ok(())
    }

    fn balls(&self) -> &Balls {
        &self.host.balls
    }

    fn colors(&self) -> &[[u8; 3]] {
        &self.host.colors
    }

    fn numbers_per_gaussian(&self) -> usize {
        2 * Votes::SLOTS
    }

    fn segment_ids(&self) -> Result<Vec<SegmentId>, MemoryError> {
        Ok(self.copy()?.votes.iter().map(|votes| votes.winner(self.settings.min_evidence)).collect())
    }

    fn segment_shares(&self) -> Result<Option<Vec<f32>>, MemoryError> {
        let share = |votes: &Votes| votes.share(votes.winner(self.settings.min_evidence));
        Ok(Some(self.copy()?.votes.iter().map(share).collect()))
    }

    fn content(&self) -> Result<MapContent<'_>, MemoryError> {
        let HostCopy { map, votes } = self.copy()?;
        Ok(MapContent { map, content: Some(SplatContentView::Evidence { votes }) })
    }
}
