//! One-to-one matching with the largest summed weight (the Hungarian algorithm), in whole numbers.
//!
//! Weights are fixed-point, so that sums are exact and the result does not depend on the order in which they are
//! added. Where several assignments have the same sum, a second, much smaller weight decides.

use pathfinding::prelude::{Matrix, kuhn_munkres};

/// Bits after the binary point of the ratio whose sum is maximised; room for 2^64 pairs is left above it.
const PRIMARY_BITS: u32 = 62;
/// The same for the ratio that decides between equal sums: it weighs 2^-40 of the first. That is more than what is
/// rounded off the first, which would otherwise decide between equal sums such as 1/3 + 1/3 and 2/3, and less than
/// any difference that should count.
const SECONDARY_BITS: u32 = 22;

/// A fraction of two pixel counts, at most 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ratio {
    /// Pixels counted.
    pub numerator: u64,
    /// Pixels they are compared with.
    pub denominator: u64,
}

impl Ratio {
    /// Intersection over union of two sets of pixels.
    pub fn iou(intersection: u64, first_area: u64, second_area: u64) -> Self {
        Self { numerator: intersection, denominator: first_area + second_area - intersection }
    }

    /// F-score of two sets of pixels: twice the intersection over the summed areas.
    pub fn f_score(intersection: u64, first_area: u64, second_area: u64) -> Self {
        Self { numerator: 2 * intersection, denominator: first_area + second_area }
    }

    /// As a number; NaN for 0 / 0.
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
    /// One of the things on one side.
    pub row: u64,
    /// One of the things on the other side.
    pub column: u64,
    weight: i128,
}

impl Candidate {
    /// A pair whose `primary` ratio counts towards the sum to be maximised; `secondary` decides between equal sums.
    pub fn new(row: u64, column: u64, primary: Ratio, secondary: Option<Ratio>) -> Self {
        let secondary = secondary.map_or(0, |ratio| ratio.fixed(SECONDARY_BITS));
        Self { row, column, weight: primary.fixed(PRIMARY_BITS) + secondary }
    }
}

/// Indices of the candidates that are matched, increasing: no two share a row or a column and their summed weight is
/// the largest. Rows and columns without candidates stay unmatched. No pair may occur twice.
pub fn best_assignment(candidates: &[Candidate]) -> Vec<usize> {
    let mut rows: Vec<u64> = candidates.iter().map(|pair| pair.row).collect();
    let mut columns: Vec<u64> = candidates.iter().map(|pair| pair.column).collect();
    for keys in [&mut rows, &mut columns] {
        keys.sort_unstable();
        keys.dedup();
    }
    if rows.is_empty() {
        return Vec::new();
    }
    // `kuhn_munkres` gives every row a column, so the shorter side has to be the rows.
    let transposed = rows.len() > columns.len();
    let position = |pair: &Candidate| {
        let row = rows.partition_point(|key| *key < pair.row);
        let column = columns.partition_point(|key| *key < pair.column);
        if transposed { (column, row) } else { (row, column) }
    };
    let (short, long) = (rows.len().min(columns.len()), rows.len().max(columns.len()));
    let mut weights = Matrix::new(short, long, 0i128);
    for pair in candidates {
        weights[position(pair)] = pair.weight;
    }
    let (_, long_of_short) = kuhn_munkres(&weights);
    let is_matched = |pair: &Candidate| {
        let (short, long) = position(pair);
        // A weight of 0 means no overlap, which is not a match.
        long_of_short[short] == long && pair.weight > 0
    };
    (0..candidates.len()).filter(|index| is_matched(&candidates[*index])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The largest summed weight of rows `row..`, trying every free column and none.
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
    fn nothing_to_match_is_no_match() {
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
