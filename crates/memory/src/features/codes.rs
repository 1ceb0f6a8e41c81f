//! Codes of the segments, including codes prepared for later segments.

use super::codebook::CodebookCache;
use super::extension::Extension;
use crate::{Codebook, MemoryError, MemorySettings};
use splatseg_geometry::SegmentId;

/// Further codes are generated in the background once this fraction of the codes is used.
const EXTEND_AT_FRACTION: f32 = 0.75;

/// The codebook of a memory of features, which grows as segments are added.
#[derive(Debug)]
pub struct SegmentCodes {
    codebook: Codebook,
    /// Number of codes assigned to segments, from the first on.
    used: usize,
    /// Number of codes added at a time.
    block: usize,
    cache: CodebookCache,
    /// The next codes, if they are needed soon.
    extension: Option<Extension>,
}

impl SegmentCodes {
    /// Creates the codes from a codebook whose first `used` codes belong to segments.
    pub(crate) fn new(settings: &MemorySettings, codebook: Codebook, used: usize, cache: CodebookCache) -> Self {
        Self { codebook, used, block: settings.num_codes, cache, extension: None }
    }

    /// As [`Self::new`], with the user's cache for further codes.
    pub(crate) fn of_user(settings: &MemorySettings, codebook: Codebook, used: usize) -> Self {
        Self::new(settings, codebook, used, CodebookCache::of_user())
    }

    /// The codes.
    pub fn codebook(&self) -> &Codebook {
        &self.codebook
    }

    /// Number of codes assigned to segments, from the first on. The others cannot occur.
    pub fn used(&self) -> usize {
        self.used
    }

    /// Prepares a code for a segment id, adding a block of codes if there are too few.
    ///
    /// # Errors
    /// If there is no room for more codes.
    pub fn new_segment(&mut self, id: SegmentId) -> Result<(), MemoryError> {
        if id as usize > self.codebook.len() {
            self.extend()?;
        }
        self.used = self.used.max(id as usize);
        let used_fraction = self.used as f32 / self.codebook.len() as f32;
        // Integer ids take no time.
        if self.extension.is_none() && self.codebook.feature_dim() > 1 && used_fraction >= EXTEND_AT_FRACTION {
            self.extension = Extension::start(&self.codebook, self.block, &self.cache);
        }
        Ok(())
    }

    /// Adds a block of codes, waiting for the background thread if necessary.
    fn extend(&mut self) -> Result<(), MemoryError> {
        let additional = self.block;
        tracing::info!("all {} codes are used: adding {additional}", self.codebook.len());
        match self.extension.take().and_then(Extension::finish) {
            Some(extended) => self.codebook = extended?,
            None => self.codebook.extend_cached(additional, &self.cache, &mut |_| {})?,
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::CodebookSettings;

    #[test]
    fn the_next_codes_are_made_before_they_are_needed_and_are_the_same() {
        let settings = MemorySettings { feature_dim: 7, num_codes: 40, ..MemorySettings::default() };
        let codebook = |extensions: usize| {
            let mut codebook =
                Codebook::generate(&CodebookSettings { num_codes: 40, feature_dim: 7, seed: 3 }, &mut |_| {}).unwrap();
            (0..extensions).for_each(|_| codebook.extend(40, &mut |_| {}).unwrap());
            codebook
        };
        let mut codes = SegmentCodes::new(&settings, codebook(0), 0, CodebookCache::default());
        for id in 1..=29 {
            codes.new_segment(id).unwrap();
        }
        assert!(codes.extension.is_none());
        codes.new_segment(30).unwrap();
        let started = codes.extension.as_ref().expect("three quarters of the codes are used");
        while !started.is_finished() {
            std::thread::yield_now();
        }
        for id in 31..=40 {
            codes.new_segment(id).unwrap();
        }
        assert_eq!(codes.codebook, codebook(0), "codes that are not needed are not in the codebook yet");
        codes.new_segment(41).unwrap();
        assert_eq!(codes.codebook, codebook(1));
        // Without a pause the thread is waited for, with the same result.
        for id in 42..=81 {
            codes.new_segment(id).unwrap();
        }
        assert_eq!(codes.codebook, codebook(2));
    }
}
