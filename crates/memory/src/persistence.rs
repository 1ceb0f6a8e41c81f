//! A memory on disk: saved after one run, continued in another.

use crate::backend::MapContent;
use crate::depthless::DepthlessSegments;
use crate::evidence::EvidenceStore;
use crate::features::{FeatureStore, SegmentCodes};
use crate::recent::RecentFrames;
use crate::recurring::RecurringPredictions;
use crate::segment_store::SegmentStore;
use crate::segments::{SavedSegment, Segments};
use crate::short_term::ShortTermMemory;
use crate::splat_memory::largest_id;
use crate::{MemoryError, MemorySettings, SplatContent, SplatFile, SplatFileError, SplatFileView, SplatMemory};
use splatseg_geometry::SegmentId;
use std::path::Path;
use thiserror::Error;

/// A memory that cannot be continued.
#[derive(Debug, Error)]
pub enum LoadMemoryError {
    /// The file is none of ours, or damaged.
    #[error(transparent)]
    File(#[from] SplatFileError),
    /// A setting is out of range.
    #[error(transparent)]
    Settings(#[from] MemoryError),
    /// The file holds another kind of memory than the settings ask for.
    #[error("{path}: a memory of the kind {found:?}, but memory.kind is {expected:?}")]
    Kind {
        /// The file.
        path: String,
        /// Kind of the file.
        found: &'static str,
        /// Kind in the settings.
        expected: &'static str,
    },
    /// What the file holds besides its Gaussians cannot be.
    #[error("{path}: what is saved besides the Gaussians: {found}")]
    ShortTerm {
        /// The file.
        path: String,
        /// What is wrong with it.
        found: String,
    },
    /// The file's features have another length than the settings ask for.
    #[error("{path}: its features have {found} channels, but memory.feature_dim is {expected}")]
    FeatureDim {
        /// The file.
        path: String,
        /// Channels in the file.
        found: usize,
        /// Channels in the settings.
        expected: usize,
    },
}

impl SplatMemory {
    /// Writes the memory to one PLY file that splat viewers open; whatever is at `path` is replaced.
    ///
    /// Besides the usual 3DGS properties each Gaussian has what it remembers of segments, and the `segment_id` that it
    /// shows by itself.
    ///
    /// # Errors
    /// If the file cannot be written, or the memory is of a kind that has no file format. No half file is left.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), SplatFileError> {
        let no_format = || SplatFileError::NoFormat { path: path.as_ref().to_owned() };
        let failed = |source| SplatFileError::Device { path: path.as_ref().to_owned(), source: Box::new(source) };
        let MapContent { map, content } = self.backend.content().map_err(failed)?;
        let content = content.ok_or_else(no_format)?;
        let segment_ids = self.segment_ids();
        let live = self.segments.saved_live();
        let ids: Vec<SegmentId> = live.iter().map(|segment| segment.id).collect();
        let sightings: Vec<u32> = live.iter().map(|segment| segment.sightings).collect();
        let carried: Vec<bool> = live.iter().map(|segment| segment.carried).collect();
        let short_term = ShortTermMemory {
            overruled: self.overruled.clone(),
            appearances: self.appearances.clone(),
            recurring: self.recurring.saved(),
            depthless: self.depthless.saved(),
            ids: self.segments.saved_ids(),
            recent: self.recent.saved(),
        };
        let view = SplatFileView {
            origin: self.origin,
            map,
            content,
            segment_ids: &segment_ids,
            ids: &ids,
            sightings: &sightings,
            carried: &carried,
            frames: self.frames,
            short_term: &short_term.to_bytes(),
        };
        view.save(path.as_ref())
    }

    /// Continues a saved memory as if the run had not ended: the ids in it stay what they are. `settings` are those of
    /// the coming run.
    ///
    /// # Errors
    /// If the file is foreign or damaged, holds another kind of memory, or its features do not fit the settings.
    pub fn load(path: impl AsRef<Path>, settings: MemorySettings) -> Result<Self, LoadMemoryError> {
        settings.validate().map_err(MemoryError::from)?;
        let path = path.as_ref();
        let SplatFile { origin, map, content, ids, sightings, carried, frames, short_term, segment_ids: _ } =
            SplatFile::load(path)?;
        let live = ids.into_iter().zip(sightings).zip(carried);
        let live: Vec<SavedSegment> =
            live.map(|((id, sightings), carried)| SavedSegment { id, sightings, carried }).collect();
        let restored = ShortTermMemory::from_bytes(&short_term).and_then(|saved| {
            let segments = Segments::restored(&live, saved.ids.clone(), largest_id(&settings))?;
            saved.check_ids(segments.highest())?;
            let recurring = RecurringPredictions::restored(saved.recurring, map.len())?;
            let depthless = DepthlessSegments::restored(saved.depthless, segments.highest(), frames)?;
            let recent = RecentFrames::restored(saved.recent, segments.highest())?;
            Ok((segments, saved.overruled, saved.appearances, recurring, depthless, recent))
        });
        let damaged = |found| LoadMemoryError::ShortTerm { path: path.display().to_string(), found };
        let (segments, overruled, appearances, recurring, depthless, recent) = restored.map_err(damaged)?;
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
        (memory.overruled, memory.appearances) = (overruled, appearances);
        (memory.recurring, memory.depthless, memory.recent) = (recurring, depthless, recent);
        Ok(memory)
    }
}
