//! A map on a device, as a memory asks for it.

use crate::GpuError;
use crate::device::{Buffer, GpuDevice, cube_dim, cubes, threads};
use crate::evidence::Evidence;
use crate::features::Features;
use crate::gaussians::DeviceGaussians;
use crate::growth::Growth;
use crate::kernels::forget::{
    GROWN, HOLDS, LEARNT, NOWHERE, REMOVED, SHOWN, locate_seen, note_frame, note_visible, pack_flags, set,
};
use crate::store::{DeviceStore, Lesson, Rendered};
use crate::view::{GpuView, Sights, look, needs_sights, render};
use splatseg_geometry::{LocalPose, RgbdFrame, SegmentId, SegmentMap};
use splatseg_memory::{
    FrameTrust, GrowthRule, LearningExtent, MapBackend, MapContent, MapDevice, MapUpdate, MemoryError, MemorySettings,
    Recall, RememberedSegments, SegmentHold, SplatMap, VisibleGaussian, longest_unseen,
};
use splatseg_render::{Balls, Camera};
use std::sync::{LazyLock, OnceLock};

/// The map. Its Gaussians are on the device, and the host knows only how many there are.
#[derive(Debug)]
struct GpuMap<S: DeviceStore> {
    device: GpuDevice,
    settings: MemorySettings,
    gaussians: DeviceGaussians,
    store: S,
    /// What was read to be saved or shown, until the map changes.
    copy: OnceLock<(SplatMap, S::Copy)>,
}

impl MapDevice for GpuDevice {
    fn take_over(
        &self,
        settings: &MemorySettings,
        map: SplatMap,
        remembered: RememberedSegments,
    ) -> Result<Box<dyn MapBackend>, MemoryError> {
        match remembered {
            RememberedSegments::Votes(votes) => {
                let gaussians = DeviceGaussians::new(self, &map, Evidence::columns(&votes))?;
                Ok(GpuMap::boxed(self, settings, gaussians, Evidence { settings: settings.clone() }))
            }
            RememberedSegments::Features { features, codes } => {
                let columns = Features::columns(&features, codes.codebook().feature_dim());
                let gaussians = DeviceGaussians::new(self, &map, columns)?;
                Ok(GpuMap::boxed(self, settings, gaussians, Features::new(self, settings, codes)?))
            }
        }
    }
}

/// The device's part of a recall.
fn view_of<'a, S: DeviceStore>(recall: &'a Recall<'_>) -> Result<&'a Rendered<S::Read>, GpuError> {
    recall.device_view().ok_or(GpuError::ForeignView)
}

/// How each of the `ids` is held, from its flags in a report.
fn holds(ids: &[SegmentId], report: &[u32]) -> Vec<(SegmentId, SegmentHold)> {
    let hold = |flags: &u32| match *flags {
        0 => SegmentHold::Nothing,
        flags if flags & SHOWN != 0 => SegmentHold::Shown,
        _ => SegmentHold::Votes,
    };
    ids.iter().copied().zip(report.iter().skip(HOLDS).map(hold)).collect()
}

impl<S: DeviceStore> GpuMap<S> {
    fn boxed(
        device: &GpuDevice,
        settings: &MemorySettings,
        gaussians: DeviceGaussians,
        store: S,
    ) -> Box<dyn MapBackend> {
        let (device, settings) = (device.clone(), settings.clone());
        Box::new(Self { device, settings, gaussians, store, copy: OnceLock::new() })
    }

    /// What the device holds, read if it was not since the map changed.
    fn copy(&self) -> Result<&(SplatMap, S::Copy), GpuError> {
        if let Some(copy) = self.copy.get() {
            return Ok(copy);
        }
        let copy = (self.gaussians.read()?, self.store.read(&self.device, &self.gaussians)?);
        Ok(self.copy.get_or_init(|| copy))
    }

    /// The copied map, or an empty one if the device fails, which is logged.
    fn map_or_empty(&self) -> &SplatMap {
        static EMPTY: LazyLock<SplatMap> = LazyLock::new(SplatMap::default);
        self.copy().map_or_else(
            |error| {
                tracing::error!("{error}");
                &*EMPTY
            },
            |(map, _)| map,
        )
    }

