//! Vectors aligned to cache lines.

use bytemuck::{Pod, Zeroable};
use std::ops::{Deref, DerefMut};

/// One cache line.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C, align(64))]
struct CacheLine([f32; 16]);

/// A fixed-length vector of `f32` aligned to a cache line, so that rows of 16 or 32 values never touch more lines than
/// they need.
#[derive(Clone, Debug, PartialEq)]
pub struct AlignedVec {
    lines: Vec<CacheLine>,
    length: usize,
}

impl AlignedVec {
    /// `length` zeros.
    pub fn zeros(length: usize) -> Self {
        Self { lines: vec![CacheLine::zeroed(); length.div_ceil(16)], length }
    }
}

impl From<&[f32]> for AlignedVec {
    fn from(values: &[f32]) -> Self {
        let mut aligned = Self::zeros(values.len());
        aligned.copy_from_slice(values);
        aligned
    }
}

impl Deref for AlignedVec {
    type Target = [f32];

    #[inline]
    fn deref(&self) -> &[f32] {
        &bytemuck::cast_slice(&self.lines)[..self.length]
    }
}

impl DerefMut for AlignedVec {
    #[inline]
    fn deref_mut(&mut self) -> &mut [f32] {
        &mut bytemuck::cast_slice_mut(&mut self.lines)[..self.length]
    }
}
