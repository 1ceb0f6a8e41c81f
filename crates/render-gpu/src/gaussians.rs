//! The Gaussians of a map on a device: they stay there, and only new ones are sent.

use crate::GpuError;
use crate::device::{Buffer, GpuDevice, threads};
use crate::kernels::forget::{NEW_NUMBERS, append, compact, copy};
use crate::kernels::vote::favour;
use crate::sorting::prefix_sums;
use splatseg_memory::Votes;

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
}

/// Values per Gaussian in each of the arrays, in their order.
const WIDTHS: [usize; 5] = [4, 2, 4, 1, 1];

impl Arrays {
    fn with_capacity(device: &GpuDevice, capacity: usize) -> Result<Self, GpuError> {
        let empty = |width: usize| device.empty(capacity * width, "the map");
        let [balls, vote_ids, votes, last_seen, seen_through] = WIDTHS;
        Ok(Self {
            balls: empty(balls)?,
            vote_ids: empty(vote_ids)?,
            votes: empty(votes)?,
            last_seen: empty(last_seen)?,
            seen_through: empty(seen_through)?,
        })
    }

    fn all(&self) -> [&Buffer; 5] {
        [&self.balls, &self.vote_ids, &self.votes, &self.last_seen, &self.seen_through]
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

/// What a Gaussian keeps besides its ball, as the host knows it.
#[derive(Clone, Debug, Default)]
pub(crate) struct GaussianStates {
    pub votes: Vec<Votes>,
    pub last_seen: Vec<u32>,
    pub seen_through: Vec<u8>,
}

/// A new Gaussian as [`append`] takes it.
pub(crate) fn packed(mean: glam::Vec3, radius: f32, votes: &Votes) -> [u32; NEW_NUMBERS] {
    let [a, b, c, d] = votes.slots();
    let pair = |low: u16, high: u16| u32::from(low) | u32::from(high) << 16;
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
    ]
}

impl DeviceGaussians {
    /// None.
    pub fn new(device: &GpuDevice) -> Result<Self, GpuError> {
        let arrays = Arrays::with_capacity(device, FIRST_CAPACITY)?;
        Ok(Self { device: device.clone(), arrays, capacity: FIRST_CAPACITY, count: 0 })
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

    /// Adds Gaussians that frame number `frame` saw first.
    pub fn add(&mut self, added: &[[u32; NEW_NUMBERS]], frame: u32) -> Result<(), GpuError> {
        if added.is_empty() {
            return Ok(());
        }
        self.reserve(added.len())?;
        let sent = self.device.upload(added.as_flattened(), "new Gaussians")?;
        let (cubes, cube) = threads(added.len());
        let [balls, vote_ids, votes, last_seen, seen_through] = self.arrays.all().map(Buffer::arg);
        append::launch(
            &self.device.client,
            cubes,
            cube,
            sent.arg(),
            balls,
            vote_ids,
            votes,
            last_seen,
            seen_through,
            frame,
            self.count as u32,
            added.len() as u32,
        );
        self.count += added.len();
        Ok(())
    }

    /// Replaces what is known of when each Gaussian was seen.
    pub fn restore_sights(&mut self, last_seen: &[u32], seen_through: &[u8]) -> Result<(), GpuError> {
        let seen_through: Vec<u32> = seen_through.iter().map(|frames| u32::from(*frames)).collect();
        let pairs = [(last_seen, &self.arrays.last_seen), (&seen_through, &self.arrays.seen_through)];
        for (values, to) in pairs {
            let from = self.device.upload(values, "when Gaussians were seen")?;
            let (cubes, cube) = threads(values.len());
            copy::launch(&self.device.client, cubes, cube, from.arg(), to.arg(), values.len() as u32);
        }
        Ok(())
    }

    fn reserve(&mut self, added: usize) -> Result<(), GpuError> {
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
        let [balls, vote_ids, votes, last_seen, seen_through] = self.arrays.all().map(Buffer::arg);
        let [to_balls, to_vote_ids, to_votes, to_last_seen, to_seen_through] = arrays.all().map(Buffer::arg);
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
            to_balls,
            to_vote_ids,
            to_votes,
            to_last_seen,
            to_seen_through,
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

    /// Reads all but the balls.
    pub fn states(&self) -> Result<GaussianStates, GpuError> {
        let Arrays { vote_ids, votes, last_seen, seen_through, .. } = &self.arrays;
        let [ids, votes, mut last_seen, seen_through] =
            self.device.download([vote_ids, votes, last_seen, seen_through])?;
        let of_gaussian = |(ids, votes): (&[u32], &[u32])| {
            Votes::from_slots(std::array::from_fn(|slot| {
                ((ids[slot / 2] >> (16 * (slot % 2))) as u16, f32::from_bits(votes[slot]))
            }))
        };
        last_seen.truncate(self.count);
        Ok(GaussianStates {
            votes: ids.chunks_exact(2).zip(votes.chunks_exact(4)).take(self.count).map(of_gaussian).collect(),
            last_seen,
            seen_through: seen_through.iter().take(self.count).map(|frames| *frames as u8).collect(),
        })
    }
}
