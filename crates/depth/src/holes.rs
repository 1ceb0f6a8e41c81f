//! Holes of measured depth, filled with a prediction that is fitted to the measurements around them.

use crate::{DepthFit, FitPrior, PredictedDepth};
use splatseg_geometry::{CowImage, Image};

/// A prediction that deviates by more than this from the measurements, in the median and relative, fills nothing.
const MAX_ERROR: f32 = 0.06;

/// Less confidence fills nothing.
const MIN_CONFIDENCE: f32 = 0.3;

/// Holes are filled up to this distance, metres: beyond, predictions mean little.
const MAX_DEPTH: f32 = 10.0;

/// Neighbours whose predicted depth differs by more than this share lie on an edge, which predictions blur.
const EDGE: f32 = 0.06;

/// Measured depth with its holes filled.
#[derive(Clone, Debug, PartialEq)]
pub struct FilledDepth {
    /// z-depth, metres, 0 where still missing, `[height, width]`.
    pub depth: Image<f32>,
    /// True where the depth was predicted, `[height, width]`.
    pub predicted: Image<bool>,
}

/// Fills the holes of `measured` depth, metres, 0 where missing, with a prediction of the same size. `None` if the
/// prediction does not agree with what was measured, or there are no holes.
pub fn filled(measured: &CowImage<'_, f32>, prediction: &PredictedDepth) -> Option<FilledDepth> {
    if measured.pixels().iter().all(|depth| *depth > 0.0) {
        return None;
    }
    let fit = DepthFit::new(&prediction.depth, measured, FitPrior::default());
    if fit.compared == 0.0 || fit.error > MAX_ERROR {
        return None;
    }
    let fitted = fit.apply(&prediction.depth);
    let is_sure = |at: (usize, usize)| {
        let confidence = prediction.confidence.as_ref().is_none_or(|confidence| confidence[at] >= MIN_CONFIDENCE);
        confidence && !is_edge(&fitted, at)
    };
    let (width, height) = measured.size();
    let predicted = Image::from_fn(width, height, |column, row| {
        let at = (column, row);
        measured[at] <= 0.0 && (0.0..MAX_DEPTH).contains(&fitted[at]) && fitted[at] > 0.0 && is_sure(at)
    });
    let depth = Image::from_fn(width, height, |column, row| {
        if predicted[(column, row)] { fitted[(column, row)] } else { measured[(column, row)] }
    });
    Some(FilledDepth { depth, predicted })
}

/// True if the depth changes quickly at a pixel.
fn is_edge(depth: &Image<f32>, (column, row): (usize, usize)) -> bool {
    let here = depth[(column, row)];
    let (width, height) = depth.size();
    let beside = [
        (column + 1 < width).then(|| (column + 1, row)),
        column.checked_sub(1).map(|column| (column, row)),
        (row + 1 < height).then(|| (column, row + 1)),
        row.checked_sub(1).map(|row| (column, row)),
    ];
    beside.into_iter().flatten().any(|at| (depth[at] - here).abs() > EDGE * here)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall with a box in front of it, and holes in both.
    fn scene() -> (Image<f32>, Image<f32>) {
        let truth = Image::from_fn(80, 60, |column, row| {
            let is_box = (20..50).contains(&column) && row > 25;
            if is_box { 1.2 } else { 2.0 + 0.01 * column as f32 }
        });
        let measured = Image::from_fn(80, 60, |column, row| {
            let is_hole = (30..40).contains(&column) && (30..40).contains(&row) || column > 70;
            if is_hole { 0.0 } else { truth[(column, row)] }
        });
        (truth, measured)
    }

    #[test]
    fn holes_are_filled_where_the_prediction_agrees() {
        let (truth, measured) = scene();
        let prediction = PredictedDepth { depth: truth.map(|depth| 1.3 * depth), confidence: None };
        let filled = filled(&measured, &prediction).unwrap();
        for (at, predicted) in [((35, 35), true), ((75, 10), true), ((5, 5), false)] {
            assert_eq!(filled.predicted[at], predicted, "{at:?}");
            assert!((filled.depth[at] / truth[at] - 1.0).abs() < 0.02, "{at:?}: {}", filled.depth[at]);
        }
    }

    #[test]
    fn a_prediction_that_contradicts_the_sensor_fills_nothing() {
        let (_, measured) = scene();
        let noise = Image::from_fn(80, 60, |column, row| 1.0 + ((column * 7 + row * 13) % 17) as f32 * 0.2);
        assert_eq!(filled(&measured, &PredictedDepth { depth: noise, confidence: None }), None);
        let full = Image::filled(80, 60, 2.0);
        assert_eq!(filled(&full, &PredictedDepth { depth: full.clone(), confidence: None }), None, "no holes");
    }

    #[test]
    fn what_the_predictor_doubts_stays_a_hole() {
        let (truth, measured) = scene();
        let confidence = Image::from_fn(80, 60, |column, _| if column > 60 { 0.1 } else { 1.0 });
        let filled = filled(&measured, &PredictedDepth { depth: truth, confidence: Some(confidence) }).unwrap();
        assert!(filled.predicted[(35, 35)] && !filled.predicted[(75, 10)]);
    }
}
