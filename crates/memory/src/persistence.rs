//! Saving a memory after one run and continuing it in another.

use crate::co_visible::CoVisibleIds;
use crate::evidence::EvidenceStore;
use crate::features::{FeatureStore, SegmentCodes};
use crate::recent::RecentFrames;
use crate::saved_state::{SavedState, restored_runs, runs};
use crate::segment_store::SegmentStore;
use crate::segments::{SavedSegment, Segments};
use crate::{
    MemoryError, MemoryKind, MemoryRules, MemorySettings, SplatContent, SplatFile, SplatFileError, SplatFileView,
    SplatMemory,
};
use splatseg_geometry::{SegmentId, SurfaceKind};
use std::path::Path;
use thiserror::Error;

/// An error loading a saved memory.
#[derive(Debug, Error)]
pub enum LoadMemoryError {
    /// The file is damaged or not a splatseg memory.
    #[error(transparent)]
    File(#[from] SplatFileError),
    /// A setting is out of range.
    #[error(transparent)]
    Settings(#[from] MemoryError),
    /// The file contains a memory of another kind than the settings.
    #[error("{path}: the memory has the kind {found:?}, but memory.kind is {expected:?}")]
    Kind {
        /// The file.
        path: String,
        /// Kind of the file.
        found: &'static str,
        /// Kind in the settings.
        expected: &'static str,
    },
    /// The state that the file contains besides its Gaussians is invalid.
    #[error("{path}: invalid state besides the Gaussians: {found}")]
    SavedState {
        /// The file.
        path: String,
        /// The problem.
        found: String,
    },
    /// The file's features have another dimension than the settings.
    #[error("{path}: the features have {found} channels, but memory.feature_dim is {expected}")]
    FeatureDim {
        /// The file.
        path: String,
        /// Channels in the file.
        found: usize,
        /// Channels in the settings.
        expected: usize,
    },
}

/// State of other parts of a pipeline about a map, saved with it: UTF-8 text that only they can read.
#[derive(Clone, Copy, Debug, Default)]
pub struct Attached<'a> {
    /// The camera's keyframes; [`SplatMemory::take_keyframes`] returns them after loading.
    pub keyframes: Option<&'a [u8]>,
    /// The names of objects; [`SplatMemory::take_names`] returns them after loading.
    pub names: Option<&'a [u8]>,
}

impl SplatMemory {
    /// Writes the memory to a PLY file that splat viewers open, replacing any file at `path`.
    ///
    /// Besides the usual 3DGS properties, each Gaussian has its votes or feature and the `segment_id` that it shows by
    /// itself.
    ///
    /// # Errors
    /// If the file cannot be written, the kind of memory has no file format, or a part is larger than [`Self::load`] reads.
    /// No partial file is left.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), SplatFileError> {
        self.save_with(path, Attached::default())
    }

    /// As [`Self::save`], with what other parts of a pipeline know about the map.
    ///
    /// # Errors
    /// As [`Self::save`].
    pub fn save_with(&self, path: impl AsRef<Path>, attached: Attached<'_>) -> Result<(), SplatFileError> {
        let no_format = || SplatFileError::NoFormat { path: path.as_ref().to_owned() };
        let content = self.store.content().ok_or_else(no_format)?;
        let segment_ids = self.store.segment_ids();
        let live = self.segments.saved_live();
        let ids: Vec<SegmentId> = live.iter().map(|segment| segment.id).collect();
        let sightings: Vec<u32> = live.iter().map(|segment| segment.sightings).collect();
        let carried: Vec<bool> = live.iter().map(|segment| segment.carried).collect();
        let is_observed = self.map.surfaces.iter().all(|surface| *surface == SurfaceKind::Observed);
        let (together, crowded) = self.co_visible.saved();
        let saved_state = SavedState {
            ids: self.segments.saved_ids(),
            recent: self.recent.saved(),
            anchors: runs(&self.map.anchors),
            surfaces: if is_observed { Vec::new() } else { runs(&self.map.surfaces) },
            together,
            crowded,
            remapped: self.remapped.iter().map(|(from, into)| (*from, *into)).collect(),
            keyframes: text(attached.keyframes),
            names: text(attached.names),
        };
        let saved_state = saved_state.to_bytes();
        let view = SplatFileView {
            origin: self.origin,
            map: &self.map,
            content,
            segment_ids: &segment_ids,
            ids: &ids,
            sightings: &sightings,
            carried: &carried,
            frames: self.frames,
            saved_state: &saved_state,
        };
        view.save(path.as_ref())
    }

