//! Scores of videos and datasets.

use crate::by_size::zero_counts;
use crate::{MetricsError, ScoreSettings, SingleFrameCounts, SingleFrameScores, SizeClass, SizeCounts, SizeScores};
use crate::{StqCounts, VsqCounts, WindowLength};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Scores in percent (except for the numbers in [`SizeScores`]). `None` (JSON `null`) where the denominator is 0.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Scores {
    /// Mean of the `vsq_k` that are not `None`.
    pub vsq: Option<f64>,
    /// VSQ^k by window length k.
    pub vsq_k: BTreeMap<WindowLength, Option<f64>>,
    /// √(AQ · SQ). Never `None` under the strict protocol, in which division by zero gives 0, as in STEP's code.
    pub stq: Option<f64>,
    /// Association quality. 0 without true tracks. Under the paper protocol, as in the paper's code, it can exceed 100
    /// if overlapping masks cover the same object; see `overcounted_tracks`.
    pub aq: Option<f64>,
    /// Segmentation quality.
    pub sq: Option<f64>,
    /// True tracks that `aq` and `stq` count more than once; see [`StqCounts::overcounted_tracks`].
    pub overcounted_tracks: u64,
    /// Id consistency by object size.
    pub by_size: BTreeMap<SizeClass, SizeScores>,
    /// Segmentation quality of single frames. The same under both protocols.
    pub single_frames: SingleFrameScores,
}

/// The counts from which scores are computed. Counts of several videos can be added.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct RawCounts {
    /// Counts of VSQ^k by window length k.
    pub vsq_k: BTreeMap<WindowLength, VsqCounts>,
    /// Counts of STQ.
    pub stq: StqCounts,
    /// Counts of ids by object size, for every class.
    pub by_size: BTreeMap<SizeClass, SizeCounts>,
    /// Counts of single frames.
    pub single_frames: SingleFrameCounts,
    /// Number of frames.
    pub frames: u64,
}

impl RawCounts {
    fn zero() -> Self {
        Self {
            vsq_k: WindowLength::ALL.map(|length| (length, VsqCounts::default())).into(),
            stq: StqCounts::default(),
            by_size: zero_counts(),
            single_frames: SingleFrameCounts::default(),
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
        self.single_frames.add(&other.single_frames);
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
            overcounted_tracks: self.stq.overcounted_tracks,
            by_size: self.by_size.iter().map(|(class, counts)| (*class, counts.scores())).collect(),
            single_frames: self.single_frames.scores(),
        }
    }
}

/// The score of a video.
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

    /// The settings with which the video was scored.
    pub fn settings(&self) -> &ScoreSettings {
        &self.settings
    }
}

/// Scores over the videos of a dataset, from the summed counts of tracks, tubes and pixels, not an average over videos.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DatasetScore {
    settings: ScoreSettings,
    counts: RawCounts,
    videos: u64,
}

impl DatasetScore {
    /// Creates an empty dataset score. All videos must be scored with `settings`.
    pub fn new(settings: ScoreSettings) -> Self {
        Self { settings, counts: RawCounts::zero(), videos: 0 }
    }

    /// Adds a video.
    ///
    /// # Errors
    /// [`MetricsError::SettingsDiffer`] if it was scored with other settings. Nothing is added then.
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

    /// Number of videos added.
    pub fn videos(&self) -> u64 {
        self.videos
    }
}
