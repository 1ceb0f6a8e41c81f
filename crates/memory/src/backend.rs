//! Where a map and what its Gaussians remember are kept and worked on: the seam between a memory and its device.
//!
//! A memory asks for one view per frame, and then to fuse and to update. Blend weights never cross this seam: they stay
//! where they are made. [`HostMap`](crate::host_map::HostMap) is the one on the CPU; the crate
//! `splatseg-render-gpu` has one on a GPU.

use crate::ply::SplatContentView;
use crate::recall::Recall;
use crate::{LearningExtent, MemoryError, MemorySettings, SegmentCodes, SegmentHold, SplatMap, Votes};
use splatseg_geometry::{LocalPose, RgbdFrame, SegmentId, SegmentMap};
use splatseg_render::{Balls, Camera};

/// A Gaussian that can touch a frame's image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VisibleGaussian {
    /// Index of the Gaussian.
    pub gaussian: u32,
    /// Row-major index of the pixel in which its centre lies, if the frame sees its surface.
    pub seen_at: Option<u32>,
}

/// How a frame is treated that sees through more than half of the Gaussians that it can judge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameTrust {
    /// Its pose or its depth is wrong: it removes nothing.
    Alone,
    /// Earlier frames show the same: the map is wrong there.
    Confirmed,
}

/// What taking in a frame did to a map.
#[derive(Clone, Debug, Default)]
pub struct MapUpdate {
    /// Gaussians added.
    pub grown: usize,
    /// Extent of the learning.
    pub learning: LearningExtent,
    /// The Gaussians that were kept, by their index after growth; `None` if all were.
    pub keep: Option<Vec<bool>>,
    /// Whether there were more than `memory.max_gaussians`.
    pub was_full: bool,
    /// How Gaussians hold ids: at least those ids whose hold has changed since the last update. `None` if that takes
    /// long to find out.
    pub holds: Option<Vec<(SegmentId, SegmentHold)>>,
}

impl MapUpdate {
    /// Notes that only some of the Gaussians that were left so far are kept, by their index before that.
    pub fn note_kept(&mut self, keep: Vec<bool>) {
        self.keep = Some(match self.keep.take() {
            None => keep,
            Some(before) => {
                let mut keep = keep.into_iter();
                before.into_iter().map(|kept| kept && keep.next().unwrap_or(true)).collect()
            }
        });
    }
}

/// A copy of a map and of what its Gaussians remember, to be saved.
#[derive(Clone, Copy, Debug)]
pub struct MapContent<'a> {
    /// The Gaussians.
    pub map: &'a SplatMap,
    /// What they remember; `None` for a kind of memory that has no file format.
    pub content: Option<SplatContentView<'a>>,
}

/// A map and what its Gaussians remember.
///
/// For every frame: [`recall`](Self::recall), any number of [`fuse`](Self::fuse), then [`update`](Self::update). `seen` is as in
/// [`SegmentStore`](crate::SegmentStore).
pub trait MapBackend: std::fmt::Debug + Send + Sync {
    /// Renders the map as `camera` sees it and reads which segments `frame` is expected to show.
    ///
    /// # Errors
    /// If the device fails.
    fn recall<'f>(
        &self,
        frame: &'f RgbdFrame<'_>,
        camera: &Camera,
        trust: FrameTrust,
    ) -> Result<Recall<'f>, MemoryError>;

    /// Moves all Gaussians to other coordinates, and what the device keeps of the view: its camera is that of
    /// [`Recall::view`] now.
    ///
    /// # Errors
    /// If the device fails; the map is then not to be used any more.
    fn transform(&mut self, new_from_old: &LocalPose, recall: &mut Recall<'_>) -> Result<(), MemoryError>;

    /// What the frame shows once memory and predictions are brought together.
    ///
    /// # Errors
    /// If the device fails.
    fn fuse(&self, recall: &Recall<'_>, seen: &SegmentMap) -> Result<SegmentMap, MemoryError>;

    /// The Gaussians in view, by increasing index.
    ///
    /// # Errors
    /// If the device fails.
    fn visible_gaussians(&self, recall: &Recall<'_>) -> Result<Vec<VisibleGaussian>, MemoryError>;

    /// Makes some Gaussians surer of a segment than of all others together.
    ///
    /// # Errors
    /// If the device fails.
    fn favour(&mut self, gaussians: &[u32], id: SegmentId) -> Result<(), MemoryError>;

    /// Takes in what frame number `number` shows: adds the Gaussians that the map lacks, learns from `seen`, and removes what
    /// is gone. The map can hold these `ids` only; they increase.
    ///
    /// # Errors
    /// If the device fails; the map is then not to be used any more.
    fn update(
        &mut self,
        recall: &mut Recall<'_>,
        seen: &SegmentMap,
        number: u32,
        ids: &mut dyn Iterator<Item = SegmentId>,
    ) -> Result<MapUpdate, MemoryError>;

    /// Prepares for a segment id that is given to a new thing.
    ///
    /// # Errors
    /// If there is no room for it.
    fn new_segment(&mut self, id: SegmentId) -> Result<(), MemoryError>;

    /// Number of Gaussians.
    fn gaussian_count(&self) -> usize;

    /// Where the Gaussians are, relative to the origin of the map; none if they cannot be read off the device, which is logged.
    fn balls(&self) -> &Balls;

    /// Colours of the Gaussians, sRGB; none if they cannot be read off the device, which is logged.
    fn colors(&self) -> &[[u8; 3]];

    /// Numbers that each Gaussian holds for segments.
    fn numbers_per_gaussian(&self) -> usize;

    /// The segment that each Gaussian shows by itself, 0 for none.
    ///
    /// # Errors
    /// If the device fails.
    fn segment_ids(&self) -> Result<Vec<SegmentId>, MemoryError>;

    /// The share of each of [`segment_ids`](Self::segment_ids) of all that the Gaussian was seen as; `None` if no second
    /// opinion is kept.
    ///
    /// # Errors
    /// If the device fails.
    fn segment_shares(&self) -> Result<Option<Vec<f32>>, MemoryError>;

    /// All that is to be saved.
    ///
    /// # Errors
    /// If the device fails.
    fn content(&self) -> Result<MapContent<'_>, MemoryError>;
}

/// What the Gaussians of a map remember, as a device takes it over.
#[derive(Debug)]
pub enum RememberedSegments {
    /// Of a memory of evidence: one entry per Gaussian.
    Votes(Vec<Votes>),
    /// Of a memory of features.
    Features {
        /// `[gaussians, D]`.
        features: Vec<f32>,
        /// The code of every segment.
        codes: SegmentCodes,
    },
}

/// A device that can take over a map.
pub trait MapDevice: std::fmt::Debug {
    /// Takes a map over, and what its Gaussians remember.
    ///
    /// # Errors
    /// If the device has no room for it, or fails.
    fn take_over(
        &self,
        settings: &MemorySettings,
        map: SplatMap,
        remembered: RememberedSegments,
    ) -> Result<Box<dyn MapBackend>, MemoryError>;
}
