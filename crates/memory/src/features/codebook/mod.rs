//! The codebook: unit vectors in R^D that stand for segments, pushed apart as far as possible.

mod cache;
mod decode;
mod repulsion;
mod spacing;

pub(crate) use cache::CodebookCache;

use cache::BlockKey;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use spacing::Spacing;
use splatseg_kernels::inner_products::Panels;
use std::sync::OnceLock;
use thiserror::Error;

/// Maximum dimension of the features.
const MAX_FEATURE_DIM: usize = 1 << 16;
/// Maximum `num_codes * feature_dim`: 1 GiB of `f32`.
const MAX_VALUES: usize = 1 << 28;
/// Largest id that an `f32` feature can tell from its neighbours.
const MAX_INTEGER_CODES: usize = 1 << 24;
/// Codebooks up to this size measure their spacing when they are created, in well under a second.
const MAX_EAGER_SPACING: usize = 1 << 14;

/// Settings of a [`Codebook`].
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CodebookSettings {
    /// Number of codes N: the number of segments before the codebook has to be extended. Default 512.
    pub num_codes: usize,
    /// Dimension D of codes and features; 1 stands for integer ids. Default 28, as in the paper.
    pub feature_dim: usize,
    /// Seed of the random initial codes. Default 0.
    pub seed: u64,
}

impl Default for CodebookSettings {
    fn default() -> Self {
        Self { num_codes: 512, feature_dim: 28, seed: 0 }
    }
}

/// An error creating a codebook.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum CodebookError {
    /// The codebook would have no codes.
    #[error("num_codes is 0, but a codebook needs at least 1 code")]
    NoCodes,
    /// The dimension is zero or too large.
    #[error("feature_dim is {found}, expected 1 to {MAX_FEATURE_DIM}")]
    FeatureDim {
        /// The requested dimension.
        found: usize,
    },
    /// There would be more codes than fit in memory, or than an `f32` can count if `feature_dim` is 1.
    #[error("num_codes is {found}, but a codebook with feature_dim {feature_dim} has at most {max} codes")]
    TooManyCodes {
        /// The requested number of codes, in all blocks together.
        found: usize,
        /// The maximum number of codes.
        max: usize,
        /// The dimension of the codes.
        feature_dim: usize,
    },
    /// The number of values is not a multiple of the dimension.
    #[error("the codebook has {found} values, which is not a whole number of vectors of feature_dim {feature_dim}")]
    RaggedVectors {
        /// Number of values.
        found: usize,
        /// Dimension.
        feature_dim: usize,
    },
    /// A code is not a unit vector or, if `feature_dim` is 1, not its id.
    #[error("code {index} of the codebook {problem}")]
    BadVector {
        /// Index of the code.
        index: usize,
        /// Found and expected value, as the end of a sentence.
        problem: String,
    },
}

/// N codes in R^D; code `index` belongs to segment id `index + 1`.
///
/// A feature's direction is a segment, its magnitude the confidence. With D ≥ 2, codes are unit vectors. With D = 1,
/// the code of a segment is its id, `[(index + 1) as f32]`.
///
/// Equal settings and equal extensions give equal bytes, on every platform and with any number of threads.
#[derive(Clone, Debug)]
pub struct Codebook {
    feature_dim: usize,
    /// Row-major `[N, D]`.
    vectors: Vec<f32>,
    /// The same vectors in panels for decoding: `[ceil(N / LANES), D]`.
    columns: Panels,
    seed: u64,
    /// Number of blocks of codes: 1, and 1 more per extension.
    blocks: u32,
    spacing: OnceLock<Spacing>,
}

impl PartialEq for Codebook {
    fn eq(&self, other: &Self) -> bool {
        let key = |codebook: &Self| (codebook.feature_dim, codebook.seed, codebook.blocks);
        key(self) == key(other) && self.vectors == other.vectors
    }
}

impl Codebook {
    /// Generates random codes and pushes them apart, which approaches the paper's objective −min ‖c_i − c_j‖ through
    /// energies of growing exponent. `progress` receives the fraction done, up to 1, on the calling thread.
    ///
    /// Takes about 0.25 s for 512 codes of 28 dimensions on two cores; their smallest distance is 1.22 (random codes:
    /// 0.7). From about 1,200 codes on there are fewer steps, to stay near 1 s; above about 24,000 there are none.
    ///
    /// # Errors
    /// [`CodebookError`] if there are no codes, no dimensions, or too many of either.
    pub fn generate(settings: &CodebookSettings, progress: &mut dyn FnMut(f32)) -> Result<Self, CodebookError> {
        Self::generate_cached(settings, &CodebookCache::default(), progress)
    }

