//! One-to-one matching with the maximum total weight (the Hungarian algorithm), in integers.
//!
//! Weights are fixed-point, so that sums are exact and the result does not depend on the order of addition. A second,
//! much smaller weight breaks ties.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};

/// Fractional bits of the ratio whose sum is maximised. This leaves room for 2^64 pairs.
const PRIMARY_BITS: u32 = 62;
/// Fractional bits of the ratio that breaks ties. Its weight is 2^-40 of the first: more than the rounding error of the
/// first, which would otherwise break ties such as 1/3 + 1/3 and 2/3, and less than any difference that matters.
const SECONDARY_BITS: u32 = 22;

/// A fraction of two pixel counts, at most 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ratio {
    /// Numerator, pixels.
    pub numerator: u64,
    /// Denominator, pixels.
    pub denominator: u64,
}

impl Ratio {
    /// Intersection over union of two sets of pixels with the given areas.
    pub fn iou(intersection: u64, first_area: u64, second_area: u64) -> Self {
        Self { numerator: intersection, denominator: first_area + second_area - intersection }
    }

    /// F-score of two sets of pixels: twice the intersection over the sum of the areas.
    pub fn f_score(intersection: u64, first_area: u64, second_area: u64) -> Self {
        Self { numerator: 2 * intersection, denominator: first_area + second_area }
    }

    /// Converts to a float; NaN for 0 / 0.
    pub fn to_f64(self) -> f64 {
        self.numerator as f64 / self.denominator as f64
    }

    fn fixed(self, bits: u32) -> i128 {
        (i128::from(self.numerator) << bits) / i128::from(self.denominator.max(1))
    }
}

/// A pair that may be matched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Candidate {
    /// Key of the item on one side.
    pub row: u64,
    /// Key of the item on the other side.
    pub column: u64,
    weight: i128,
}

impl Candidate {
    /// Creates a pair. The sum of the `primary` ratios is maximised; `secondary` breaks ties.
    pub fn new(row: u64, column: u64, primary: Ratio, secondary: Option<Ratio>) -> Self {
        let secondary = secondary.map_or(0, |ratio| ratio.fixed(SECONDARY_BITS));
        Self { row, column, weight: primary.fixed(PRIMARY_BITS) + secondary }
    }
}

/// Selects candidates such that no two share a row or a column and their total weight is maximal. Returns their indices
/// in increasing order. Rows and columns without candidates stay unmatched. No pair may occur twice.
///
/// Time and memory grow with the number of candidates, not with rows × columns.
pub fn best_assignment(candidates: &[Candidate]) -> Vec<usize> {
    let [rows, columns] = [distinct(candidates, |pair| pair.row), distinct(candidates, |pair| pair.column)];
    let mut matching = Matching::new(rows.len(), columns.len());
    for (index, pair) in candidates.iter().enumerate().filter(|(_, pair)| pair.weight > 0) {
        let row = rows.partition_point(|key| *key < pair.row);
        let column = columns.partition_point(|key| *key < pair.column);
        matching.edges[row].push(Edge { column, cost: -pair.weight, candidate: index });
    }
    for edges in &mut matching.edges {
        edges.sort_unstable_by_key(|edge| edge.column);
    }
    (0..rows.len()).for_each(|row| matching.add_row(row));
    let mut matched: Vec<usize> = matching.edge_of_column.iter().flatten().map(|(_, candidate)| *candidate).collect();
    matched.sort_unstable();
    matched
}

/// Returns the distinct keys of the candidates in increasing order.
fn distinct(candidates: &[Candidate], key: impl Fn(&Candidate) -> u64) -> Vec<u64> {
    let mut keys: Vec<u64> = candidates.iter().map(key).collect();
    keys.sort_unstable();
    keys.dedup();
    keys
}

/// A candidate in the list of its row.
#[derive(Clone, Copy, Debug)]
struct Edge {
    column: usize,
    /// The negative weight.
    cost: i128,
    candidate: usize,
}

