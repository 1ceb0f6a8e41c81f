//! Labels from similarities. Some labels are similar to everything in a room, so similarities are standardised for each
//! label over the objects of the map; an object for which no label stands out stays without one.

use splatseg_objects::{LabelScore, ObjectName};

/// Number of objects of a typical room as which the prior counts: with fewer, standardisation has little effect.
const PRIOR_OBJECTS: f64 = 8.0;
/// Range of the factor by which a label's differences are scaled.
const SCALES: [f64; 2] = [0.5, 2.0];
/// Number of alternatives.
const ALTERNATIVES: usize = 3;
/// Alternatives are at least this probable, as a share of the best.
const MIN_SHARE: f64 = 0.1;

/// How labels are chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LabelChoice {
    /// Factor of similarities before the softmax: the network's own.
    pub scale: f64,
    /// The first labels, `named` in number, can be given; the rest are words for anything, which take their share.
    pub named: usize,
    /// Least probability of a label.
    pub min_score: f64,
}

impl LabelChoice {
    /// Chooses among `labels` for each object. `similarities` are cosines, `[objects][all labels]`.
    pub fn names(self, similarities: &[Vec<f32>], labels: &[&str]) -> Vec<ObjectName> {
        let standardised = standardised(similarities);
        standardised.iter().map(|row| self.name(row, labels)).collect()
    }

    fn name(self, row: &[f64], labels: &[&str]) -> ObjectName {
        let largest = row.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let weights: Vec<f64> = row.iter().map(|similarity| (self.scale * (similarity - largest)).exp()).collect();
        let sum: f64 = weights.iter().sum();
        let mut order: Vec<usize> = (0..self.named).collect();
        order.sort_by(|one, other| weights[*other].total_cmp(&weights[*one]).then(one.cmp(other)));
        let score = |index: usize| LabelScore { label: labels[index].to_owned(), score: (weights[index] / sum) as f32 };
        let Some(best) = order.first().map(|index| score(*index)) else { return ObjectName::default() };
        let is_clear = f64::from(best.score) >= self.min_score
            && weights[self.named..].iter().all(|other| *other <= weights[order[0]]);
        let others = if is_clear { &order[1..] } else { &order[..] };
        let alternatives = others.iter().map(|index| score(*index)).take(ALTERNATIVES);
        let alternatives =
            alternatives.filter(|other| f64::from(other.score) >= MIN_SHARE * f64::from(best.score)).collect();
        let score = is_clear.then_some(best.score);
        ObjectName { label: is_clear.then_some(best.label), score, alternatives, ..ObjectName::default() }
    }
}

/// Each label's similarities, moved and scaled so that its mean and deviation over the objects come nearer to those of
/// all labels, the nearer the more objects there are.
fn standardised(similarities: &[Vec<f32>]) -> Vec<Vec<f64>> {
    let objects = similarities.len() as f64;
    let labels = similarities.first().map_or(0, Vec::len);
    let share = objects / (objects + PRIOR_OBJECTS);
    let column = |label: usize| similarities.iter().map(move |row| f64::from(row[label]));
    let means: Vec<f64> = (0..labels).map(|label| column(label).sum::<f64>() / objects).collect();
    let variances: Vec<f64> = (0..labels)
        .map(|label| column(label).map(|value| (value - means[label]).powi(2)).sum::<f64>() / objects)
        .collect();
    let mean = means.iter().sum::<f64>() / labels.max(1) as f64;
    let variance = variances.iter().sum::<f64>() / labels.max(1) as f64;
    let scales: Vec<f64> = variances
        .iter()
        .map(|own| {
            let own = share * own + (1.0 - share) * variance;
            if own > 0.0 { (variance / own).sqrt().clamp(SCALES[0], SCALES[1]) } else { 1.0 }
        })
        .collect();
    let value = |label: usize, similarity: f32| {
        let center = mean + share * (means[label] - mean);
        // The label's differences from its own mean are scaled, and part of that mean's difference is taken away.
        mean + (means[label] - center) + scales[label] * (f64::from(similarity) - means[label])
    };
    similarities
        .iter()
        .map(|row| row.iter().enumerate().map(|(label, similarity)| value(label, *similarity)).collect())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const CHOICE: LabelChoice = LabelChoice { scale: 100.0, named: 3, min_score: 0.3 };
    const LABELS: [&str; 3] = ["mug", "chair", "thing that all are like"];

    #[test]
    fn a_label_that_likes_everything_names_nothing() {
        // Objects 0 to 9 are mugs and chairs, a little more similar to the third label than to their own.
        let row = |object: usize| {
            let own = object % 2;
            let mut row = vec![0.15, 0.15, 0.26, 0.15];
            row[own] = 0.25;
            row
        };
        let similarities: Vec<Vec<f32>> = (0..10).map(row).collect();
        let names = CHOICE.names(&similarities, &LABELS);
        for (object, name) in names.iter().enumerate() {
            assert_eq!(name.label.as_deref(), Some(LABELS[object % 2]), "{names:?}");
        }
        // One object alone has nothing to compare with.
        assert_eq!(CHOICE.names(&similarities[..1], &LABELS)[0].label.as_deref(), Some(LABELS[2]));
    }

    #[test]
    fn what_is_like_no_label_stays_unknown() {
        let names = CHOICE.names(&[vec![0.2, 0.2, 0.2, 0.2], vec![0.2, 0.21, 0.2, 0.25]], &LABELS);
        assert!(names.iter().all(|name| name.label.is_none() && name.score.is_none()), "{names:?}");
        assert_eq!(names[0].alternatives.len(), 3);
        assert!(CHOICE.names(&[], &LABELS).is_empty());
        let clear = CHOICE.names(&[vec![0.1, 0.3, 0.1, 0.1]], &LABELS).remove(0);
        assert_eq!((clear.label.as_deref(), clear.alternatives.len()), (Some("chair"), 0));
        assert!(clear.score.is_some_and(|score| score > 0.99));
    }
}
