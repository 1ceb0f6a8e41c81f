//! Random numbers that depend only on their purpose, not on earlier draws.
//!
//! Each kind of decision is identified by a number, so that changing one rate does not change the other errors.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use splatseg_geometry::SegmentId;

/// The source of all randomness of a run.
#[derive(Clone, Copy, Debug)]
pub struct Chance {
    /// The seed of the run.
    pub seed: u64,
}

/// The randomness of one frame.
#[derive(Clone, Copy, Debug)]
pub struct FrameChance<'a> {
    /// The randomness of the run.
    pub run: Chance,
    /// Name of the frame.
    pub frame: &'a str,
}

impl Chance {
    /// Returns random numbers for a decision about an object, the same in every frame.
    pub fn of_object(self, decision: impl Into<u64>, object: SegmentId) -> ChaCha8Rng {
        Key::new(self.seed, decision).number(u64::from(object)).generator()
    }
}

impl FrameChance<'_> {
    /// Returns random numbers for a decision in this frame. `number` distinguishes several decisions of one kind about
    /// an object.
    pub fn of_frame(self, decision: impl Into<u64>, object: SegmentId, number: usize) -> ChaCha8Rng {
        Key::new(self.run.seed, decision)
            .number(u64::from(object))
            .number(number as u64)
            .bytes(self.frame.as_bytes())
            .generator()
    }

    /// Returns random numbers for a decision about an object: the object's fixed numbers in a fraction `persistence` of
    /// the frames, otherwise fresh numbers for this frame. Their distribution does not depend on `persistence`.
    pub fn lasting_or_fresh(self, decision: impl Into<u64> + Copy, object: SegmentId, persistence: f64) -> ChaCha8Rng {
        let mut fresh = self.of_frame(decision, object, 0);
        if fresh.random::<f64>() < persistence { self.run.of_object(decision, object) } else { fresh }
    }
}

/// FNV-1a hash of everything on which a random number depends. It is the same on all machines and with all compilers.
struct Key(u64);

impl Key {
    fn new(seed: u64, decision: impl Into<u64>) -> Self {
        Self(0xcbf2_9ce4_8422_2325).number(seed).number(decision.into())
    }

    fn number(self, number: u64) -> Self {
        self.bytes(&number.to_le_bytes())
    }

    fn bytes(self, bytes: &[u8]) -> Self {
        Self(bytes.iter().fold(self.0, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3)))
    }

    fn generator(self) -> ChaCha8Rng {
        ChaCha8Rng::seed_from_u64(self.0)
    }
}

/// Draws from the standard normal distribution (Box–Muller).
pub fn normal(random: &mut ChaCha8Rng) -> f32 {
    // 1 - [0, 1) is never 0.
    let radius = (-2.0 * (1.0 - random.random::<f32>()).ln()).sqrt();
    radius * (std::f32::consts::TAU * random.random::<f32>()).cos()
}

/// Draws from the Poisson distribution (Knuth's product of uniform numbers). `mean` must be small enough for e^-mean
/// not to underflow to 0.
pub fn poisson(mean: f64, random: &mut ChaCha8Rng) -> usize {
    let threshold = (-mean).exp();
    let mut product = random.random::<f64>();
    let mut count = 0;
    while product > threshold {
        product *= random.random::<f64>();
        count += 1;
    }
    count
}
