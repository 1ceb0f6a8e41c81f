//! What is scored, and by whose rules.

use serde::{Deserialize, Serialize};

/// Whose definition of VSQ and STQ is used. Every table of scores should say which.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Protocol {
    /// What the paper's released evaluation code computes (`opipari/FastSPAM`, `video_segmentation/metrics`,
    /// `evaluate_iVPQ.py` and `evaluate_STQ.py`), so that scores stand beside the paper's tables:
    ///
    /// - VSQ windows start at 0, 15, 30, … while start < frames − 15; tubes are matched on the F-score and every
    ///   matched pair that overlaps at all is a true positive; a video without any true tube in its windows of a
    ///   length counts for nothing at that length (its false positives are dropped);
    /// - SQ is the mean IoU of the classes object and background, where predictions on unlabelled ground are left out
    ///   and the background never intersects: half the recall of labelled pixels, or 1 if none is missed;
    /// - AQ takes every predicted mask in full, also where masks overlap.
    #[default]
    Paper,
    /// The formulas as printed: VSQ^k with one window of k frames every 15 frames as long as it fits, the Hungarian
    /// algorithm on the IoU and true positives only above 0.5 (as VPQ, Kim et al. 2020); STQ as in STEP (Weber et al.
    /// 2021), with SQ the IoU between all predicted and all labelled pixels. Where predicted masks overlap, STQ gives
    /// the pixel to the smallest of them (of equal ones to the lowest id), as one id per pixel is part of its
    /// definition; VSQ takes every mask in full.
    Strict,
}

/// What becomes of predicted pixels where the ground truth has no label (id 0).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Void {
    /// They count against the prediction.
    #[default]
    Counted,
    /// They are removed before scoring; a predicted tube that lies there completely disappears.
    Excluded,
}

/// Settings of a score. The default is the paper's evaluation of ScanNet-MV.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ScoreSettings {
    /// The definition of the metrics.
    pub protocol: Protocol,
    /// What becomes of predictions on unlabelled ground.
    pub void: Void,
    /// True segments with less than this fraction of the image's pixels in a frame become unlabelled in that frame.
    /// 0 (the default) keeps all; MVPd is scored with 0.001 (`filter_idmask_area` of `MVPdHelpers.py`).
    pub min_ground_truth_area: f64,
}