    /// As [`Codebook::generate`], with a cache of codes.
    pub(crate) fn generate_cached(
        settings: &CodebookSettings,
        cache: &CodebookCache,
        progress: &mut dyn FnMut(f32),
    ) -> Result<Self, CodebookError> {
        let CodebookSettings { num_codes, feature_dim, seed } = *settings;
        if !(1..=MAX_FEATURE_DIM).contains(&feature_dim) {
            return Err(CodebookError::FeatureDim { found: feature_dim });
        }
        let mut vectors = Vec::new();
        let block = NewBlock { feature_dim, count: num_codes, seed, block: 0 };
        block.append(&mut vectors, cache, progress)?;
        Ok(Self::assemble(feature_dim, vectors, seed, 1))
    }

    /// Adds a block of codes, pushed away from each other and from the existing codes, which do not change.
    ///
    /// # Errors
    /// [`CodebookError`] if `additional` is zero or too large; the codebook is then unchanged.
    pub fn extend(&mut self, additional: usize, progress: &mut dyn FnMut(f32)) -> Result<(), CodebookError> {
        self.extend_cached(additional, &CodebookCache::default(), progress)
    }

    /// As [`Codebook::extend`], with a cache of codes.
    pub(crate) fn extend_cached(
        &mut self,
        additional: usize,
        cache: &CodebookCache,
        progress: &mut dyn FnMut(f32),
    ) -> Result<(), CodebookError> {
        let mut vectors = self.vectors.clone();
        let (feature_dim, seed) = (self.feature_dim, self.seed);
        let block = NewBlock { feature_dim, count: additional, seed, block: self.blocks };
        block.append(&mut vectors, cache, progress)?;
        *self = Self::assemble(self.feature_dim, vectors, self.seed, self.blocks.saturating_add(1));
        Ok(())
    }

    /// Creates a codebook from `vectors` `[N, D]` that were generated from `seed` in `blocks` blocks.
    ///
    /// # Errors
    /// [`CodebookError`] if the sizes are invalid, or a vector cannot come from [`Codebook::generate`].
    pub(crate) fn from_vectors(
        feature_dim: usize,
        vectors: Vec<f32>,
        seed: u64,
        blocks: u32,
    ) -> Result<Self, CodebookError> {
        if !(1..=MAX_FEATURE_DIM).contains(&feature_dim) {
            return Err(CodebookError::FeatureDim { found: feature_dim });
        }
        if !vectors.len().is_multiple_of(feature_dim) {
            return Err(CodebookError::RaggedVectors { found: vectors.len(), feature_dim });
        }
        check_count(vectors.len() / feature_dim, feature_dim)?;
        for (index, vector) in vectors.chunks_exact(feature_dim).enumerate() {
            check_vector(index, vector)?;
        }
        Ok(Self::assemble(feature_dim, vectors, seed, blocks))
    }

    fn assemble(feature_dim: usize, vectors: Vec<f32>, seed: u64, blocks: u32) -> Self {
        let columns = Panels::from_vectors(&vectors, feature_dim);
        let codebook = Self { feature_dim, vectors, columns, seed, blocks, spacing: OnceLock::new() };
        if codebook.len() <= MAX_EAGER_SPACING {
            codebook.spacing();
        }
        codebook
    }

    /// Maximum number of codes of a codebook with this dimension.
    pub fn max_len(feature_dim: usize) -> usize {
        if feature_dim == 1 { MAX_INTEGER_CODES } else { MAX_VALUES / feature_dim.max(1) }
    }

    /// Number of codes N.
    pub fn len(&self) -> usize {
        self.vectors.len() / self.feature_dim
    }

    /// Always false: a codebook has at least one code.
    pub fn is_empty(&self) -> bool {
        self.vectors.is_empty()
    }

    /// Dimension D of codes and features.
    pub fn feature_dim(&self) -> usize {
        self.feature_dim
    }

    /// Seed of the codes.
    pub fn seed(&self) -> u64 {
        self.seed
    }

    /// Number of blocks of codes: 1, and 1 more per extension.
    pub fn blocks(&self) -> u32 {
        self.blocks
    }

    /// All codes, row-major `[N, D]`.
    pub fn vectors(&self) -> &[f32] {
        &self.vectors
    }

    /// The code of segment `index + 1`, `[D]`.
    ///
    /// # Panics
    /// If `index` is not below [`Codebook::len`].
    pub fn vector(&self, index: usize) -> &[f32] {
        &self.vectors[index * self.feature_dim..][..self.feature_dim]
    }

    /// Smallest distance of two codes: 1 for integer ids, infinite in a codebook of one code.
    ///
    /// Precomputed up to 16,384 codes. Beyond, the first call of this or of [`Codebook::max_coherence`] takes O(N² D),
    /// and later calls take constant time.
    pub fn min_distance(&self) -> f32 {
        self.spacing().min_distance
    }

    /// Largest inner product of two different unit vectors, −1 in a codebook of one code. Integer ids have no
    /// directions: 1. Takes as long as [`Codebook::min_distance`].
    pub fn max_coherence(&self) -> f32 {
        self.spacing().max_coherence
    }

