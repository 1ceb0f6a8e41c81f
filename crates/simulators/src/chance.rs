//! Random numbers that depend on what they decide, not on earlier draws.
//!
//! Each kind of decision has a whole number, so that changing one rate does not change the other errors.

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
    /// Random numbers for a decision about an object, the same in every frame.
    pub fn of_object(self, decision: impl Into<u64>, object: SegmentId) -> ChaCha8Rng {
        Key::new(self.seed, decision).number(u64::from(object)).generator()
    }
}

impl FrameChance<'_> {
    /// Random numbers for a decision in this frame. `number` distinguishes several decisions of a kind about one
    /// object.
    pub fn of_frame(self, decision: impl Into<u64>, object: SegmentId, number: usize) -> ChaCha8Rng {
        Key::new(self.run.seed, decision)
            .number(u64::from(object))
            .number(number as u64)
            .bytes(self.frame.as_bytes())
            .generator()
    }

    /// Random numbers for a decision about an object: the same ones in a fraction `persistence` of the frames,
    /// otherwise those of this frame. Their distribution does not depend on `persistence`.
    pub fn lasting_or_fresh(self, decision: impl Into<u64> + Copy, object: SegmentId, persistence: f64) -> ChaCha8Rng {
        let mut fresh = self.of_frame(decision, object, 0);
        if fresh.random::<f64>() < persistence { self.run.of_object(decision, object) } else { fresh }
    }
}

/// FNV-1a over everything that a random number depends on: the same on every machine and with every compiler.
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

/// A number from the standard normal distribution (Box–Muller).
pub fn normal(random: &mut ChaCha8Rng) -> f32 {
    // 1 - [0, 1) is never 0.
    let radius = (-2.0 * (1.0 - random.random::<f32>()).ln()).sqrt();
    radius * (std::f32::consts::TAU * random.random::<f32>()).cos()
}

/// A number from the Poisson distribution (Knuth's product of uniform numbers). `mean` must be so small that e^-mean is
/// not 0.
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
