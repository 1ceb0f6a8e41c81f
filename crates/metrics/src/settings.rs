//! Settings of scores: the definition of the metrics and the pixels that count.

use serde::{Deserialize, Serialize};

/// Definition of VSQ and STQ. Every table of scores should name it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Protocol {
    /// The paper's released evaluation code (`opipari/FastSPAM`, `video_segmentation/metrics`, `evaluate_iVPQ.py` and
    /// `evaluate_STQ.py`), for comparison with the paper's tables:
    ///
    /// - VSQ windows start at 0, 15, 30, … while start < frames − 15. Tubes are matched on the F-score, and every
    ///   matched pair with any overlap is a true positive. A video without true tubes in any of its windows of a length
    ///   is left out at that length, including its false positives.
    /// - SQ is the mean IoU of the classes object and background. Predictions on unlabelled pixels are ignored and the
    ///   background never intersects, so SQ is half the recall of labelled pixels, or 1 if none is missed.
    /// - AQ uses every predicted mask in full, even where masks overlap.
    #[default]
    Paper,
    /// The definitions behind the paper's formulas. VSQ^k follows VPQ (Kim et al. 2020): one window of k frames every
    /// 15 frames as long as it fits, the Hungarian algorithm on the IoU, and true positives only above 0.5. STQ is as
    /// in STEP (Weber et al. 2021): SQ is the IoU between all predicted and all labelled pixels. Where predicted masks
    /// overlap, STQ assigns the pixel to the smallest (ties: to the lowest id), because its definition has one id per
    /// pixel. VSQ uses every mask in full.
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

/// Treatment of predicted pixels where the ground truth has no label (id 0).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[non_exhaustive]
#[serde(rename_all = "lowercase")]
pub enum Void {
    /// These pixels count against the prediction.
    #[default]
    Counted,
    /// These pixels are removed before scoring. A predicted tube without other pixels disappears.
    Excluded,
}

/// Settings of a score. The default is the paper's evaluation of ScanNet-MV.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ScoreSettings {
    /// The definition of the metrics.
    pub protocol: Protocol,
    /// Treatment of predictions on unlabelled pixels.
    pub void: Void,
    /// True segments with less than this fraction of the image's pixels in a frame become unlabelled in that frame.
    /// 0 (the default) keeps all. MVPd is scored with 0.001 (`filter_idmask_area` of `MVPdHelpers.py`).
    pub min_ground_truth_area: f64,
}