    fn spacing(&self) -> &Spacing {
        self.spacing.get_or_init(|| match self.feature_dim {
            1 => Spacing::from_integers(self.len()),
            dim => Spacing::measure(&self.vectors, dim),
        })
    }
}

/// A block of codes to be generated.
struct NewBlock {
    feature_dim: usize,
    /// Number of codes in the block.
    count: usize,
    seed: u64,
    /// Index of the block. Each block has its own random numbers.
    block: u32,
}

impl NewBlock {
    /// Appends the codes to those of the earlier blocks.
    fn append(
        &self,
        vectors: &mut Vec<f32>,
        cache: &CodebookCache,
        progress: &mut dyn FnMut(f32),
    ) -> Result<(), CodebookError> {
        let Self { feature_dim, count, seed, block } = *self;
        if count == 0 {
            return Err(CodebookError::NoCodes);
        }
        let first = vectors.len() / feature_dim;
        let all = first.saturating_add(count);
        check_count(all, feature_dim)?;
        if feature_dim == 1 {
            vectors.extend((first..all).map(|index| (index + 1) as f32));
        } else if let Some(codes) = cache.load(&BlockKey { earlier: vectors, feature_dim, count, seed, block }) {
            vectors.extend(codes);
        } else {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            random.set_stream(u64::from(block));
            vectors.extend((0..count * feature_dim).map(|_| bell(random.next_u64())));
            vectors[first * feature_dim..].chunks_exact_mut(feature_dim).for_each(repulsion::normalize);
            repulsion::spread(vectors, feature_dim, first, progress);
            let (earlier, codes) = vectors.split_at(first * feature_dim);
            cache.store(&BlockKey { earlier, feature_dim, count, seed, block }, codes);
        }
        progress(1.0);
        Ok(())
    }
}

/// Returns a nearly normal number, symmetric about zero: the sum of four uniform numbers. This avoids logarithm and
/// cosine, whose last bits differ between platforms. Directions are nearly uniform, which is enough for initial codes.
fn bell(bits: u64) -> f32 {
    let sum: i32 = (0..4).map(|part| ((bits >> (16 * part)) & 0xffff) as i32).sum();
    (2 * sum - 4 * 0xffff) as f32
}

fn check_count(count: usize, feature_dim: usize) -> Result<(), CodebookError> {
    let max = Codebook::max_len(feature_dim);
    match count {
        0 => Err(CodebookError::NoCodes),
        count if count > max => Err(CodebookError::TooManyCodes { found: count, max, feature_dim }),
        _ => Ok(()),
    }
}

fn check_vector(index: usize, vector: &[f32]) -> Result<(), CodebookError> {
    if let [id] = *vector {
        let expected = (index + 1) as f32;
        let problem = || format!("is {id}, expected its id {expected} with feature_dim 1");
        return if id == expected { Ok(()) } else { Err(CodebookError::BadVector { index, problem: problem() }) };
    }
    let norm = vector.iter().map(|&value| f64::from(value) * f64::from(value)).sum::<f64>().sqrt();
    // NaN fails this comparison.
    if (norm - 1.0).abs() <= f64::from(decode::rounding(vector.len())) {
        return Ok(());
    }
    Err(CodebookError::BadVector { index, problem: format!("has length {norm}, expected a unit vector") })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codebooks_are_equal_if_their_vectors_seeds_and_blocks_are() {
        let codebook =
            |vectors: [f32; 4], seed, blocks| Codebook::from_vectors(2, vectors.to_vec(), seed, blocks).unwrap();
        let one = codebook([1.0, 0.0, 0.0, 1.0], 3, 1);
        assert_eq!(one, codebook([1.0, 0.0, 0.0, 1.0], 3, 1));
        assert_ne!(one, codebook([0.0, 1.0, 1.0, 0.0], 3, 1));
        assert_ne!(one, codebook([1.0, 0.0, 0.0, 1.0], 4, 1));
        assert_ne!(one, codebook([1.0, 0.0, 0.0, 1.0], 3, 2));
    }

    #[test]
    fn vectors_have_length_1_up_to_rounding() {
        let with_length = |length: f32| Codebook::from_vectors(2, vec![length, 0.0, 0.0, 1.0], 0, 1);
        assert!(with_length(1.0 + 5e-7).is_ok());
        for length in [1.0 + 1e-5, 1.0 - 1e-5, 0.5, 0.0, f32::NAN] {
            assert!(matches!(with_length(length), Err(CodebookError::BadVector { index: 0, .. })), "{length}");
        }
    }

    #[test]
    fn vectors_may_be_as_long_as_there_is_room_for() {
        let mut vectors = vec![0.0; 2 << 14];
        (vectors[0], vectors[(1 << 14) + 1]) = (1.0, 1.0);
        assert_eq!(Codebook::from_vectors(1 << 14, vectors, 0, 1).unwrap().len(), 2);
        assert!(matches!(Codebook::from_vectors(2, vec![], 0, 1), Err(CodebookError::NoCodes)));
    }
}
