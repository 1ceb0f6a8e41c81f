//! Votes of Gaussians on a device.

use crate::GpuError;
use crate::device::{Buffer, GpuDevice, cube_dim, cubes, threads};
use crate::gaussians::{Column, DeviceGaussians};
use crate::kernels::expect::{EvidenceRuleLaunch, SLOTS, expect};
use crate::kernels::forget::mark_holds;
use crate::kernels::fuse::fuse;
use crate::kernels::vote::{
    LABELS, PairVotesLaunch, VoteColumnsLaunch, VoteRuleLaunch, count_votes, favour, first_votes, give_votes,
};
use crate::store::{DeviceStore, Lesson, Rendered};
use crate::view::{GpuView, tile_count};
use splatseg_geometry::{SegmentId, SegmentMap};
use splatseg_memory::{MemoryError, MemorySettings, Recall, SplatContentView, Votes};

/// The store of a memory of evidence: two columns, `[gaussians, 4]` of ids and `[gaussians, 4]` of votes.
#[derive(Debug)]
pub(crate) struct Evidence {
    pub settings: MemorySettings,
}

/// Evidence of a view, both `[16, height, width]`.
#[derive(Debug)]
pub(crate) struct EvidenceTables {
    pub ids: Buffer,
    pub evidence: Buffer,
}

fn vote_ids(map: &DeviceGaussians) -> &Buffer {
    map.remembered(0)
}

fn votes(map: &DeviceGaussians) -> &Buffer {
    map.remembered(1)
}

fn vote_columns(map: &DeviceGaussians) -> VoteColumnsLaunch {
    VoteColumnsLaunch::new(vote_ids(map).arg(), votes(map).arg())
}

impl Evidence {
    /// Votes as columns.
    pub fn columns(votes: &[Votes]) -> Vec<Column> {
        let ids = votes.iter().flat_map(|votes| votes.slots().map(|(id, _)| id));
        let counts = votes.iter().flat_map(|votes| votes.slots().map(|(_, count)| count.to_bits()));
        vec![Column { values: ids.collect(), width: 4 }, Column { values: counts.collect(), width: 4 }]
    }
}

impl DeviceStore for Evidence {
    type Read = EvidenceTables;
    type Copy = Vec<Votes>;

    const LEARNS_BY_COUNT: bool = false;

    fn expect(&self, device: &GpuDevice, map: &DeviceGaussians, view: &GpuView) -> Result<EvidenceTables, GpuError> {
        let settings = &self.settings;
        let numbers = SLOTS * view.pixels();
        let tables =
            EvidenceTables { ids: device.empty(numbers, "evidence")?, evidence: device.empty(numbers, "evidence")? };
        expect::launch(
            &device.client,
            cubes(tile_count(&view.camera)),
            cube_dim(),
            view.tiles.pairs(),
            vote_columns(map),
            view.depth.arg(),
            view.images.arg(),
            view.surfaces.arg(),
            tables.ids.arg(),
            tables.evidence.arg(),
            view.args(),
            EvidenceRuleLaunch::new(
                settings.depth_disparity,
                settings.depth_tolerance,
                settings.min_weight,
                settings.min_evidence,
            ),
        );
        Ok(tables)
    }

    fn fuse(
        &self,
        device: &GpuDevice,
        rendered: &Rendered<EvidenceTables>,
        _: &Recall<'_>,
        seen: &SegmentMap,
    ) -> Result<SegmentMap, GpuError> {
        let Rendered { view, read } = rendered;
        let sent = view.send_seen(device, seen)?;
        let pixels = seen.pixels().len();
        let fused = device.empty(pixels, "fused segments")?;
        let observed = self.settings.observation_weight;
        let (cubes, cube) = threads(pixels);
        fuse::launch(
            &device.client,
            cubes,
            cube,
            view.surfaces.arg(),
            read.ids.arg(),
            read.evidence.arg(),
            sent.arg(),
            fused.arg(),
            observed,
            observed * self.settings.no_segment_weight,
            pixels as u32,
        );
        let [found] = device.download([&fused])?;
        let (width, height) = seen.size();
        let failed = |_| GpuError::Failed { reason: "the fused segments have another size".to_owned() };
        SegmentMap::from_pixels(width, height, found).map_err(failed)
    }

    fn target(
        &self,
        device: &GpuDevice,
        view: &GpuView,
        _: &Recall<'_>,
        seen: &SegmentMap,
    ) -> Result<Buffer, GpuError> {
        view.send_seen(device, seen)
    }

