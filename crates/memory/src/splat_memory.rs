//! The memory itself: what it holds and the three things that are asked of it.

use crate::decoding::Decoder;
use crate::growth::new_gaussians;
use crate::learning::{Learning, LearningExtent};
use crate::{Codebook, CodebookError, CodebookSettings, Expectation, MemorySettings, SegmentBelief, SettingsError};
use glam::{Quat, Vec3};
use splatseg_geometry::{RgbdFrame, SegmentId};
use splatseg_render::{Camera, Gaussians, View, ViewTiming};
use std::time::{Duration, Instant};
use thiserror::Error;

/// The largest segment id there can be: results are 16-bit images.
pub const MAX_SEGMENT_ID: SegmentId = u16::MAX as SegmentId;

/// Where a Gaussian that a frame added has at least this alpha, in front of what was there, it and no longer the view
/// made before says what is seen.
const NEW_GAUSSIAN_PREVAILS: f32 = 0.5;

/// An online 3D Gaussian splat whose Gaussians carry segment-id features.
///
/// For every frame: [`SplatMemory::view`] rasterises it, [`SplatMemory::expect`] says which segments should be seen,
/// and [`SplatMemory::learn_frame`] takes in what was seen.
#[derive(Clone, Debug)]
pub struct SplatMemory {
    pub(crate) settings: MemorySettings,
    pub(crate) codebook: Codebook,
    pub(crate) used_codes: usize,
    pub(crate) gaussians: Gaussians,
    /// sRGB in [0, 1].
    pub(crate) colors: Vec<[f32; 3]>,
    /// `[gaussians, D]`.
    pub(crate) features: Vec<f32>,
}

/// What keeps a memory from being made or used.
#[derive(Debug, Error)]
pub enum MemoryError {
    /// A setting is out of range.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// The codebook cannot be made.
    #[error(transparent)]
    Codebook(#[from] CodebookError),
    /// All ids that fit a 16-bit image are used.
    #[error("the video has more than {MAX_SEGMENT_ID} segments, more ids than a 16-bit image can hold")]
    OutOfIds,
    /// A target is not of the frame's size; both are `(width, height)`.
    #[error("the target has {}x{} pixels, expected the frame's {}x{}", found.0, found.1, expected.0, expected.1)]
    TargetSize {
        /// Size of the target.
        found: (usize, usize),
        /// Size of the frame.
        expected: (usize, usize),
    },
    /// A target names a segment that [`SplatMemory::new_segment`] never gave.
    #[error("the target names segment {found}, but only 1 to {known} exist")]
    UnknownSegment {
        /// The id in the target.
        found: SegmentId,
        /// The largest id given so far.
        known: usize,
    },
}

/// What taking in a frame did and how long it took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameUpdate {
    /// Gaussians added.
    pub grown: usize,
    /// Extent of the learning.
    pub learning: LearningExtent,
    /// Time spent choosing and adding Gaussians.
    pub grow_time: Duration,
    /// Time spent on gradient steps.
    pub learn_time: Duration,
    /// Time spent on the frame's view, first and after growth.
    pub view_time: ViewTiming,
}

impl SplatMemory {
    /// An empty memory. Making the codebook takes up to a few seconds; `progress` is told the fraction done.
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn new(settings: MemorySettings, seed: u64, progress: &mut dyn FnMut(f32)) -> Result<Self, MemoryError> {
        settings.validate()?;
        let codebook_settings =
            CodebookSettings { num_codes: settings.num_codes, feature_dim: settings.feature_dim, seed };
        let codebook = Codebook::generate(&codebook_settings, progress)?;
        Ok(Self {
            settings,
            codebook,
            used_codes: 0,
            gaussians: Gaussians::default(),
            colors: Vec::new(),
            features: Vec::new(),
        })
    }

    /// The memory as `frame`'s camera sees it.
    pub fn view(&self, frame: &RgbdFrame) -> View {
        View::new(&self.gaussians, &Camera::new(*frame.intrinsics(), frame.world_from_camera()))
    }

    /// The segments that the memory expects in a view.
    pub fn expect(&self, view: &View) -> Expectation {
        let decoder = Decoder {
            codebook: &self.codebook,
            used_codes: self.used_codes,
            threshold: self.settings.decode_threshold,
        };
        decoder.expect(view.weights(), &self.features)
    }

