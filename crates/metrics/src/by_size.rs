//! Id consistency by the size of the true object.

use crate::overlap::FrameOverlaps;
use crate::tubes::{TubeId, TubeOfLabel};
use serde::{Deserialize, Serialize};
use splatseg_geometry::SegmentId;
use std::collections::BTreeMap;

/// True objects with a smaller mean area are small, pixels.
pub const SMALL_BELOW_PX: u64 = 400;

/// True objects with a larger mean area are large, pixels.
pub const LARGE_ABOVE_PX: u64 = 4000;

/// Size class of a true object by its mean area over the frames that show it, in pixels of the scored frames. JSON keys
/// are `"small"`, `"medium"` and `"large"`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[non_exhaustive]
#[serde(rename_all = "lowercase")]
pub enum SizeClass {
    /// Under [`SMALL_BELOW_PX`].
    Small,
    /// From [`SMALL_BELOW_PX`] to [`LARGE_ABOVE_PX`], inclusive.
    Medium,
    /// Over [`LARGE_ABOVE_PX`].
    Large,
}

impl SizeClass {
    /// All classes, by increasing size.
    pub const ALL: [Self; 3] = [Self::Small, Self::Medium, Self::Large];

    /// The class of an object with `pixels` pixels in total over its `frames`.
    pub(crate) fn from_area(pixels: u64, frames: u64) -> Self {
        if pixels < SMALL_BELOW_PX * frames {
            Self::Small
        } else if pixels > LARGE_ABOVE_PX * frames {
            Self::Large
        } else {
            Self::Medium
        }
    }

    /// Its name, as in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Small => "small",
            Self::Medium => "medium",
            Self::Large => "large",
        }
    }

    /// Its name and bounds, e.g. `small (under 400 px)`.
    pub fn label(self) -> String {
        let name = self.name();
        match self {
            Self::Small => format!("{name} (under {SMALL_BELOW_PX} px)"),
            Self::Medium => format!("{name} ({SMALL_BELOW_PX} to {LARGE_ABOVE_PX} px)"),
            Self::Large => format!("{name} (over {LARGE_ABOVE_PX} px)"),
        }
    }
}

/// Counts of the true objects of one size. Counts of several videos can be added.
///
/// The id of an object in a frame is the predicted id that covers more than half of its pixels. Where predicted masks
/// overlap, a pixel has the id of the smallest (as in [`Protocol::Strict`](crate::Protocol::Strict), but under both
/// protocols), so there is at most one such id. A neighbour's mask that spills over the border adds no id, nor does a
/// frame in which too little of the object is covered. A neighbour's mask that covers most of the object does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SizeCounts {
    /// Contribution of these objects to [`StqCounts::sum_association`](crate::StqCounts::sum_association).
    pub sum_association: f64,
    /// Number of objects (true tracks).
    pub objects: u64,
    /// Number of objects that have an id in at least one frame.
    pub found: u64,
    /// Number of distinct ids of each object over its video, summed over objects.
    pub ids: u64,
    /// Number of frames that show each object, summed over objects.
    pub frames: u64,
    /// Number of frames in which each object has its most frequent id, summed over objects.
    pub main_id_frames: u64,
}

impl SizeCounts {
    pub(crate) fn add(&mut self, other: &Self) {
        self.sum_association += other.sum_association;
        self.objects += other.objects;
        self.found += other.found;
        self.ids += other.ids;
        self.frames += other.frames;
        self.main_id_frames += other.main_id_frames;
    }

    pub(crate) fn scores(&self) -> SizeScores {
        let ratio = |sum: f64, count: u64| (count > 0).then(|| sum / count as f64);
        let percent = |sum: f64, count: u64| ratio(100.0 * sum, count);
        SizeScores {
            objects: self.objects,
            aq: percent(self.sum_association, self.objects),
            found: percent(self.found as f64, self.objects),
            ids_per_object: ratio(self.ids as f64, self.found),
            main_id: percent(self.main_id_frames as f64, self.frames),
        }
    }
}

