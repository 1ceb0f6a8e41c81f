//! The Gaussians of a map on a device: they stay there, and only new ones are sent.

use crate::GpuError;
use crate::device::{Buffer, GpuDevice, threads};
use crate::kernels::forget::{SENT_NUMBERS, compact, copy, unpack};
use crate::kernels::vote::favour;
use crate::sorting::prefix_sums;
use glam::Vec3;
use splatseg_memory::{SplatMap, Votes};

/// Gaussians that a map has room for at first.
const FIRST_CAPACITY: usize = 1 << 14;

/// Buffers with room for `capacity` Gaussians each.
#[derive(Clone, Debug)]
struct Arrays {
    /// `[capacity, 4]`: centre (world, metres) and radius (metres).
    balls: Buffer,
    /// `[capacity, 2]`: two ids of 16 bits each.
    vote_ids: Buffer,
    /// `[capacity, 4]`.
    votes: Buffer,
    last_seen: Buffer,
    seen_through: Buffer,
    /// sRGB, red in the lowest byte.
    colors: Buffer,
}

/// Values per Gaussian in each of the arrays, in their order.
const WIDTHS: [usize; 6] = [4, 2, 4, 1, 1, 1];

impl Arrays {
    fn with_capacity(device: &GpuDevice, capacity: usize) -> Result<Self, GpuError> {
        let empty = |width: usize| device.empty(capacity * width, "the map");
        let [balls, vote_ids, votes, last_seen, seen_through, colors] = WIDTHS;
        Ok(Self {
            balls: empty(balls)?,
            vote_ids: empty(vote_ids)?,
            votes: empty(votes)?,
            last_seen: empty(last_seen)?,
            seen_through: empty(seen_through)?,
            colors: empty(colors)?,
        })
    }

    fn all(&self) -> [&Buffer; 6] {
        [&self.balls, &self.vote_ids, &self.votes, &self.last_seen, &self.seen_through, &self.colors]
    }
}

/// All Gaussians of a map.
#[derive(Debug)]
pub(crate) struct DeviceGaussians {
    device: GpuDevice,
    arrays: Arrays,
    capacity: usize,
    count: usize,
}

/// A Gaussian as [`unpack`] takes it.
fn packed(map: &SplatMap, votes: &[Votes], index: usize) -> [u32; SENT_NUMBERS] {
    let [a, b, c, d] = votes[index].slots();
    let pair = |low: u16, high: u16| u32::from(low) | u32::from(high) << 16;
    let (mean, radius) = (map.balls.means[index], map.balls.radii[index]);
    [
        mean.x.to_bits(),
        mean.y.to_bits(),
        mean.z.to_bits(),
        radius.to_bits(),
        pair(a.0, b.0),
        pair(c.0, d.0),
        a.1.to_bits(),
        b.1.to_bits(),
        c.1.to_bits(),
        d.1.to_bits(),
        packed_color(map.colors[index]),
        map.last_seen[index],
        u32::from(map.seen_through[index]),
    ]
}

/// sRGB, red in the lowest byte.
pub(crate) fn packed_color([red, green, blue]: [u8; 3]) -> u32 {
    u32::from_le_bytes([red, green, blue, 0])
}

impl DeviceGaussians {
    /// Those of a map; there is one entry of `votes` per Gaussian.
    pub fn new(device: &GpuDevice, map: &SplatMap, votes: &[Votes]) -> Result<Self, GpuError> {
        let count = map.balls.len().min(votes.len());
        let capacity = count.next_power_of_two().max(FIRST_CAPACITY);
        let arrays = Arrays::with_capacity(device, capacity)?;
        let sent: Vec<_> = (0..count).map(|index| packed(map, votes, index)).collect();
        let sent = device.upload(sent.as_flattened(), "the Gaussians of a map")?;
        let (cubes, cube) = threads(count);
        let [balls, vote_ids, votes, last_seen, seen_through, colors] = arrays.all().map(Buffer::arg);
        unpack::launch(
            &device.client,
            cubes,
            cube,
            sent.arg(),
            balls,
            vote_ids,
            votes,
            last_seen,
            seen_through,
            colors,
            count as u32,
        );
        Ok(Self { device: device.clone(), arrays, capacity, count })
    }

