//! The Gaussians of a map on a device, with what they remember: they stay there.

use crate::GpuError;
use crate::device::{Buffer, GpuDevice, threads};
use crate::kernels::forget::{compact, copy};
use crate::sorting::prefix_sums;
use glam::Vec3;
use splatseg_geometry::LocalPose;
use splatseg_memory::SplatMap;

/// Gaussians that a map has room for at first.
const FIRST_CAPACITY: usize = 1 << 14;

/// Values per Gaussian in each of the arrays of the map itself: balls, last seen, seen through, colours.
const MAP_WIDTHS: [usize; 4] = [4, 1, 1, 1];

/// Numbers of all Gaussians, of one kind.
#[derive(Clone, Debug)]
pub(crate) struct Column {
    /// `[gaussians, width]`.
    pub values: Vec<u32>,
    /// Numbers per Gaussian.
    pub width: usize,
}

/// All Gaussians of a map.
#[derive(Debug)]
pub(crate) struct DeviceGaussians {
    device: GpuDevice,
    /// Those of [`MAP_WIDTHS`], then what is remembered; each has room for `capacity` Gaussians.
    arrays: Vec<Buffer>,
    widths: Vec<usize>,
    capacity: usize,
    count: usize,
}

/// sRGB, red in the lowest byte.
pub(crate) fn packed_color([red, green, blue]: [u8; 3]) -> u32 {
    u32::from_le_bytes([red, green, blue, 0])
}

/// The map as columns of [`MAP_WIDTHS`].
fn columns_of(map: &SplatMap) -> [Vec<u32>; 4] {
    let balls = map.balls.means.iter().zip(&map.balls.radii);
    [
        balls.flat_map(|(mean, radius)| [mean.x, mean.y, mean.z, *radius].map(f32::to_bits)).collect(),
        map.last_seen.clone(),
        map.seen_through.iter().map(|frames| u32::from(*frames)).collect(),
        map.colors.iter().map(|color| packed_color(*color)).collect(),
    ]
}

fn empty_arrays(device: &GpuDevice, capacity: usize, widths: &[usize]) -> Result<Vec<Buffer>, GpuError> {
    widths.iter().map(|width| device.empty(capacity * width, "the map")).collect()
}

impl DeviceGaussians {
    /// Those of a map, with what each of them remembers.
    pub fn new(device: &GpuDevice, map: &SplatMap, remembered: Vec<Column>) -> Result<Self, GpuError> {
        let count = map.balls.len();
        let capacity = count.next_power_of_two().max(FIRST_CAPACITY);
        let widths: Vec<usize> = MAP_WIDTHS.into_iter().chain(remembered.iter().map(|column| column.width)).collect();
        let arrays = empty_arrays(device, capacity, &widths)?;
        let columns = columns_of(map).into_iter().chain(remembered.into_iter().map(|column| column.values));
        for ((values, array), width) in columns.zip(&arrays).zip(&widths) {
            let sent = device.upload(&values, "the Gaussians of a map")?;
            copy_values(device, &sent, array, count * width);
        }
        Ok(Self { device: device.clone(), arrays, widths, capacity, count })
    }

    /// Number of Gaussians.
    pub fn len(&self) -> usize {
        self.count
    }

    /// `[capacity, 4]`: centre (world, metres) and radius (metres).
    pub fn balls(&self) -> &Buffer {
        &self.arrays[0]
    }

    /// The last frame that saw each Gaussian.
    pub fn last_seen(&self) -> &Buffer {
        &self.arrays[1]
    }

    /// Frames that have seen through each Gaussian since one last saw it.
    pub fn seen_through(&self) -> &Buffer {
        &self.arrays[2]
    }

    /// sRGB, red in the lowest byte.
    pub fn colors(&self) -> &Buffer {
        &self.arrays[3]
    }

    /// What is remembered: the column that was given at this place.
    pub fn remembered(&self, place: usize) -> &Buffer {
        &self.arrays[MAP_WIDTHS.len() + place]
    }

    /// Counts Gaussians that were written behind the others.
    pub fn note_grown(&mut self, grown: usize) {
        self.count += grown;
    }

    /// Makes room behind the Gaussians.
    pub fn reserve(&mut self, added: usize) -> Result<(), GpuError> {
        let needed = self.count + added;
        if needed <= self.capacity {
            return Ok(());
        }
        let capacity = needed.next_power_of_two();
        let arrays = empty_arrays(&self.device, capacity, &self.widths)?;
        for ((from, to), width) in self.arrays.iter().zip(&arrays).zip(&self.widths) {
            copy_values(&self.device, from, to, self.count * width);
        }
        (self.arrays, self.capacity) = (arrays, capacity);
        Ok(())
    }

    /// Keeps the `kept` Gaussians whose entry in `keep` is 1, in their order.
    pub fn retain(&mut self, keep: &Buffer, kept: usize) -> Result<(), GpuError> {
        let places = prefix_sums(&self.device, keep, self.count)?;
        let arrays = empty_arrays(&self.device, self.capacity, &self.widths)?;
        for ((from, to), width) in self.arrays.iter().zip(&arrays).zip(&self.widths) {
            let values = self.count * width;
            let (cubes, cube) = threads(values);
            compact::launch(
                &self.device.client,
                cubes,
                cube,
                keep.arg(),
                places.arg(),
                from.arg(),
                to.arg(),
                *width as u32,
                values as u32,
            );
        }
        (self.arrays, self.count) = (arrays, kept);
        Ok(())
    }

    /// Moves all of them to other coordinates.
    pub fn transform(&mut self, new_from_old: &LocalPose) -> Result<(), GpuError> {
        let [mut balls] = self.device.download([self.balls()])?;
        for ball in balls.chunks_exact_mut(4).take(self.count) {
            let mean = Vec3::new(f32::from_bits(ball[0]), f32::from_bits(ball[1]), f32::from_bits(ball[2]));
            ball[..3].copy_from_slice(&new_from_old.to_world(mean).to_array().map(f32::to_bits));
        }
        let sent = self.device.upload(&balls, "the Gaussians of a map")?;
        copy_values(&self.device, &sent, self.balls(), balls.len());
        Ok(())
    }

    /// Reads all of them, without what they remember.
    pub fn read(&self) -> Result<SplatMap, GpuError> {
        let count = self.count;
        let arrays = [self.balls(), self.last_seen(), self.seen_through(), self.colors()];
        let [balls, mut last_seen, seen_through, colors] = self.device.download(arrays)?;
        let mut map = SplatMap::default();
        for ball in balls.chunks_exact(4).take(count) {
            let [x, y, z, radius] = [0, 1, 2, 3].map(|number: usize| f32::from_bits(ball[number]));
            map.balls.push(Vec3::new(x, y, z), radius);
        }
        last_seen.truncate(count);
        map.last_seen = last_seen;
        map.seen_through = seen_through.iter().take(count).map(|frames| *frames as u8).collect();
        let color = |bytes: &u32| {
            let [red, green, blue, _] = bytes.to_le_bytes();
            [red, green, blue]
        };
        map.colors = colors.iter().take(count).map(color).collect();
        Ok(map)
    }
}

fn copy_values(device: &GpuDevice, from: &Buffer, to: &Buffer, count: usize) {
    let (cubes, cube) = threads(count);
    copy::launch(&device.client, cubes, cube, from.arg(), to.arg(), count as u32);
}
