//! How far cells are from the nearest obstacle, and where a robot of a radius has space.

use crate::grid::GridShape;

/// The Euclidean distance, in cells, from each cell's centre to that of the nearest cell with `is_target`; infinite if
/// there is none. By the lower envelope of parabolas (Felzenszwalb and Huttenlocher, "Distance transforms of sampled
/// functions", 2012), first along columns, then along rows.
pub(crate) fn distances(shape: &GridShape, is_target: impl Fn(usize) -> bool) -> Vec<f64> {
    let (width, height) = (shape.width, shape.height);
    let mut squared: Vec<f64> =
        (0..shape.len()).map(|cell| if is_target(cell) { 0.0 } else { f64::INFINITY }).collect();
    let mut envelope = Envelope::default();
    let mut line = vec![0.0; height];
    for column in 0..width {
        line.iter_mut().enumerate().for_each(|(row, value)| *value = squared[row * width + column]);
        envelope.transform(&mut line);
        line.iter().enumerate().for_each(|(row, value)| squared[row * width + column] = *value);
    }
    squared.chunks_mut(width.max(1)).for_each(|row| envelope.transform(row));
    squared.into_iter().map(f64::sqrt).collect()
}

/// The parabolas that are lowest somewhere.
#[derive(Default)]
struct Envelope {
    /// Where the parabolas have their lowest point.
    places: Vec<usize>,
    /// From where on each of them is the lowest.
    starts: Vec<f64>,
    values: Vec<f64>,
}

impl Envelope {
    /// Replaces each value by the least of all values plus the squared distance from their places.
    fn transform(&mut self, line: &mut [f64]) {
        self.places.clear();
        self.starts.clear();
        self.values.clear();
        self.values.extend_from_slice(line);
        for (place, value) in self.values.iter().enumerate().filter(|(_, value)| value.is_finite()) {
            let mut start = f64::NEG_INFINITY;
            while let Some(last) = self.places.last() {
                let (here, there) = (place as f64, *last as f64);
                start = (value + here * here - self.values[*last] - there * there) / (2.0 * (here - there));
                if start > self.starts[self.places.len() - 1] {
                    break;
                }
                self.places.pop();
                self.starts.pop();
                start = f64::NEG_INFINITY;
            }
            self.places.push(place);
            self.starts.push(start);
        }
        if self.places.is_empty() {
            return;
        }
        let mut lowest = 0;
        for (place, value) in line.iter_mut().enumerate() {
            while self.starts.get(lowest + 1).is_some_and(|start| *start <= place as f64) {
                lowest += 1;
            }
            let apart = place as f64 - self.places[lowest] as f64;
            *value = self.values[self.places[lowest]] + apart * apart;
        }
    }
}

/// The free distance around the centre of each cell, metres: to the nearest point of a cell with `is_blocked`, at least.
/// 0 in such cells. The border of the grid counts as blocked.
pub(crate) fn clearances(shape: &GridShape, is_blocked: impl Fn(usize) -> bool) -> Vec<f64> {
    let corner = std::f64::consts::FRAC_1_SQRT_2;
    let found = distances(shape, &is_blocked);
    let clearance = |(cell, distance): (usize, f64)| {
        let (column, row) = shape.column_row(cell);
        let to_border = (column + 1).min(shape.width - column).min(row + 1).min(shape.height - row) as f64;
        (distance.min(to_border) - corner).max(0.0) * shape.resolution
    };
    found.into_iter().enumerate().map(clearance).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn distances_are_to_the_nearest_target(targets in prop::collection::vec(prop::bool::weighted(0.08), 77..=77)) {
            let shape = GridShape { resolution: 0.1, origin: DVec2::ZERO, width: 11, height: 7 };
            let found = distances(&shape, |cell| targets[cell]);
            for (cell, found) in found.into_iter().enumerate() {
                let apart = |other: usize| shape.center(cell).distance(shape.center(other)) / 0.1;
                let nearest = (0..77).filter(|other| targets[*other]).map(apart).fold(f64::INFINITY, f64::min);
                prop_assert!(found == nearest || (found - nearest).abs() < 1e-9, "{found} {nearest}");
            }
        }
    }
}
