//! Video segmentation quality: VSQ^k = Σ IoU of true positives / (TP + FP/2 + FN/2) over windows of k frames.

use crate::Protocol;
use crate::overlap::FrameOverlaps;
use crate::tubes::{PairAreas, TubeCounts, TubeId, TubeOfLabel};
use serde::{Deserialize, Serialize};
use splatseg_geometry::{Candidate, Ratio, SegmentId, best_assignment};

/// Number of frames from the start of one window to the start of the next.
const WINDOW_STEP: usize = 15;

/// The window lengths k over which VSQ is averaged. JSON keys are `"1"`, `"5"`, `"10"` and `"15"`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[non_exhaustive]
pub enum WindowLength {
    /// One frame.
    #[serde(rename = "1")]
    One,
    /// Five frames.
    #[serde(rename = "5")]
    Five,
    /// Ten frames.
    #[serde(rename = "10")]
    Ten,
    /// Fifteen frames.
    #[serde(rename = "15")]
    Fifteen,
}

impl WindowLength {
    /// All lengths, in increasing order.
    pub const ALL: [Self; 4] = [Self::One, Self::Five, Self::Ten, Self::Fifteen];

    /// The number of frames k.
    pub fn frames(self) -> usize {
        match self {
            Self::One => 1,
            Self::Five => 5,
            Self::Ten => 10,
            Self::Fifteen => 15,
        }
    }

    /// Minimum number of frames of a video with at least one window. The paper's code counts a window of any length
    /// only if at least one frame follows its 15 frames.
    pub fn least_frames(self, protocol: Protocol) -> usize {
        match protocol {
            Protocol::Paper => WINDOW_STEP + 1,
            Protocol::Strict => self.frames(),
        }
    }
}

/// Counts of one window length. Counts of several windows or videos can be added.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct VsqCounts {
    /// Sum of the true positives' IoU.
    pub sum_iou: f64,
    /// Number of matched pairs that count as correct.
    #[serde(rename = "tp")]
    pub true_positives: u64,
    /// Number of other predicted tubes.
    #[serde(rename = "fp")]
    pub false_positives: u64,
    /// Number of other true tubes.
    #[serde(rename = "fn")]
    pub false_negatives: u64,
    /// Number of scored windows.
    pub windows: u64,
}

impl VsqCounts {
    /// VSQ^k in [0, 1]. `None` without tubes.
    pub fn quality(&self) -> Option<f64> {
        let tubes = 2 * self.true_positives + self.false_positives + self.false_negatives;
        (tubes > 0).then(|| self.sum_iou / (tubes as f64 / 2.0))
    }

    pub(crate) fn add(&mut self, other: &Self) {
        self.sum_iou += other.sum_iou;
        self.true_positives += other.true_positives;
        self.false_positives += other.false_positives;
        self.false_negatives += other.false_negatives;
        self.windows += other.windows;
    }

    pub(crate) fn from_window(tubes: &TubeCounts, protocol: Protocol) -> Self {
        let candidate = |(truth, tube, areas): (SegmentId, TubeId, PairAreas)| {
            let iou = Ratio::iou(areas.intersection, areas.truth, areas.predicted);
            let matched_on = match protocol {
                Protocol::Paper => Ratio::f_score(areas.intersection, areas.truth, areas.predicted),
                Protocol::Strict => iou,
            };
            // Ties between assignments go to the one with the highest score.
            let credit = is_true_positive(iou, protocol).then_some(iou);
            (Candidate::new(u64::from(truth), tube, matched_on, credit), iou)
        };
        let (candidates, ious): (Vec<Candidate>, Vec<Ratio>) = tubes.pairs().map(candidate).unzip();
        let mut counts = Self { windows: 1, ..Self::default() };
        for iou in best_assignment(&candidates).into_iter().map(|index| ious[index]) {
            if is_true_positive(iou, protocol) {
                counts.sum_iou += iou.to_f64();
                counts.true_positives += 1;
            }
        }
        counts.false_positives = tubes.predicted_areas.len() as u64 - counts.true_positives;
        counts.false_negatives = tubes.truth_areas.len() as u64 - counts.true_positives;
        counts
    }
}

/// True if a matched pair counts as correct: with any overlap in the paper's code, above IoU 0.5 in VPQ's definition.
fn is_true_positive(iou: Ratio, protocol: Protocol) -> bool {
    match protocol {
        Protocol::Paper => iou.numerator > 0,
        Protocol::Strict => 2 * iou.numerator > iou.denominator,
    }
}

/// Collects the counts of VSQ, frame by frame. Keeps only the tubes of the current window.
#[derive(Clone, Debug)]
pub(crate) struct VsqAccumulator {
    protocol: Protocol,
    frames_in_window: usize,
    window: TubeCounts,
    /// Counts of the current window, in the order of [`WindowLength::ALL`]. The paper's code counts a window only if a
    /// frame follows it, so the counts are provisional until that frame arrives.
    provisional: [VsqCounts; 4],
    confirmed: [VsqCounts; 4],
}

impl VsqAccumulator {
    pub(crate) fn new(protocol: Protocol) -> Self {
        Self {
            protocol,
            frames_in_window: 0,
            window: TubeCounts::default(),
            provisional: Default::default(),
            confirmed: Default::default(),
        }
    }

    /// Adds a frame.
    pub(crate) fn push(&mut self, frame: &FrameOverlaps, tube_of_label: TubeOfLabel) {
        if self.frames_in_window == WINDOW_STEP {
            self.confirm();
            self.window = TubeCounts::default();
            self.frames_in_window = 0;
        }
        self.window.add(frame, frame.full(), tube_of_label);
        if let (Protocol::Paper, TubeOfLabel::Linked(_)) = (self.protocol, tube_of_label) {
            for label in &frame.empty_labels {
                self.window.add_empty_tube(tube_of_label.tube(*label));
            }
        }
        self.frames_in_window += 1;
        for (length, counts) in WindowLength::ALL.into_iter().zip(&mut self.provisional) {
            if length.frames() == self.frames_in_window {
                *counts = VsqCounts::from_window(&self.window, self.protocol);
            }
        }
        if self.protocol == Protocol::Strict {
            self.confirm();
        }
    }

    fn confirm(&mut self) {
        for (confirmed, provisional) in self.confirmed.iter_mut().zip(&mut self.provisional) {
            confirmed.add(&std::mem::take(provisional));
        }
    }

    /// The counts of all confirmed windows, in the order of [`WindowLength::ALL`].
    pub(crate) fn finish(self) -> [VsqCounts; 4] {
        self.confirmed.map(|counts| {
            // `summarize_iVPQ` of the paper's code leaves out a video without true tubes.
            let has_no_truth = counts.true_positives + counts.false_negatives == 0;
            if self.protocol == Protocol::Paper && has_no_truth {
                VsqCounts { windows: counts.windows, ..VsqCounts::default() }
            } else {
                counts
            }
        })
    }
}
