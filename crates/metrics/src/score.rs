//! Scores of videos and data sets.

use crate::by_size::no_counts;
use crate::{MetricsError, ScoreSettings, SizeClass, SizeCounts, SizeScores, StqCounts, VsqCounts, WindowLength};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Scores in percent (but for what [`SizeScores`] counts); `None` (JSON `null`) where there is nothing to divide by.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scores {
    /// Mean of the `vsq_k` that are not `None`.
    pub vsq: Option<f64>,
    /// VSQ^k by window length k.
    pub vsq_k: BTreeMap<WindowLength, Option<f64>>,
    /// √(AQ · SQ). Never `None` in the strict protocol, where an empty quotient is 0 as in STEP's code.
    pub stq: Option<f64>,
    /// Association quality; 0 without true tracks. In the paper protocol above 100 if masks that overlap each other
    /// cover the same object, which that code allows.
    pub aq: Option<f64>,
    /// Segmentation quality.
    pub sq: Option<f64>,
    /// How well objects keep their ids, by their size.
    pub by_size: BTreeMap<SizeClass, SizeScores>,
}

/// Summed counts, of which scores are quotients.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RawCounts {
    /// Counts of VSQ^k by window length k.
    pub vsq_k: BTreeMap<WindowLength, VsqCounts>,
    /// Counts of STQ.
    pub stq: StqCounts,
    /// Counts of ids by the size of the object, for every class.
    pub by_size: BTreeMap<SizeClass, SizeCounts>,
    /// Number of frames.
    pub frames: u64,
}

impl RawCounts {
    fn zero() -> Self {
        Self {
            vsq_k: WindowLength::ALL.map(|length| (length, VsqCounts::default())).into(),
            stq: StqCounts::default(),
            by_size: no_counts(),
            frames: 0,
        }
    }

    fn add(&mut self, other: &Self) {
        for (length, counts) in &other.vsq_k {
            self.vsq_k.entry(*length).or_default().add(counts);
        }
        self.stq.add(&other.stq);
        for (class, counts) in &other.by_size {
            self.by_size.entry(*class).or_default().add(counts);
        }
        self.frames += other.frames;
    }

    fn scores(&self, settings: &ScoreSettings) -> Scores {
        let percent = |quality: f64| 100.0 * quality;
        let vsq_k: BTreeMap<WindowLength, Option<f64>> =
            self.vsq_k.iter().map(|(length, counts)| (*length, counts.quality().map(percent))).collect();
        let known: Vec<f64> = vsq_k.values().flatten().copied().collect();
        Scores {
            vsq: (!known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64),
            vsq_k,
            stq: self.stq.quality(settings.protocol).map(percent),
            aq: Some(percent(self.stq.association_quality())),
            sq: self.stq.segmentation_quality(settings.protocol).map(percent),
            by_size: self.by_size.iter().map(|(class, counts)| (*class, counts.scores())).collect(),
        }
    }
}

/// What a scored video comes to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct VideoScore {
    settings: ScoreSettings,
    counts: RawCounts,
}

impl VideoScore {
    pub(crate) fn new(settings: ScoreSettings, counts: RawCounts) -> Self {
        Self { settings, counts }
    }

    /// The video's scores, in percent.
    pub fn scores(&self) -> Scores {
        self.counts.scores(&self.settings)
    }

    /// The counts behind the scores.
    pub fn counts(&self) -> &RawCounts {
        &self.counts
    }

    /// The settings it was scored with.
    pub fn settings(&self) -> &ScoreSettings {
        &self.settings
    }
}

/// Scores over the videos of a data set: tracks, tubes and pixels are summed, not videos averaged.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DatasetScore {
    settings: ScoreSettings,
    counts: RawCounts,
    videos: u64,
}

impl DatasetScore {
    /// A data set without videos yet, all of which are scored with `settings`.
    pub fn new(settings: ScoreSettings) -> Self {
        Self { settings, counts: RawCounts::zero(), videos: 0 }
    }

    /// Adds a video.
    ///
    /// # Errors
    /// [`MetricsError::SettingsDiffer`] if it was scored with other settings; nothing is added then.
    pub fn add(&mut self, video: &VideoScore) -> Result<(), MetricsError> {
        if video.settings != self.settings {
            return Err(MetricsError::SettingsDiffer { found: video.settings, expected: self.settings });
        }
        self.counts.add(&video.counts);
        self.videos += 1;
        Ok(())
    }

    /// The scores over all videos added so far, in percent.
    pub fn total(&self) -> Scores {
        self.counts.scores(&self.settings)
    }

    /// The summed counts.
    pub fn counts(&self) -> &RawCounts {
        &self.counts
    }

    /// The number of videos added.
    pub fn videos(&self) -> u64 {
        self.videos
    }
}
