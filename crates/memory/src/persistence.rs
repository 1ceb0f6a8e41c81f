//! A memory on disk: saved after one run, continued in another.

use crate::{MemoryError, MemorySettings, SplatFile, SplatFileError, SplatFileView, SplatMemory};
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
    /// Besides the usual 3DGS properties each Gaussian has its feature and the `segment_id` that it decodes to.
    ///
    /// # Errors
    /// If the file cannot be written. No half file is left.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), SplatFileError> {
        let segment_ids = self.segment_ids();
        let view = SplatFileView {
            gaussians: &self.gaussians,
            colors: &self.colors,
            features: &self.features,
            segment_ids: &segment_ids,
            codebook: &self.codebook,
            used_codes: self.used_codes,
        };
        view.save(path)
    }

    /// Continues a saved memory: the ids in it stay what they are. `settings` are those of the coming run.
    ///
    /// # Errors
    /// If the file is foreign or damaged, or its features do not fit the settings.
    pub fn load(path: impl AsRef<Path>, settings: MemorySettings) -> Result<Self, LoadMemoryError> {
        settings.validate().map_err(MemoryError::from)?;
        let path = path.as_ref();
        let file = SplatFile::load(path)?;
        let found = file.codebook.feature_dim();
        if found != settings.feature_dim {
            let path = path.display().to_string();
            return Err(LoadMemoryError::FeatureDim { path, found, expected: settings.feature_dim });
        }
        Ok(Self {
            settings,
            codebook: file.codebook,
            used_codes: file.used_codes,
            gaussians: file.gaussians,
            colors: file.colors,
            features: file.features,
        })
    }

    /// The segment that each Gaussian's own feature decodes to; 0 where there is none.
    fn segment_ids(&self) -> Vec<u32> {
        let mut hint = None;
        self.features
            .chunks_exact(self.settings.feature_dim)
            .map(|feature| {
                let threshold = self.settings.decode_threshold;
                let code = self.codebook.decode_with_hint(feature, hint, self.used_codes, threshold);
                hint = code.or(hint);
                code.map_or(0, |code| code + 1)
            })
            .collect()
    }
}