    /// Loads a saved memory, to continue as if the run had not ended. Ids keep their meaning. `settings` are the
    /// settings of the new run.
    ///
    /// # Errors
    /// If the file is damaged or not a splatseg memory, or its kind or feature dimension differs from the settings.
    pub fn load(path: impl AsRef<Path>, settings: MemorySettings) -> Result<Self, LoadMemoryError> {
        settings.validate().map_err(MemoryError::from)?;
        let path = path.as_ref();
        let SplatFile { origin, mut map, content, ids, sightings, carried, frames, saved_state, segment_ids: _ } =
            SplatFile::load(path)?;
        let live = ids.into_iter().zip(sightings).zip(carried);
        let live: Vec<SavedSegment> =
            live.map(|((id, sightings), carried)| SavedSegment { id, sightings, carried }).collect();
        let largest_id = match settings.kind {
            MemoryKind::Evidence => MemoryRules::default().largest_id,
            MemoryKind::Features => FeatureStore::rules_of(&settings).largest_id,
        };
        let restored = SavedState::from_bytes(&saved_state).and_then(|saved| {
            let segments = Segments::restored(&live, saved.ids.clone(), largest_id)?;
            let recent = RecentFrames::restored(saved.recent, segments.highest())?;
            map.anchors = restored_runs("keyframes", &saved.anchors, map.len(), 0)?;
            map.surfaces = restored_runs("surfaces", &saved.surfaces, map.len(), SurfaceKind::Observed)?;
            let together = CoVisibleIds::restored((saved.together, saved.crowded));
            Ok((segments, recent, together, saved.remapped, (saved.keyframes, saved.names)))
        });
        let damaged = |found| LoadMemoryError::SavedState { path: path.display().to_string(), found };
        let (segments, recent, together, remapped, (keyframes, names)) = restored.map_err(damaged)?;
        let (path, found, expected) = (path.display().to_string(), content.kind(), settings.kind);
        if found != expected {
            return Err(LoadMemoryError::Kind { path, found: found.name(), expected: expected.name() });
        }
        let store: Box<dyn SegmentStore> = match content {
            SplatContent::Evidence { votes } => Box::new(EvidenceStore::restored(settings.clone(), votes)),
            SplatContent::Features { features, codebook } => {
                let (found, expected) = (codebook.feature_dim(), settings.feature_dim);
                if found != expected {
                    return Err(LoadMemoryError::FeatureDim { path, found, expected });
                }
                let codes = SegmentCodes::of_user(&settings, codebook, segments.highest() as usize);
                Box::new(FeatureStore::restored(settings.clone(), codes, features))
            }
        };
        let mut memory = Self::with_parts(settings, map, store, segments);
        (memory.frames, memory.origin) = (frames, origin);
        (memory.recent, memory.co_visible) = (recent, together);
        memory.remapped = remapped.into_iter().collect();
        memory.keyframes = (!keyframes.is_empty()).then(|| keyframes.into_bytes());
        memory.names = (!names.is_empty()).then(|| names.into_bytes());
        Ok(memory)
    }

    /// The camera's keyframes that a loaded file contains; `None` if there are none, or they were taken already.
    pub fn take_keyframes(&mut self) -> Option<Vec<u8>> {
        self.keyframes.take()
    }

    /// The names of objects that a loaded file contains; `None` if there are none, or they were taken already.
    pub fn take_names(&mut self) -> Option<Vec<u8>> {
        self.names.take()
    }
}

fn text(bytes: Option<&[u8]>) -> String {
    bytes.map_or_else(String::new, |bytes| String::from_utf8_lossy(bytes).into_owned())
}
