//! The definition of the metrics, and what is scored.

use serde::{Deserialize, Serialize};

/// Which definition of VSQ and STQ is used. Every table of scores should say which one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Protocol {
    /// What the paper's released evaluation code computes (`opipari/FastSPAM`, `video_segmentation/metrics`,
    /// `evaluate_iVPQ.py` and `evaluate_STQ.py`), so that scores can be compared with the paper's tables:
    ///
    /// - VSQ windows start at 0, 15, 30, … while start < frames − 15; tubes are matched on the F-score and every
    ///   matched pair that overlaps at all is a true positive; a video without any true tube in its windows of a
    ///   length is left out at that length, false positives included;
    /// - SQ is the mean IoU of the classes object and background, where predictions on unlabelled ground are left out
    ///   and the background never intersects: half the recall of labelled pixels, or 1 if none is missed;
    /// - AQ uses every predicted mask as it is, even where masks overlap.
    #[default]
    Paper,
    /// The definitions that the paper's formulas come from: VSQ^k with one window of k frames every 15 frames as long as it fits, the Hungarian
    /// algorithm on the IoU and true positives only above 0.5 (as VPQ, Kim et al. 2020); STQ as in STEP (Weber et al.
    /// 2021), with SQ the IoU between all predicted and all labelled pixels. Where predicted masks overlap, STQ gives
    /// the pixel to the smallest of them (of equal ones to the lowest id), because its definition has one id per
    /// pixel; VSQ uses every mask as it is.
    Strict,
}

impl Protocol {
    /// Its name on the command line and in JSON: `paper` or `strict`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Strict => "strict",
        }
    }
}

/// How predicted pixels count where the ground truth has no label (id 0).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[non_exhaustive]
#[serde(rename_all = "lowercase")]
pub enum Void {
    /// They count against the prediction.
    #[default]
    Counted,
    /// They are removed before scoring; a predicted tube that has no other pixels disappears.
    Excluded,
}

/// Settings of a score. The default is the paper's evaluation of ScanNet-MV.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ScoreSettings {
    /// The definition of the metrics.
    pub protocol: Protocol,
    /// How predictions on unlabelled pixels count.
    pub void: Void,
    /// True segments with less than this fraction of the image's pixels in a frame become unlabelled in that frame.
    /// 0 (the default) keeps all; MVPd is scored with 0.001 (`filter_idmask_area` of `MVPdHelpers.py`).
    pub min_ground_truth_area: f64,
}