/// Minimum-cost matching of the rows added so far, by successive shortest augmenting paths (Dijkstra's algorithm with
/// potentials). Each row has an additional dummy column of cost 0, which means that it is unmatched.
struct Matching {
    /// The edges of each row, sorted by column.
    edges: Vec<Vec<Edge>>,
    /// The row and the candidate of each matched column.
    edge_of_column: Vec<Option<(usize, usize)>>,
    row_potentials: Vec<i128>,
    column_potentials: Vec<i128>,
}

/// The path to a column: its length, and its last row and candidate.
#[derive(Clone, Copy, Debug)]
struct Reached {
    distance: i128,
    row: usize,
    candidate: usize,
}

impl Matching {
    fn new(rows: usize, columns: usize) -> Self {
        Self {
            edges: vec![Vec::new(); rows],
            edge_of_column: vec![None; columns],
            row_potentials: vec![0; rows],
            column_potentials: vec![0; columns],
        }
    }

    /// Adds a row. Column `columns + row` is the row's dummy column.
    fn add_row(&mut self, added: usize) {
        let columns = self.column_potentials.len();
        let mut reached: BTreeMap<usize, Reached> = BTreeMap::new();
        let mut waiting: BinaryHeap<Reverse<(i128, usize)>> = BinaryHeap::new();
        // Columns with final distances, in the order in which they became final.
        let mut settled: Vec<usize> = Vec::new();
        let cheapest = self.edges[added].iter().map(|edge| edge.cost - self.column_potentials[edge.column]);
        self.row_potentials[added] = cheapest.min().unwrap_or(0).min(0);
        let (mut row, mut so_far) = (added, 0);
        let end = loop {
            for edge in &self.edges[row] {
                let reduced = edge.cost - self.row_potentials[row] - self.column_potentials[edge.column];
                let distance = so_far + reduced;
                if reached.get(&edge.column).is_none_or(|known| distance < known.distance) {
                    reached.insert(edge.column, Reached { distance, row, candidate: edge.candidate });
                    waiting.push(Reverse((distance, edge.column)));
                }
            }
            waiting.push(Reverse((so_far - self.row_potentials[row], columns + row)));
            let is_outdated = |distance: i128, column: usize| {
                column < columns && reached.get(&column).is_some_and(|known| known.distance < distance)
            };
            // The queue contains at least a dummy column, so the search never fails.
            let Some(Reverse((distance, column))) = std::iter::from_fn(|| waiting.pop())
                .find(|Reverse((distance, column))| !is_outdated(*distance, *column))
            else {
                return;
            };
            so_far = distance;
            match self.edge_of_column.get(column).copied().flatten() {
                Some((next, _)) => {
                    settled.push(column);
                    row = next;
                }
                None => break column,
            }
        };
        self.raise_potentials(added, so_far, &settled, &reached);
        self.augment(added, end, &reached);
    }

    /// Updates the potentials so that all reduced costs stay nonnegative after augmenting along a path of this length.
    fn raise_potentials(&mut self, added: usize, length: i128, settled: &[usize], reached: &BTreeMap<usize, Reached>) {
        self.row_potentials[added] += length;
        for column in settled {
            let change = length - reached[column].distance;
            self.column_potentials[*column] -= change;
            if let Some((row, _)) = self.edge_of_column[*column] {
                self.row_potentials[row] += change;
            }
        }
    }

    /// Matches every row on the path to `end` with the column after it.
    fn augment(&mut self, added: usize, end: usize, reached: &BTreeMap<usize, Reached>) {
        let columns = self.column_potentials.len();
        // From the end of the path: the column that a row leaves is free for the row before it.
        let mut column = end;
        if end >= columns {
            // The row of this dummy column becomes unmatched.
            let row = end - columns;
            match self.column_of(row, reached) {
                Some(left) if row != added => column = left,
                _ => return,
            }
        }
        loop {
            let Reached { row, candidate, .. } = reached[&column];
            let left = if row == added { None } else { self.column_of(row, reached) };
            self.edge_of_column[column] = Some((row, candidate));
            match left {
                Some(left) => column = left,
                None => return,
            }
        }
    }