    /// Writes the Gaussians that frame number `number` shows and the map lacks behind the others, with what they know of
    /// the `target`, and counts them in `report`.
    fn grow(
        &mut self,
        view: &GpuView,
        recall: &Recall<'_>,
        seen: &Buffer,
        target: &Buffer,
        number: u32,
        report: &Buffer,
    ) -> Result<(), GpuError> {
        let (frame, map_from_camera) = (recall.frame(), *recall.map_from_camera());
        self.gaussians.reserve(frame.width() * frame.height())?;
        let growth = Growth { device: &self.device, view, frame, map_from_camera, seen, settings: &self.settings };
        let pixels = growth.write(&self.gaussians, number, report)?;
        let lesson = Lesson { device: &self.device, gaussians: &self.gaussians, target, report };
        self.store.grow(&lesson, &pixels);
        Ok(())
    }

    /// Counts what has grown now, if what comes next depends on it; returns the number.
    fn count_grown(&mut self, view: &GpuView, report: &Buffer) -> Result<Option<usize>, GpuError> {
        let is_paper = self.settings.growth_rule() == GrowthRule::Paper;
        if view.sights.count > 0 && !is_paper && !S::LEARNS_BY_COUNT {
            return Ok(None);
        }
        let [found] = self.device.download([report])?;
        // It is not to be counted again.
        set::launch(&self.device.client, cubes(1), cube_dim(), report.arg(), GROWN as u32, 0);
        Ok(Some(self.note_grown(&found)))
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
            u32::from(sights.trust == FrameTrust::Confirmed),
            sights.count as u32,
        );
    }

    /// Notes which Gaussians frame number `number` has in view.
    fn note_visible(&self, sights: &Sights, number: u32) {
        let (cubes, cube) = threads(sights.count);
        let (visible, last_seen) = (sights.visible.arg(), self.gaussians.last_seen().arg());
        note_visible::launch(&self.device.client, cubes, cube, visible, last_seen, number, sights.count as u32);
    }

    /// Removes what is gone after frame number `number`, and says what is left and how it holds the `ids`.
    fn forget(
        &mut self,
        view: &GpuView,
        (number, ids): (u32, &[SegmentId]),
        report: &Buffer,
        grown: Option<usize>,
        update: &mut MapUpdate,
    ) -> Result<(), GpuError> {
        let keep = self.device.filled(self.gaussians.len() + view.pixels(), 1, "which Gaussians are kept")?;
        if self.settings.growth_rule() == GrowthRule::Paper {
            self.note_visible(&view.sights, number);
        } else if view.sights.count == 0 {
            // The map was empty: the frame is compared with what has grown.
            let alone = FrameTrust::Alone;
            let sights = look(&self.device, &self.gaussians, &view.depth, &view.camera, alone, &self.settings)?;
            self.note_frame(&sights, number, &keep, report);
        } else {
            self.note_frame(&view.sights, number, &keep, report);
        }
        let knows_holds = self.store.mark_holds(&self.device, &self.gaussians, &keep, ids, report)?;
        let [found] = self.device.download([report])?;
        update.grown = match grown {
            Some(grown) => grown,
            None => self.note_grown(&found),
        };
        update.learning.active_gaussians = found[LEARNT] as usize;
        update.holds = knows_holds.then(|| holds(ids, &found));
        if found[REMOVED] > 0 {
            self.retain(&keep, update)?;
        }
        if self.gaussians.len() > self.settings.max_gaussians {
            self.shrink(ids, update)?;
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
    fn shrink(&mut self, ids: &[SegmentId], update: &mut MapUpdate) -> Result<(), GpuError> {
        let [mut last_seen] = self.device.download([self.gaussians.last_seen()])?;
        last_seen.truncate(self.gaussians.len());
        if let Some(flags) = longest_unseen(&last_seen, self.settings.max_gaussians) {
            let flags: Vec<u32> = flags.into_iter().map(u32::from).collect();
            let keep = self.device.upload(&flags, "which Gaussians are kept")?;
            update.was_full = true;
            self.retain(&keep, update)?;
            let report = self.device.zeros(HOLDS + ids.len(), "report of a frame")?;
            let keep = self.device.filled(self.gaussians.len(), 1, "which Gaussians are kept")?;
            let knows_holds = self.store.mark_holds(&self.device, &self.gaussians, &keep, ids, &report)?;
            let [found] = self.device.download([&report])?;
            update.holds = knows_holds.then(|| holds(ids, &found));
        }
        Ok(())
    }
}

impl<S: DeviceStore> MapBackend for GpuMap<S> {
    fn recall<'f>(
        &self,
        frame: &'f RgbdFrame<'_>,
        camera: &Camera,
        trust: FrameTrust,
    ) -> Result<Recall<'f>, MemoryError> {
        let (view, images) = render(&self.device, &self.gaussians, &self.store, frame, camera, trust, &self.settings)?;
        Ok(Recall::of_device(frame, camera, images, Box::new(view)))
    }

    fn transform(&mut self, new_from_old: &LocalPose, recall: &mut Recall<'_>) -> Result<(), MemoryError> {
        self.copy = OnceLock::new();
        let camera = *recall.view().camera();
        recall.device_view_mut::<Rendered<S::Read>>().ok_or(GpuError::ForeignView)?.view.camera = camera;
        Ok(self.gaussians.transform(new_from_old)?)
    }

    fn fuse(&self, recall: &Recall<'_>, seen: &SegmentMap) -> Result<SegmentMap, MemoryError> {
        Ok(self.store.fuse(&self.device, view_of::<S>(recall)?, recall, seen)?)
    }

    fn visible_gaussians(&self, recall: &Recall<'_>) -> Result<Vec<VisibleGaussian>, MemoryError> {
        let view = &view_of::<S>(recall)?.view;
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
        let limit = if needs_sights(&self.settings) { view.pixels() as u32 } else { 0 };
        let located =
            visible.map(|(gaussian, pixel)| VisibleGaussian { gaussian, seen_at: (pixel < limit).then_some(pixel) });
        Ok(located.collect())
    }

    fn favour(&mut self, gaussians: &[u32], id: SegmentId) -> Result<(), MemoryError> {
        self.copy = OnceLock::new();
        Ok(self.store.favour(&self.device, &self.gaussians, gaussians, id)?)
    }

    fn update(
        &mut self,
        recall: &mut Recall<'_>,
        seen: &SegmentMap,
        number: u32,
        ids: &mut dyn Iterator<Item = SegmentId>,
    ) -> Result<MapUpdate, MemoryError> {
        self.copy = OnceLock::new();
        let ids: Vec<SegmentId> = ids.collect();
        let report = self.device.zeros(HOLDS + ids.len(), "report of a frame")?;
        let rendered = view_of::<S>(recall)?;
        let view = &rendered.view;
        let stage = tracing::debug_span!(target: "splatseg::stage", "grow").entered();
        let target = self.store.target(&self.device, view, recall, seen)?;
        let sent = view.send_seen(&self.device, seen)?;
        self.grow(view, recall, &sent, &target, number, &report)?;
        let grown = self.count_grown(view, &report)?;
        drop(stage);
        let _stage = tracing::debug_span!(target: "splatseg::stage", "learn").entered();
        let lesson = Lesson { device: &self.device, gaussians: &self.gaussians, target: &target, report: &report };
        let active_pixels = self.store.learn(&lesson, rendered)?;
        let learning = LearningExtent { active_pixels, active_gaussians: 0 };
        let mut update = MapUpdate { learning, ..MapUpdate::default() };
        self.forget(view, (number, &ids), &report, grown, &mut update)?;
        Ok(update)
    }

    fn new_segment(&mut self, id: SegmentId) -> Result<(), MemoryError> {
        self.store.new_segment(&self.device, id)
    }

    fn gaussian_count(&self) -> usize {
        self.gaussians.len()
    }

    fn balls(&self) -> &Balls {
        &self.map_or_empty().balls
    }

    fn colors(&self) -> &[[u8; 3]] {
        &self.map_or_empty().colors
    }

    fn numbers_per_gaussian(&self) -> usize {
        self.store.numbers_per_gaussian()
    }

    fn segment_ids(&self) -> Result<Vec<SegmentId>, MemoryError> {
        Ok(self.store.segment_ids(&self.device, &self.gaussians)?)
    }

    fn segment_shares(&self) -> Result<Option<Vec<f32>>, MemoryError> {
        Ok(self.store.segment_shares(&self.copy()?.1))
    }

    fn content(&self) -> Result<MapContent<'_>, MemoryError> {
        let (map, remembered) = self.copy()?;
        Ok(MapContent { map, content: Some(self.store.content(remembered)) })
    }
}
