//! Boundary jitter and false positives.

use crate::normal;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use splatseg_geometry::Mask;

/// Random displacement of an outline.
#[derive(Clone, Copy, Debug)]
pub(super) struct BoundaryJitter {
    /// Standard deviation along each axis, pixels.
    pub(super) sigma: f32,
    /// Distance between independent displacements, pixels.
    pub(super) wavelength: f32,
}

impl BoundaryJitter {
    /// Displaces the outline of a mask. Pixels outside the image are treated like the nearest pixel inside, so that a
    /// mask cut off by the image border remains cut off.
    pub(super) fn apply(self, mask: Mask, random: &mut ChaCha8Rng) -> Mask {
        if self.sigma == 0.0 {
            return mask;
        }
        let (width, height) = (mask.width(), mask.height());
        let Some(bounds) = Bounds::of(&mask) else { return mask };
        // A displacement exceeds 4 σ only once in 16,000 times.
        let bounds = bounds.grown((4.0 * self.sigma).ceil() as usize + 1, width, height);
        let field = Displacement::random(self, (width, height), random);
        let mut displaced = Mask::empty(width, height);
        let clamp = |place: f32, length: usize| (place.round().max(0.0) as usize).min(length - 1);
        for row in bounds.rows.0..=bounds.rows.1 {
            for column in bounds.columns.0..=bounds.columns.1 {
                let (x, y) = field.at(column, row);
                let inside = mask.contains(clamp(column as f32 + x, width), clamp(row as f32 + y, height));
                if inside {
                    displaced.set(column, row, true);
                }
            }
        }
        displaced
    }
}

/// Draws a blob at a random position in an image of `size` = (width, height). Radii have the given median, in pixels.
pub(super) fn blob(size: (usize, usize), median_radius: f32, random: &mut ChaCha8Rng) -> Mask {
    let radius = median_radius * (0.4 * normal(random)).exp();
    let stretch = (0.3 * normal(random)).exp();
    let angle = random.random_range(0.0..std::f32::consts::PI);
    let center = (random.random_range(0.0..size.0 as f32), random.random_range(0.0..size.1 as f32));
    let (cos, sin) = (angle.cos(), angle.sin());
    let mask = Mask::from_fn(size.0, size.1, |column, row| {
        let (x, y) = (column as f32 - center.0, row as f32 - center.1);
        let (along, across) = ((cos * x + sin * y) / stretch, (cos * y - sin * x) * stretch);
        along * along + across * across <= radius * radius
    });
    BoundaryJitter { sigma: 0.2 * radius, wavelength: radius.max(1.0) }.apply(mask, random)
}

/// First and last columns and rows of a mask.
struct Bounds {
    columns: (usize, usize),
    rows: (usize, usize),
}

impl Bounds {
    fn of(mask: &Mask) -> Option<Self> {
        let width = mask.width();
        let mut bounds: Option<Self> = None;
        for index in mask.pixel_indices() {
            let (column, row) = (index % width, index / width);
            let so_far = bounds.get_or_insert(Self { columns: (column, column), rows: (row, row) });
            so_far.columns = (so_far.columns.0.min(column), so_far.columns.1.max(column));
            so_far.rows.1 = row;
        }
        bounds
    }

    fn grown(self, margin: usize, width: usize, height: usize) -> Self {
        let grow = |(first, last): (usize, usize), length: usize| {
            (first.saturating_sub(margin), (last + margin).min(length - 1))
        };
        Self { columns: grow(self.columns, width), rows: grow(self.rows, height) }
    }
}

/// A smooth random vector field: normally distributed vectors at the nodes of a grid, interpolated so that the standard
/// deviation is the same everywhere.
struct Displacement {
    spacing: f32,
    nodes_per_row: usize,
    nodes: Vec<(f32, f32)>,
}

impl Displacement {
    fn random(jitter: BoundaryJitter, size: (usize, usize), random: &mut ChaCha8Rng) -> Self {
        let spacing = jitter.wavelength;
        let count = |length: usize| (length as f32 / spacing) as usize + 2;
        let nodes_per_row = count(size.0);
        let mut node = || (jitter.sigma * normal(random), jitter.sigma * normal(random));
        let nodes = (0..nodes_per_row * count(size.1)).map(|_| node()).collect();
        Self { spacing, nodes_per_row, nodes }
    }

    fn at(&self, column: usize, row: usize) -> (f32, f32) {
        let (x, y) = (column as f32 / self.spacing, row as f32 / self.spacing);
        let (left, top) = (x as usize, y as usize);
        // Smoothstep has no kinks at the nodes.
        let smooth = |t: f32| t * t * (3.0 - 2.0 * t);
        let (right_weight, bottom_weight) = (smooth(x - left as f32), smooth(y - top as f32));
        let corner = |across: usize, down: usize| {
            let weight = (if across == 1 { right_weight } else { 1.0 - right_weight })
                * (if down == 1 { bottom_weight } else { 1.0 - bottom_weight });
            (weight, self.nodes[(top + down) * self.nodes_per_row + left + across])
        };
        let (mut sum, mut squares) = ((0.0, 0.0), 0.0);
        for (weight, vector) in [corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)] {
            sum = (sum.0 + weight * vector.0, sum.1 + weight * vector.1);
            squares += weight * weight;
        }
        (sum.0 / squares.sqrt(), sum.1 / squares.sqrt())
    }
}
