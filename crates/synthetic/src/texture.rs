//! Colour patterns on a surface, as functions of the point in the solid's own coordinates.

use glam::Vec3;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// Keeps pattern edges off the faces of boxes, where rounding would flicker between both sides.
const PATTERN_SHIFT: Vec3 = Vec3::new(0.137, 0.271, 0.419);

#[derive(Clone, Copy, Debug)]
enum Pattern {
    Plain,
    Checker,
    /// Stripes perpendicular to this direction.
    Stripes(Vec3),
    Noise,
    /// Noise of two length scales, with more contrast.
    Spots,
}

/// A pattern of two colours.
#[derive(Clone, Debug)]
pub(super) struct Texture {
    colors: [[u8; 3]; 2],
    pattern: Pattern,
    /// Length of one repetition, metres.
    period: f32,
}

impl Texture {
    #[cfg(test)]
    pub(super) fn plain(color: [u8; 3]) -> Self {
        Self { colors: [color; 2], pattern: Pattern::Plain, period: 1.0 }
    }

    /// Draws a random texture with a period of about `period` metres.
    pub(super) fn random(random: &mut ChaCha8Rng, period: f32) -> Self {
        let base: [u8; 3] = std::array::from_fn(|_| random.random_range(50..230));
        // A second colour that is close in one channel and clearly apart in the others.
        let second = base.map(|value| {
            if value > 140 { value - random.random_range(30..90) } else { value + random.random_range(25..80) }
        });
        let pattern = match random.random_range(0..4) {
            0 => Pattern::Plain,
            1 => Pattern::Checker,
            2 => {
                let mut direction = || random.random_range(-1.0..1.0f32);
                Pattern::Stripes(Vec3::new(direction(), direction(), direction()).normalize_or(Vec3::Z))
            }
            _ => Pattern::Noise,
        };
        Self { colors: [base, second], pattern, period: period * random.random_range(0.7..1.4) }
    }

    /// Draws a random texture whose pattern is clearly visible.
    pub(super) fn random_pattern(random: &mut ChaCha8Rng, period: f32) -> Self {
        loop {
            let texture = Self::random(random, period);
            if !matches!(texture.pattern, Pattern::Plain) {
                return texture;
            }
        }
    }

    /// Draws a texture of irregular spots, which has no direction and does not repeat within a solid.
    pub(super) fn random_spots(random: &mut ChaCha8Rng, period: f32) -> Self {
        Self { pattern: Pattern::Spots, ..Self::random(random, period) }
    }

    /// Draws a texture of tiles.
    pub(super) fn random_tiles(random: &mut ChaCha8Rng, period: f32) -> Self {
        Self { pattern: Pattern::Checker, ..Self::random(random, period) }
    }

    /// Returns the same texture with another tint: `shift` is added to both colours, which stay in 20..=235.
    pub(super) fn tinted(&self, shift: [i16; 3]) -> Self {
        let tint = |color: [u8; 3]| {
            std::array::from_fn(|channel| (i16::from(color[channel]) + shift[channel]).clamp(20, 235) as u8)
        };
        Self { colors: self.colors.map(tint), ..self.clone() }
    }

    /// Returns the mean sRGB colour.
    pub(super) fn mean_color(&self) -> [u8; 3] {
        let share = if matches!(self.pattern, Pattern::Plain) { 0.075 } else { 0.5 };
        let [first, second] = self.colors.map(|color| Vec3::from(color.map(f32::from)));
        first.lerp(second, share).to_array().map(|value| value.round() as u8)
    }

    /// Returns the sRGB colour at a point, in 0..=255.
    pub(super) fn color_at(&self, point_local: Vec3) -> Vec3 {
        let point = point_local / self.period + PATTERN_SHIFT;
        let share = match self.pattern {
            Pattern::Plain => 0.15 * smooth_noise(point * 3.0),
            Pattern::Checker => f32::from(point.floor().element_sum().rem_euclid(2.0) > 0.5),
            Pattern::Stripes(across) => f32::from(point.dot(across).rem_euclid(1.0) > 0.5),
            Pattern::Noise => smooth_noise(point * 2.0),
            Pattern::Spots => {
                let noise = 0.6 * smooth_noise(point * 2.0) + 0.4 * smooth_noise(point * 9.0);
                (0.5 + 2.5 * (noise - 0.5)).clamp(0.0, 1.0)
            }
        };
        let [first, second] = self.colors.map(|color| Vec3::from(color.map(f32::from)));
        first.lerp(second, share)
    }
}

/// Returns smooth noise in 0..=1 with a length scale of 1.
fn smooth_noise(point: Vec3) -> f32 {
    let cell = point.floor();
    let within = point - cell;
    let blend = within * within * (Vec3::splat(3.0) - 2.0 * within);
    let mut sum = 0.0;
    for corner in 0..8u32 {
        let offset = Vec3::new((corner & 1) as f32, (corner >> 1 & 1) as f32, (corner >> 2) as f32);
        let weights = offset * blend + (Vec3::ONE - offset) * (Vec3::ONE - blend);
        sum += weights.element_product() * hash((cell + offset).as_ivec3());
    }
    sum
}

/// Returns a pseudo-random number in 0..1 for each cell of a grid.
fn hash(cell: glam::IVec3) -> f32 {
    let mut bits = (cell.x as u32).wrapping_mul(0x9E37_79B1)
        ^ (cell.y as u32).wrapping_mul(0x85EB_CA77)
        ^ (cell.z as u32).wrapping_mul(0xC2B2_AE3D);
    bits = (bits ^ bits >> 15).wrapping_mul(0x2C1B_3C6D);
    bits = (bits ^ bits >> 12).wrapping_mul(0x297A_2D39);
    ((bits ^ bits >> 15) >> 8) as f32 / (1 << 24) as f32
}
