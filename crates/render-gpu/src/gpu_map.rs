//! A map of evidence on a device, as a memory asks for it.

use crate::GpuError;
use crate::device::{Buffer, GpuDevice, cube_dim, cubes, threads};
use crate::gaussians::DeviceGaussians;
use crate::growth::Growth;
use crate::kernels::forget::{
    CARRIED, GROWN, NOWHERE, REMOVED, VOTED, locate_seen, mark_carried, note_frame, pack_flags, set,
};
use crate::kernels::fuse::fuse;
use crate::kernels::vote::{LABELS, VoteRuleLaunch, count_votes, give_votes};
use crate::view::{GpuView, Sights, look, render, tile_count};
use splatseg_geometry::{RgbdFrame, SegmentId, SegmentMap};
use splatseg_memory::{
    EvidenceDevice, GrowthRule, LearningExtent, MapBackend, MapContent, MapUpdate, MemoryError, MemorySettings, Recall,
    SplatContentView, SplatMap, VisibleGaussian, Votes, longest_unseen,
};
use splatseg_render::{Balls, Camera};
use std::sync::{LazyLock, OnceLock};

/// The map. Its Gaussians are on the device, and the host knows only how many there are.
#[derive(Debug)]
struct GpuMap {
    device: GpuDevice,
    settings: MemorySettings,
    gaussians: DeviceGaussians,
    /// What was read to be saved or shown, until the map changes.
    copy: OnceLock<HostCopy>,
}

/// All that the device holds.
#[derive(Debug, Default)]
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
        let gaussians = DeviceGaussians::new(self, &map, &votes)?;
        let (device, settings) = (self.clone(), settings.clone());
        Ok(Box::new(GpuMap { device, settings, gaussians, copy: OnceLock::new() }))
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
        let (map, votes) = self.gaussians.read()?;
        Ok(self.copy.get_or_init(|| HostCopy { map, votes }))
    }

    /// The copy, or an empty one if the device fails, which is logged.
    fn copy_or_empty(&self) -> &HostCopy {
        static EMPTY: LazyLock<HostCopy> = LazyLock::new(HostCopy::default);
        self.copy().unwrap_or_else(|error| {
            tracing::error!("{error}");
            &EMPTY
        })
    }

    /// Writes the Gaussians that frame number `number` shows and the map lacks behind the others, and counts them in
    /// `report`.
    fn grow(
        &mut self,
        view: &GpuView,
        frame: &RgbdFrame<'_>,
        seen: &SegmentMap,
        number: u32,
        report: &Buffer,
    ) -> Result<(), GpuError> {
        let seen = view.send_seen(&self.device, seen)?;
        self.gaussians.reserve(frame.width() * frame.height())?;
        let growth = Growth { device: &self.device, view, frame, seen: &seen, settings: &self.settings };
        growth.write(&self.gaussians, number, report)
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
            cubes(tile_count(&view.camera)),
            cube_dim(),
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

    /// Notes what frame number `number` says of Gaussians, and sets those that are gone to 0 in `keep`.
    fn note_frame(&self, sights: &Sights, number: u32, keep: &Buffer, report: &Buffer) {
        let (cubes, cube) = threads(sights.count);
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
        );
    }

    fn mark_carried(&self, keep: &Buffer, report: &Buffer) {
        let (cubes, cube) = threads(keep.len());
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

    /// Removes what is gone after frame number `number`, and says what is left.
    fn forget(&mut self, view: &GpuView, number: u32, report: &Buffer, update: &mut MapUpdate) -> Result<(), GpuError> {
        let room = view.camera.intrinsics.width * view.camera.intrinsics.height;
        let keep = self.device.filled(self.gaussians.len() + room, 1, "which Gaussians are kept")?;
        let is_paper = self.settings.growth_rule() == GrowthRule::Paper;
        let is_first = view.sights.count == 0;
        let mut grown = None;
        if is_first || is_paper {
            // What was grown decides what is asked.
            let [found] = self.device.download([report])?;
            grown = Some(self.note_grown(&found));
            // It is not to be counted again.
            set::launch(&self.device.client, cubes(1), cube_dim(), report.arg(), GROWN as u32, 0);
        }
        let is_full = self.gaussians.len() > self.settings.max_gaussians;
        if is_first && (!is_paper || is_full) {
            // The frame said nothing of an empty map: it is asked again about what has grown.
            let sights = look(&self.device, &self.gaussians, &view.depth, &view.camera, &self.settings)?;
            self.note_frame(&sights, number, &keep, report);
        } else if !is_paper || is_full {
            self.note_frame(&view.sights, number, &keep, report);
        }
        self.mark_carried(&keep, report);
        let [found] = self.device.download([report])?;
        update.grown = match grown {
            Some(grown) => grown,
            None => self.note_grown(&found),
        };
        update.learning.active_gaussians = found[VOTED] as usize;
        update.carried = Some(found[CARRIED..].iter().map(|flag| *flag == 1).collect());
        if found[REMOVED] > 0 {
            self.retain(&keep, update)?;
        }
        if self.gaussians.len() > self.settings.max_gaussians {
            self.shrink(update)?;
        }
        Ok(())
    }

    /// Counts the Gaussians that a report says have grown; returns their number.
    fn note_grown(&mut self, found: &[u32]) -> usize {
        let grown = found[GROWN] as usize;
        self.gaussians.note_grown(grown);
        grown
    }

    /// Keeps the Gaussians whose entry is 1.
    fn retain(&mut self, keep: &Buffer, update: &mut MapUpdate) -> Result<(), GpuError> {
        let count = self.gaussians.len();
        let words = self.device.empty(count.div_ceil(32), "which Gaussians are kept")?;
        let (cubes, cube) = threads(words.len());
        pack_flags::launch(&self.device.client, cubes, cube, keep.arg(), words.arg(), count as u32);
        let [words] = self.device.download([&words])?;
        let flags: Vec<bool> = (0..count).map(|index| words[index / 32] >> (index % 32) & 1 == 1).collect();
        let kept = flags.iter().filter(|is_kept| **is_kept).count();
        self.gaussians.retain(keep, kept)?;
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
            view.surfaces.arg(),
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
        let located =
            visible.map(|(gaussian, pixel)| VisibleGaussian { gaussian, seen_at: (pixel < limit).then_some(pixel) });
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
        let report = self.device.zeros(CARRIED + segments + 1, "report of a frame")?;
        let view = view_of(recall)?;
        let stage = tracing::debug_span!(target: "splatseg::stage", "grow").entered();
        self.grow(view, recall.frame(), seen, number, &report)?;
        drop(stage);
        let _stage = tracing::debug_span!(target: "splatseg::stage", "learn").entered();
        self.learn(view, seen, &report)?;
        let learning = LearningExtent { active_pixels: seen.pixels().len(), active_gaussians: 0 };
        let mut update = MapUpdate { learning, ..MapUpdate::default() };
        self.forget(view, number, &report, &mut update)?;
        Ok(update)
    }

    fn new_segment(&mut self, _: SegmentId) -> Result<(), MemoryError> {
        Ok(())
    }

    fn gaussian_count(&self) -> usize {
        self.gaussians.len()
    }

    fn balls(&self) -> &Balls {
        &self.copy_or_empty().map.balls
    }

    fn colors(&self) -> &[[u8; 3]] {
        &self.copy_or_empty().map.colors
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