    /// The column currently matched with a row, if it was reached.
    fn column_of(&self, row: usize, reached: &BTreeMap<usize, Reached>) -> Option<usize> {
        let is_own = |column: &usize| self.edge_of_column[*column].is_some_and(|(of, _)| of == row);
        self.edges[row].iter().map(|edge| edge.column).filter(|column| reached.contains_key(column)).find(is_own)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Maximum total weight of rows `row..`, by enumerating all matchings.
    fn enumerated(weights: &[Vec<i128>], row: usize, taken: &mut Vec<bool>) -> i128 {
        let Some(columns) = weights.get(row) else { return 0 };
        let mut best = enumerated(weights, row + 1, taken);
        for (column, weight) in columns.iter().enumerate() {
            if !taken[column] {
                taken[column] = true;
                best = best.max(weight + enumerated(weights, row + 1, taken));
                taken[column] = false;
            }
        }
        best
    }

    proptest! {
        #[test]
        fn no_enumerated_matching_is_better(rows in 1usize..6, columns in 1usize..6,
                                            numerators in prop::collection::vec(0u64..8, 36..=36)) {
            let mut weights = vec![vec![0; columns]; rows];
            let mut candidates = Vec::new();
            for row in 0..rows {
                for column in 0..columns {
                    let ratio = Ratio { numerator: numerators[row * 6 + column], denominator: 7 };
                    let pair = Candidate::new(row as u64, 10 + column as u64, ratio, Some(ratio));
                    weights[row][column] = pair.weight;
                    if ratio.numerator > 0 {
                        candidates.push(pair);
                    }
                }
            }
            let matched = best_assignment(&candidates).into_iter().map(|index| candidates[index]);
            let matched: Vec<Candidate> = matched.collect();
            let total: i128 = matched.iter().map(|pair| pair.weight).sum();
            prop_assert_eq!(total, enumerated(&weights, 0, &mut vec![false; columns]));
            for (index, pair) in matched.iter().enumerate() {
                let apart = |other: &Candidate| other.row != pair.row && other.column != pair.column;
                prop_assert!(matched[index + 1..].iter().all(apart));
            }
        }
    }

    #[test]
    fn tens_of_thousands_of_overlapping_things_are_matched() {
        // A grid of squares and the same grid shifted by a third of a square: each square overlaps four.
        const SIDE: u64 = 140;
        let mut candidates = Vec::new();
        for (row, column) in (0..SIDE).flat_map(|row| (0..SIDE).map(move |column| (row, column))) {
            for (down, right, shared) in [(0, 0, 4), (0, 1, 2), (1, 0, 2), (1, 1, 1)] {
                if row + down < SIDE && column + right < SIDE {
                    let other = (row + down) * SIDE + column + right;
                    candidates.push(Candidate::new(row * SIDE + column, other, Ratio::f_score(shared, 9, 9), None));
                }
            }
        }
        let matched = best_assignment(&candidates);
        assert_eq!(matched.len() as u64, SIDE * SIDE);
        assert!(matched.iter().all(|index| candidates[*index].row == candidates[*index].column));
    }

    #[test]
    fn no_candidates_give_no_match() {
        assert!(best_assignment(&[]).is_empty());
    }

    #[test]
    fn equal_sums_are_decided_by_the_second_ratio() {
        let ratio = |numerator| Ratio { numerator, denominator: 8 };
        let pair =
            |row, column, primary, secondary| Candidate::new(row, column, ratio(primary), Some(ratio(secondary)));
        let candidates = [pair(1, 1, 6, 0), pair(1, 2, 3, 3), pair(2, 1, 3, 3)];
        assert_eq!(best_assignment(&candidates), [1, 2]);
        let candidates = [pair(1, 1, 6, 6), pair(1, 2, 3, 0), pair(2, 1, 3, 0)];
        assert_eq!(best_assignment(&candidates), [0]);
        // 2/3 = 1/3 + 1/3 is a tie although neither is a binary fraction.
        let third = |row, column, numerator, credit| {
            Candidate::new(row, column, Ratio { numerator, denominator: 3 }, Some(ratio(credit)))
        };
        let candidates = [third(1, 1, 2, 0), third(1, 2, 1, 4), third(2, 1, 1, 4)];
        assert_eq!(best_assignment(&candidates), [1, 2]);
    }
}