    fn grow(&self, lesson: &Lesson<'_>, pixels: &Buffer) {
        let (cubes, cube) = threads(pixels.len());
        first_votes::launch(
            &lesson.device.client,
            cubes,
            cube,
            pixels.arg(),
            lesson.target.arg(),
            vote_columns(lesson.gaussians),
            lesson.report.arg(),
            self.settings.no_segment_weight,
            lesson.gaussians.len() as u32,
        );
    }

    /// Gives the votes of a frame.
    fn learn(&self, lesson: &Lesson<'_>, rendered: &Rendered<EvidenceTables>) -> Result<usize, GpuError> {
        let (device, view, tiles) = (lesson.device, &rendered.view, &rendered.view.tiles);
        let pairs = tiles.pair_count;
        let totals = device.zeros(pairs, "votes of pairs")?;
        let labels = device.empty(pairs * LABELS, "votes of pairs")?;
        let weights = device.empty(pairs * LABELS, "votes of pairs")?;
        let found = || PairVotesLaunch::new(totals.arg(), labels.arg(), weights.arg());
        count_votes::launch(
            &device.client,
            cubes(tile_count(&view.camera)),
            cube_dim(),
            tiles.pairs(),
            lesson.target.arg(),
            view.depth.arg(),
            found(),
            view.args(),
            self.settings.depth_tolerance,
        );
        let (cubes, cube) = threads(tiles.visible_count);
        give_votes::launch(
            &device.client,
            cubes,
            cube,
            tiles.visible(),
            found(),
            vote_columns(lesson.gaussians),
            lesson.report.arg(),
            VoteRuleLaunch::new(self.settings.no_segment_weight, self.settings.max_votes),
            tiles.visible_count as u32,
        );
        Ok(view.pixels())
    }

    fn favour(&self, device: &GpuDevice, map: &DeviceGaussians, chosen: &[u32], id: SegmentId) -> Result<(), GpuError> {
        let sent = device.upload(chosen, "Gaussians of a prediction")?;
        let (cubes, cube) = threads(chosen.len());
        let (votes, count) = (vote_columns(map), chosen.len() as u32);
        favour::launch(&device.client, cubes, cube, sent.arg(), votes, id, self.settings.max_votes, count);
        Ok(())
    }

    fn mark_holds(
        &self,
        device: &GpuDevice,
        map: &DeviceGaussians,
        keep: &Buffer,
        ids: &[SegmentId],
        report: &Buffer,
    ) -> Result<bool, GpuError> {
        if ids.is_empty() {
            return Ok(true);
        }
        let sent = device.upload(ids, "ids of a memory")?;
        let (cubes, cube) = threads(keep.len());
        mark_holds::launch(
            &device.client,
            cubes,
            cube,
            vote_columns(map),
            keep.arg(),
            sent.arg(),
            report.arg(),
            self.settings.min_evidence,
            map.len() as u32,
            ids.len() as u32,
        );
        Ok(true)
    }

    fn new_segment(&mut self, _: &GpuDevice, _: SegmentId) -> Result<(), MemoryError> {
        Ok(())
    }

    fn numbers_per_gaussian(&self) -> usize {
        2 * Votes::SLOTS
    }

    fn read(&self, device: &GpuDevice, map: &DeviceGaussians) -> Result<Vec<Votes>, GpuError> {
        let [ids, votes] = device.download([vote_ids(map), votes(map)])?;
        let of_gaussian = |(ids, votes): (&[u32], &[u32])| {
            Votes::from_slots(std::array::from_fn(|slot| (ids[slot], f32::from_bits(votes[slot]))))
        };
        Ok(ids.chunks_exact(4).zip(votes.chunks_exact(4)).take(map.len()).map(of_gaussian).collect())
    }

    fn segment_ids(&self, device: &GpuDevice, map: &DeviceGaussians) -> Result<Vec<SegmentId>, GpuError> {
        let votes = self.read(device, map)?;
        Ok(votes.iter().map(|votes| votes.winner(self.settings.min_evidence)).collect())
    }

    fn segment_shares(&self, copy: &Vec<Votes>) -> Option<Vec<f32>> {
        let share = |votes: &Votes| votes.share(votes.winner(self.settings.min_evidence));
        Some(copy.iter().map(share).collect())
    }

    fn content<'a>(&'a self, copy: &'a Vec<Votes>) -> SplatContentView<'a> {
        SplatContentView::Evidence { votes: copy }
    }
}