/// Id consistency of the objects of one size. [`SizeCounts`] defines the id of an object. `None` (JSON `null`) where
/// the denominator is 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct SizeScores {
    /// Number of true objects.
    pub objects: u64,
    /// Mean association quality of these objects, percent, with equal weights as in [`Scores::aq`](crate::Scores::aq).
    pub aq: Option<f64>,
    /// Objects with an id in at least one frame, percent.
    pub found: Option<f64>,
    /// Mean number of distinct ids over the video, of the objects with any id. 1 is best.
    pub ids_per_object: Option<f64>,
    /// Frames in which an object has its most frequent id, as a percentage of the frames that show it.
    pub main_id: Option<f64>,
}

/// The ids of a true object over its video.
#[derive(Clone, Debug, Default)]
struct ObjectIds {
    frames: u64,
    pixels: u64,
    /// Number of frames with each id.
    frames_of_id: BTreeMap<TubeId, u64>,
}

/// Collects the ids of a video's objects, frame by frame. Keeps one count for each object and id.
#[derive(Clone, Debug, Default)]
pub(crate) struct SizeAccumulator {
    objects: BTreeMap<SegmentId, ObjectIds>,
}

impl SizeAccumulator {
    /// Adds a frame.
    pub(crate) fn push(&mut self, frame: &FrameOverlaps, tube_of_label: TubeOfLabel) {
        for (truth, area) in &frame.truth_areas {
            let object = self.objects.entry(*truth).or_default();
            object.frames += 1;
            object.pixels += area;
        }
        for overlap in frame.flat() {
            // Unlabelled pixels belong to no object.
            let Some(area) = frame.truth_areas.get(&overlap.truth) else { continue };
            if 2 * overlap.pixels > *area {
                let object = self.objects.entry(overlap.truth).or_default();
                *object.frames_of_id.entry(tube_of_label.tube(overlap.label)).or_insert(0) += 1;
            }
        }
    }

    /// Returns the counts by size. `associations` contains the contribution of each true track to STQ, by default 0.
    pub(crate) fn finish(self, associations: &BTreeMap<SegmentId, f64>) -> BTreeMap<SizeClass, SizeCounts> {
        let mut counts = zero_counts();
        for (truth, object) in &self.objects {
            counts.entry(SizeClass::from_area(object.pixels, object.frames)).or_default().add(&SizeCounts {
                sum_association: associations.get(truth).copied().unwrap_or(0.0),
                objects: 1,
                found: u64::from(!object.frames_of_id.is_empty()),
                ids: object.frames_of_id.len() as u64,
                frames: object.frames,
                main_id_frames: object.frames_of_id.values().copied().max().unwrap_or(0),
            });
        }
        counts
    }
}

/// Zero counts for every class.
pub(crate) fn zero_counts() -> BTreeMap<SizeClass, SizeCounts> {
    SizeClass::ALL.map(|class| (class, SizeCounts::default())).into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bounds_belong_to_the_medium_class() {
        for (pixels, frames, class) in [
            (399, 1, SizeClass::Small),
            (400, 1, SizeClass::Medium),
            (1199, 3, SizeClass::Small),
            (1200, 3, SizeClass::Medium),
            (4000, 1, SizeClass::Medium),
            (8000, 2, SizeClass::Medium),
            (8001, 2, SizeClass::Large),
        ] {
            assert_eq!(SizeClass::from_area(pixels, frames), class, "{pixels} pixels in {frames} frames");
        }
        let labels = SizeClass::ALL.map(SizeClass::label);
        assert_eq!(labels, ["small (under 400 px)", "medium (400 to 4000 px)", "large (over 4000 px)"]);
    }

    #[test]
    fn json_has_the_names_of_the_classes() {
        for class in SizeClass::ALL {
            assert_eq!(serde_json::to_value(class).unwrap(), class.name());
        }
    }

    #[test]
    fn zero_denominators_give_none() {
        let none = SizeScores { objects: 0, aq: None, found: None, ids_per_object: None, main_id: None };
        assert_eq!(SizeCounts::default().scores(), none);
        let missed = SizeCounts { objects: 2, frames: 5, ..SizeCounts::default() };
        let expected =
            SizeScores { objects: 2, aq: Some(0.0), found: Some(0.0), ids_per_object: None, main_id: Some(0.0) };
        assert_eq!(missed.scores(), expected);
    }
}
