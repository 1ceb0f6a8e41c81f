//! A smooth function over the image: a coarse grid of values, interpolated.
//!
//! It takes what scale and shift of a prediction leave: a room that is predicted too deep on one side, a wall that bends.
//! Values without measurements nearby follow their neighbours, and fall off to zero far from all.

/// Columns and rows of the grid.
const COLUMNS: usize = 9;
const ROWS: usize = 7;
const SIZE: usize = COLUMNS * ROWS;

/// Weight of a measurement that says that neighbours of the grid are equal, in measurements of the image.
const SMOOTHNESS: f32 = 6.0;
/// The same for a value that is zero.
const TOWARDS_ZERO: f32 = 0.3;

/// Passes of the solver.
const SWEEPS: usize = 40;

/// A smooth function over the image.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Residual([f32; SIZE]);

/// Weighted measurements of the function.
pub(crate) struct Measurements {
    /// Upper half of the normal equations: of each value with itself, and with the neighbours of [`OFFSETS`].
    diagonal: [f32; SIZE],
    beside: [[f32; 4]; SIZE],
    sums: [f32; SIZE],
}

/// The neighbours of a value that come after it: to the right, below to the left, below, below to the right.
const OFFSETS: [usize; 4] = [1, COLUMNS - 1, COLUMNS, COLUMNS + 1];

impl Default for Residual {
    fn default() -> Self {
        Self([0.0; SIZE])
    }
}

impl Default for Measurements {
    fn default() -> Self {
        Self { diagonal: [0.0; SIZE], beside: [[0.0; 4]; SIZE], sums: [0.0; SIZE] }
    }
}

/// The four values around a place, with their weights. Places are shares of the width and the height, 0 to 1.
fn corners((across, down): (f32, f32)) -> [(usize, f32); 4] {
    let along = |share: f32, count: usize| {
        let place = share.clamp(0.0, 1.0) * (count - 1) as f32;
        let index = (place as usize).min(count - 2);
        (index, place - index as f32)
    };
    let ((column, x), (row, y)) = (along(across, COLUMNS), along(down, ROWS));
    let first = row * COLUMNS + column;
    [
        (first, (1.0 - x) * (1.0 - y)),
        (first + 1, x * (1.0 - y)),
        (first + COLUMNS, (1.0 - x) * y),
        (first + COLUMNS + 1, x * y),
    ]
}

impl Measurements {
    /// Adds the function's value at a place.
    pub(crate) fn add(&mut self, place: (f32, f32), value: f32, weight: f32) {
        let corners = corners(place);
        for (number, (index, share)) in corners.into_iter().enumerate() {
            self.diagonal[index] += weight * share * share;
            self.sums[index] += weight * share * value;
            for (other, more) in corners.into_iter().skip(number + 1) {
                self.add_pair(index, other, weight * share * more);
            }
        }
    }

    fn add_pair(&mut self, one: usize, other: usize, product: f32) {
        if let Some(kind) = OFFSETS.iter().position(|offset| one + offset == other) {
            self.beside[one][kind] += product;
        }
    }

    /// The smooth function that fits the measurements best.
    pub(crate) fn solved(mut self) -> Residual {
        for index in 0..SIZE {
            self.diagonal[index] += TOWARDS_ZERO;
            let right = (index % COLUMNS + 1 < COLUMNS).then_some(index + 1);
            let below = Some(index + COLUMNS).filter(|below| *below < SIZE);
            for other in [right, below].into_iter().flatten() {
                self.diagonal[index] += SMOOTHNESS;
                self.diagonal[other] += SMOOTHNESS;
                self.add_pair(index, other, -SMOOTHNESS);
            }
        }
        let mut values = [0.0f32; SIZE];
        for _ in 0..SWEEPS {
            for index in 0..SIZE {
                let mut rest = self.sums[index];
                for (kind, offset) in OFFSETS.into_iter().enumerate() {
                    if let Some(after) = Some(index + offset).filter(|after| *after < SIZE) {
                        rest -= self.beside[index][kind] * values[after];
                    }
                    if let Some(before) = index.checked_sub(offset) {
                        rest -= self.beside[before][kind] * values[before];
                    }
                }
                values[index] = rest / self.diagonal[index];
            }
        }
        Residual(values)
    }
}

impl Residual {
    /// The value at a place.
    pub(crate) fn at(&self, place: (f32, f32)) -> f32 {
        corners(place).into_iter().map(|(index, share)| self.0[index] * share).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_smooth_function_is_found_from_its_values() {
        let function = |x: f32, y: f32| 0.05 * (2.0 * x + 1.0).sin() - 0.04 * y * y;
        let mut measurements = Measurements::default();
        for row in 0..48 {
            for column in 0..64 {
                let place = (column as f32 / 63.0, row as f32 / 47.0);
                measurements.add(place, function(place.0, place.1), 1.0);
            }
        }
        let found = measurements.solved();
        for place in [(0.1, 0.1), (0.5, 0.5), (0.9, 0.3), (0.7, 0.95)] {
            let (expected, found) = (function(place.0, place.1), found.at(place));
            assert!((expected - found).abs() < 0.004, "{place:?}: {found}, expected {expected}");
        }
    }

    #[test]
    fn without_measurements_it_is_zero() {
        assert_eq!(Measurements::default().solved(), Residual::default());
        assert_eq!(Residual::default().at((2.0, -1.0)), 0.0);
    }
}
