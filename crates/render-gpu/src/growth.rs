//! New Gaussians where a frame shows a surface that the map lacks, as a sequence of kernels.

use crate::GpuError;
use crate::device::{Buffer, GpuDevice, threads};
use crate::gaussians::{DeviceGaussians, packed_color};
use crate::kernels::borders::{distances, find_wanted, row_distances};
use crate::kernels::grow::{GrowthRuleValuesLaunch, WorldFromCameraLaunch, grow_blocks};
use crate::sorting::prefix_sums;
use crate::view::GpuView;
use glam::Vec3;
use splatseg_geometry::{LocalPose, RgbdFrame};
use splatseg_memory::{GrowthRule, MemorySettings};

/// What growth depends on.
pub(crate) struct Growth<'a> {
    pub device: &'a GpuDevice,
    pub view: &'a GpuView,
    pub frame: &'a RgbdFrame<'a>,
    /// Its pose in the coordinates of the map.
    pub map_from_camera: LocalPose,
    /// The frame's predictions, `[height, width]`.
    pub seen: &'a Buffer,
    pub settings: &'a MemorySettings,
}

/// The squares that the image is divided into, and what is known of their pixels.
struct Blocks {
    wanted: Buffer,
    distances: Buffer,
    color: Buffer,
    /// The pixel of each new Gaussian.
    pixels: Buffer,
    /// Number of squares.
    count: usize,
}

impl Growth<'_> {
    /// Writes the new Gaussians of frame number `number` behind those of the map, which has room for one per pixel, and
    /// counts them in `report`. Returns the pixel of each.
    pub fn write(&self, map: &DeviceGaussians, number: u32, report: &Buffer) -> Result<Buffer, GpuError> {
        let blocks = self.blocks()?;
        let counts = self.device.empty(blocks.count, "new Gaussians of blocks")?;
        self.grow(map, number, report, &blocks, &counts, false);
        let starts = prefix_sums(self.device, &counts, blocks.count)?;
        self.grow(map, number, report, &blocks, &starts, true);
        Ok(blocks.pixels)
    }

    /// Largest spacing of Gaussians, pixels.
    fn spacing(&self) -> usize {
        let largest = if self.is_paper() { 1 } else { self.settings.growth_spacing };
        largest.min(1 << self.frame.width().min(self.frame.height()).max(1).ilog2())
    }

    fn is_paper(&self) -> bool {
        self.settings.growth_rule() == GrowthRule::Paper
    }

    fn rule(&self) -> GrowthRuleValuesLaunch {
        let settings = self.settings;
        GrowthRuleValuesLaunch::new(
            u32::from(self.is_paper()),
            settings.growth_silhouette,
            settings.growth_coverage,
            settings.depth_disparity,
            settings.edge_disparity,
            self.spacing() as u32,
            settings.spacing_per_distance,
            if self.is_paper() { 1.0 } else { settings.radius_per_spacing },
        )
    }

    fn pose(&self) -> WorldFromCameraLaunch {
        let (rotation, by) = (self.map_from_camera.rotation(), self.map_from_camera.translation());
        let [x, y, z]: [Vec3; 3] = [rotation.row(0), rotation.row(1), rotation.row(2)];
        WorldFromCameraLaunch::new(x.x, x.y, x.z, y.x, y.y, y.z, z.x, z.y, z.z, by.x, by.y, by.z)
    }

    /// Finds what pixels ask for and how far the next border is.
    fn blocks(&self) -> Result<Blocks, GpuError> {
        let (device, client) = (self.device, &self.device.client);
        let (width, height) = (self.frame.width(), self.frame.height());
        let pixels = width * height;
        let colors: Vec<u32> = self.frame.color().pixels().iter().map(|color| packed_color(*color)).collect();
        let color = device.upload(&colors, "colour")?;
        let wanted = device.empty(pixels, "borders")?;
        let (cubes, cube) = threads(pixels);
        find_wanted::launch(
            client,
            cubes.clone(),
            cube,
            self.view.depth.arg(),
            self.seen.arg(),
            self.view.images.arg(),
            self.view.surfaces.arg(),
            wanted.arg(),
            self.view.args(),
            self.rule(),
        );
        let (in_row, to_border) = (device.empty(pixels, "borders")?, device.empty(pixels, "borders")?);
        let (columns, all) = (width as u32, pixels as u32);
        row_distances::launch(client, cubes.clone(), cube, wanted.arg(), in_row.arg(), columns, all);
        distances::launch(client, cubes, cube, in_row.arg(), to_border.arg(), columns, all);
        let count = width.div_ceil(self.spacing()) * height.div_ceil(self.spacing());
        let pixels = device.empty(pixels, "pixels of new Gaussians")?;
        Ok(Blocks { wanted, distances: to_border, color, pixels, count })
    }

    /// Counts the new Gaussians of each square, or writes them.
    fn grow(
        &self,
        map: &DeviceGaussians,
        number: u32,
        report: &Buffer,
        blocks: &Blocks,
        counts: &Buffer,
        writes: bool,
    ) {
        let (cubes, cube) = threads(blocks.count);
        grow_blocks::launch(
            &self.device.client,
            cubes,
            cube,
            blocks.wanted.arg(),
            blocks.distances.arg(),
            self.view.depth.arg(),
            blocks.color.arg(),
            counts.arg(),
            blocks.pixels.arg(),
            map.balls().arg(),
            map.last_seen().arg(),
            map.seen_through().arg(),
            map.colors().arg(),
            report.arg(),
            self.view.args(),
            self.pose(),
            self.rule(),
            number,
            map.len() as u32,
            writes,
        );
    }
}