    /// A code, and so an id, that no segment has had yet. When the codes run out, a block of new ones is made.
    ///
    /// # Errors
    /// [`MemoryError::OutOfIds`] if the id would not fit a 16-bit image.
    pub fn new_segment(&mut self) -> Result<SegmentId, MemoryError> {
        if self.used_codes >= MAX_SEGMENT_ID as usize {
            return Err(MemoryError::OutOfIds);
        }
        if self.used_codes == self.codebook.len() {
            tracing::info!("all {} codes are used: making {} more", self.codebook.len(), self.settings.num_codes);
            self.codebook.extend(self.settings.num_codes, &mut |_| {})?;
        }
        self.used_codes += 1;
        Ok(self.used_codes as SegmentId)
    }

    /// Grows by what `frame` shows and the memory lacks, then learns to show `target` from the frame's pose.
    ///
    /// `view` and `expectation` are those of this frame, before the update.
    ///
    /// # Errors
    /// If `target` has another size than the frame or names a segment that does not exist.
    pub fn learn_frame(
        &mut self,
        frame: &RgbdFrame,
        mut view: View,
        expectation: &Expectation,
        target: &SegmentBelief,
    ) -> Result<FrameUpdate, MemoryError> {
        self.check_target(frame, target)?;
        let started = Instant::now();
        let grown = self.grow(frame, expectation, target);
        let grow_time = started.elapsed();
        let touched = view.pixels_touched_since(&self.gaussians, &expectation.depth, NEW_GAUSSIAN_PREVAILS);
        let started = Instant::now();
        let learning = Learning { settings: &self.settings, codebook: &self.codebook, expectation, target };
        let chosen = learning.active_pixels(&touched);
        let choose_time = started.elapsed();
        let active = view.active_weights(&chosen, self.settings.learning_min_weight);
        let started = Instant::now();
        let extent = learning.descend(&active, &mut self.features);
        let learn_time = choose_time + started.elapsed();
        Ok(FrameUpdate { grown, learning: extent, grow_time, learn_time, view_time: view.timing() })
    }

    fn check_target(&self, frame: &RgbdFrame, target: &SegmentBelief) -> Result<(), MemoryError> {
        let expected = (frame.width(), frame.height());
        for found in [target.segments.size(), target.confidence.size()] {
            if found != expected {
                return Err(MemoryError::TargetSize { found, expected });
            }
        }
        let largest = target.segments.pixels().iter().copied().max().unwrap_or(0);
        if largest as usize > self.used_codes {
            return Err(MemoryError::UnknownSegment { found: largest, known: self.used_codes });
        }
        Ok(())
    }

    fn grow(&mut self, frame: &RgbdFrame, expectation: &Expectation, target: &SegmentBelief) -> usize {
        let feature_dim = self.settings.feature_dim;
        let added = new_gaussians(frame, expectation, &self.settings);
        for gaussian in &added {
            self.gaussians.push(gaussian.mean, Quat::IDENTITY, Vec3::splat(gaussian.scale), 1.0);
            self.colors.push(gaussian.color);
            match target.segments.pixels()[gaussian.pixel] {
                0 => self.features.resize(self.features.len() + feature_dim, 0.0),
                segment => {
                    let confidence = if feature_dim == 1 { 1.0 } else { target.confidence.pixels()[gaussian.pixel] };
                    let code = self.codebook.vector(segment as usize - 1);
                    self.features.extend(code.iter().map(|value| confidence * value));
                }
            }
        }
        added.len()
    }

    /// The settings it was made with.
    pub fn settings(&self) -> &MemorySettings {
        &self.settings
    }

    /// Number of Gaussians.
    pub fn gaussian_count(&self) -> usize {
        self.gaussians.len()
    }

    /// Number of ids given so far: ids are 1 to this.
    pub fn segment_count(&self) -> usize {
        self.used_codes
    }

    /// Numbers that the Gaussians hold: position 3, orientation 4, scale 3, opacity 1, colour 3, feature D each.
    pub fn parameter_count(&self) -> usize {
        self.gaussians.len() * (3 + 4 + 3 + 1 + 3 + self.settings.feature_dim)
    }

    /// The Gaussians' geometry, world coordinates.
    pub fn gaussians(&self) -> &Gaussians {
        &self.gaussians
    }

    /// Colours of the Gaussians, sRGB in [0, 1].
    pub fn colors(&self) -> &[[f32; 3]] {
        &self.colors
    }

    /// Segment-id features, `[gaussians, D]`.
    pub fn features(&self) -> &[f32] {
        &self.features
    }

    /// The code of every segment.
    pub fn codebook(&self) -> &Codebook {
        &self.codebook
    }
}