    /// Number of Gaussians.
    pub fn len(&self) -> usize {
        self.count
    }

    /// `[capacity, 4]`: centre (world, metres) and radius (metres).
    pub fn balls(&self) -> &Buffer {
        &self.arrays.balls
    }

    /// `[capacity, 2]`: two ids of 16 bits each.
    pub fn vote_ids(&self) -> &Buffer {
        &self.arrays.vote_ids
    }

    /// `[capacity, 4]`.
    pub fn votes(&self) -> &Buffer {
        &self.arrays.votes
    }

    /// The last frame that saw each Gaussian.
    pub fn last_seen(&self) -> &Buffer {
        &self.arrays.last_seen
    }

    /// Frames that have seen through each Gaussian since one last saw it.
    pub fn seen_through(&self) -> &Buffer {
        &self.arrays.seen_through
    }

    /// sRGB, red in the lowest byte.
    pub fn colors(&self) -> &Buffer {
        &self.arrays.colors
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
        let arrays = Arrays::with_capacity(&self.device, capacity)?;
        for ((from, to), width) in self.arrays.all().into_iter().zip(arrays.all()).zip(WIDTHS) {
            let (cubes, cube) = threads(self.count * width);
            copy::launch(&self.device.client, cubes, cube, from.arg(), to.arg(), (self.count * width) as u32);
        }
        (self.arrays, self.capacity) = (arrays, capacity);
        Ok(())
    }

    /// Keeps the `kept` Gaussians whose entry in `keep` is 1, in their order.
    pub fn retain(&mut self, keep: &Buffer, kept: usize) -> Result<(), GpuError> {
        let places = prefix_sums(&self.device, keep, self.count)?;
        let arrays = Arrays::with_capacity(&self.device, self.capacity)?;
        let (cubes, cube) = threads(self.count);
        let [balls, vote_ids, votes, last_seen, seen_through, colors] = self.arrays.all().map(Buffer::arg);
        let [to_balls, to_vote_ids, to_votes, to_last_seen, to_seen_through, to_colors] = arrays.all().map(Buffer::arg);
        compact::launch(
            &self.device.client,
            cubes,
            cube,
            keep.arg(),
            places.arg(),
            balls,
            vote_ids,
            votes,
            last_seen,
            seen_through,
            colors,
            to_balls,
            to_vote_ids,
            to_votes,
            to_last_seen,
            to_seen_through,
            to_colors,
            self.count as u32,
        );
        (self.arrays, self.count) = (arrays, kept);
        Ok(())
    }

    /// Makes some Gaussians surer of a segment than of all others together.
    pub fn favour(&self, gaussians: &[u32], id: u32, max_votes: f32) -> Result<(), GpuError> {
        let sent = self.device.upload(gaussians, "Gaussians of a prediction")?;
        let (cubes, cube) = threads(gaussians.len());
        let (vote_ids, votes, count) = (self.vote_ids().arg(), self.votes().arg(), gaussians.len() as u32);
        favour::launch(&self.device.client, cubes, cube, sent.arg(), vote_ids, votes, id, max_votes, count);
        Ok(())
    }

    /// Reads all of them.
    pub fn read(&self) -> Result<(SplatMap, Vec<Votes>), GpuError> {
        let count = self.count;
        let [balls, ids, votes, mut last_seen, seen_through, colors] = self.device.download(self.arrays.all())?;
        let of_gaussian = |(ids, votes): (&[u32], &[u32])| {
            Votes::from_slots(std::array::from_fn(|slot| {
                ((ids[slot / 2] >> (16 * (slot % 2))) as u16, f32::from_bits(votes[slot]))
            }))
        };
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
        Ok((map, ids.chunks_exact(2).zip(votes.chunks_exact(4)).take(count).map(of_gaussian).collect()))
    }
}
