//! Candidate boxes and non-maximum suppression.

/// Anchors with their boxes, scores and mask coefficients.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Candidates {
    coefficient_count: usize,
    anchors: Vec<usize>,
    boxes_cxcywh: Vec<[f32; 4]>,
    scores: Vec<f32>,
    coefficients: Vec<f32>,
}

impl Candidates {
    /// Creates an empty list of candidates with `coefficient_count` mask coefficients each.
    pub fn new(coefficient_count: usize) -> Self {
        Self { coefficient_count, ..Self::default() }
    }

    /// Adds an anchor: its index, box (centre x, centre y, width, height in input pixels), score in [0, 1] and mask
    /// coefficients.
    ///
    /// # Panics
    /// If the number of coefficients is not `coefficient_count`.
    pub fn push(
        &mut self,
        anchor: usize,
        box_cxcywh: [f32; 4],
        score: f32,
        coefficients: impl IntoIterator<Item = f32>,
    ) {
        self.anchors.push(anchor);
        self.boxes_cxcywh.push(box_cxcywh);
        self.scores.push(score);
        self.coefficients.extend(coefficients);
        assert_eq!(
            self.coefficients.len(),
            self.len() * self.coefficient_count,
            "number of coefficients of a candidate"
        );
    }

    /// Number of candidates.
    pub fn len(&self) -> usize {
        self.anchors.len()
    }

    /// True if there are no candidates.
    pub fn is_empty(&self) -> bool {
        self.anchors.is_empty()
    }

    /// Index of a candidate's anchor.
    pub fn anchor(&self, index: usize) -> usize {
        self.anchors[index]
    }

    /// Score of a candidate.
    pub fn score(&self, index: usize) -> f32 {
        self.scores[index]
    }

    /// Centre x, centre y, width and height of a candidate's box, in input pixels.
    pub fn box_cxcywh(&self, index: usize) -> [f32; 4] {
        self.boxes_cxcywh[index]
    }

    /// Left, top, right and bottom of a candidate's box, in input pixels.
    pub fn box_xyxy(&self, index: usize) -> [f32; 4] {
        let [x, y, width, height] = self.boxes_cxcywh[index];
        let (half_width, half_height) = (width / 2.0, height / 2.0);
        [x - half_width, y - half_height, x + half_width, y + half_height]
    }

    /// Mask coefficients of a candidate.
    pub fn coefficients(&self, index: usize) -> &[f32] {
        &self.coefficients[index * self.coefficient_count..][..self.coefficient_count]
    }

    /// Non-maximum suppression. Returns the indices of at most `max_det` candidates, best first (the earlier anchor if
    /// scores are equal): those with a score above `confidence` whose IoU with every better one is at most `iou`.
    ///
    /// Uses the greedy rule of torchvision's `nms`, which Ultralytics calls: both thresholds are exclusive, and areas
    /// have no "+ 1".
    pub fn nms(&self, confidence: f64, iou: f64, max_det: usize) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.len()).filter(|i| f64::from(self.scores[*i]) > confidence).collect();
        order.sort_by(|a, b| self.scores[*b].total_cmp(&self.scores[*a]));
        order.truncate(MAX_CANDIDATES);
        let mut kept: Vec<(usize, [f32; 4])> = Vec::new();
        for index in order {
            if kept.len() == max_det {
                break;
            }
            let candidate = self.box_xyxy(index);
            if kept.iter().all(|(_, better)| f64::from(box_iou(*better, candidate)) <= iou) {
                kept.push((index, candidate));
            }
        }
        kept.into_iter().map(|(index, _)| index).collect()
    }
}

/// Maximum number of candidates for NMS, the best ones (Ultralytics' `max_nms`).
const MAX_CANDIDATES: usize = 30_000;

/// Intersection over union of two boxes (left, top, right, bottom); 0 if neither has an area.
pub(super) fn box_iou(a: [f32; 4], b: [f32; 4]) -> f32 {
    let area = |c: [f32; 4]| (c[2] - c[0]) * (c[3] - c[1]);
    let width = (a[2].min(b[2]) - a[0].max(b[0])).max(0.0);
    let height = (a[3].min(b[3]) - a[1].max(b[1])).max(0.0);
    let intersection = width * height;
    let union = area(a) + area(b) - intersection;
    if union > 0.0 { intersection / union } else { 0.0 }
}
