//! Features of Gaussians on a device.

use crate::GpuError;
use crate::descent::Descent;
use crate::device::{Buffer, GpuDevice, cube_dim, cubes, threads};
use crate::gaussians::{Column, DeviceGaussians};
use crate::kernels::decode::{
    DecodeRuleLaunch, FeatureColumnLaunch, decode_gaussians, expect_features, first_features,
};
use crate::store::{DeviceStore, Lesson, Rendered};
use crate::view::{GpuView, tile_count};
use splatseg_geometry::{SegmentId, SegmentMap};
use splatseg_memory::{MemoryError, MemorySettings, Recall, SegmentCodes, SplatContentView, feature_target};

/// The store of a memory of features: one column, `[gaussians, D]`.
#[derive(Debug)]
pub(crate) struct Features {
    settings: MemorySettings,
    codes: SegmentCodes,
    /// The codebook on the device, `[N, D]`.
    sent: Buffer,
}

impl Features {
    /// The store with these codes.
    pub fn new(device: &GpuDevice, settings: &MemorySettings, codes: SegmentCodes) -> Result<Self, GpuError> {
        let sent = device.upload(codes.codebook().vectors(), "the codebook")?;
        Ok(Self { settings: settings.clone(), codes, sent })
    }

    /// Features as a column.
    pub fn columns(features: &[f32], dim: usize) -> Vec<Column> {
        vec![Column { values: features.iter().map(|value| value.to_bits()).collect(), width: dim }]
    }

    fn dim(&self) -> usize {
        self.codes.codebook().feature_dim()
    }

    fn rule(&self) -> DecodeRuleLaunch {
        let threshold = self.settings.decode_threshold;
        // Lengths of codes and sums over their channels are off by a few roundings for each channel.
        let margin = 16.0 * (self.dim() + 8) as f32 * f32::EPSILON;
        let least_square = (1.0 - margin) * threshold * threshold;
        DecodeRuleLaunch::new(self.settings.depth_disparity, threshold, least_square, self.codes.used() as u32)
    }
}

impl DeviceStore for Features {
    /// Rendered features, `[height, width, D]`.
    type Read = Buffer;
    type Copy = Vec<f32>;

    const LEARNS_BY_COUNT: bool = true;

    fn expect(&self, device: &GpuDevice, map: &DeviceGaussians, view: &GpuView) -> Result<Buffer, GpuError> {
        let rendered = device.empty(view.pixels() * self.dim(), "rendered features")?;
        expect_features::launch(
            &device.client,
            cubes(tile_count(&view.camera)),
            cube_dim(),
            view.tiles.pairs(),
            FeatureColumnLaunch::new(map.remembered(0).arg()),
            self.sent.arg(),
            view.depth.arg(),
            view.images.arg(),
            view.surfaces.arg(),
            rendered.arg(),
            view.args(),
            self.rule(),
            self.dim(),
        );
        Ok(rendered)
    }

    /// On the host, which has all that it takes.
    fn fuse(
        &self,
        _: &GpuDevice,
        _: &Rendered<Buffer>,
        recall: &Recall<'_>,
        seen: &SegmentMap,
    ) -> Result<SegmentMap, GpuError> {
        Ok(feature_target(recall.expected(), seen, &self.settings).decoded(self.settings.decode_threshold))
    }

    /// `[2, height, width]`: the segment that each pixel should show, and its confidence.
    fn target(
        &self,
        device: &GpuDevice,
        _: &GpuView,
        recall: &Recall<'_>,
        seen: &SegmentMap,
    ) -> Result<Buffer, GpuError> {
        let target = feature_target(recall.expected(), seen, &self.settings);
        let confidence = target.confidence.pixels().iter().map(|value| value.to_bits());
        let values: Vec<u32> = target.segments.pixels().iter().copied().chain(confidence).collect();
        device.upload(&values, "the target of a frame")
    }

    fn grow(&self, lesson: &Lesson<'_>, pixels: &Buffer) {
        let (cubes, cube) = threads(pixels.len());
        first_features::launch(
            &lesson.device.client,
            cubes,
            cube,
            pixels.arg(),
            lesson.target.arg(),
            self.sent.arg(),
            lesson.gaussians.remembered(0).arg(),
            lesson.report.arg(),
            pixels.len() as u32,
            lesson.gaussians.len() as u32,
            self.dim(),
        );
    }

    fn learn(&self, lesson: &Lesson<'_>, rendered: &Rendered<Buffer>) -> Result<usize, GpuError> {
        let (settings, codes, dim) = (&self.settings, &self.sent, self.dim());
        Descent { lesson, view: &rendered.view, rendered: &rendered.read, settings, codes, dim }.run()
    }

    fn new_segment(&mut self, device: &GpuDevice, id: SegmentId) -> Result<(), MemoryError> {
        let known = self.codes.codebook().len();
        self.codes.new_segment(id)?;
        if self.codes.codebook().len() != known {
            self.sent = device.upload(self.codes.codebook().vectors(), "the codebook")?;
        }
        Ok(())
    }

    fn numbers_per_gaussian(&self) -> usize {
        self.dim()
    }

    fn read(&self, device: &GpuDevice, map: &DeviceGaussians) -> Result<Vec<f32>, GpuError> {
        let [found] = device.download([map.remembered(0)])?;
        Ok(found.into_iter().take(map.len() * self.dim()).map(f32::from_bits).collect())
    }

    fn segment_ids(&self, device: &GpuDevice, map: &DeviceGaussians) -> Result<Vec<SegmentId>, GpuError> {
        let segments = device.empty(map.len(), "segments of Gaussians")?;
        let (cubes, cube) = threads(map.len());
        decode_gaussians::launch(
            &device.client,
            cubes,
            cube,
            map.remembered(0).arg(),
            self.sent.arg(),
            segments.arg(),
            self.rule(),
            map.len() as u32,
            self.dim(),
        );
        let [mut found] = device.download([&segments])?;
        found.truncate(map.len());
        Ok(found)
    }

    fn content<'a>(&'a self, copy: &'a Vec<f32>) -> SplatContentView<'a> {
        SplatContentView::Features { features: copy, codebook: self.codes.codebook() }
    }
}
