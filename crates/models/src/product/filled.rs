//! Vectors that are written once: zeroing the outputs of a network first would cost as much as some of its layers.
#![allow(unsafe_code)]

use std::mem::MaybeUninit;

/// A vector of `len` values that `fill` writes. `fill` returns how many values it wrote, each to a place of its own.
///
/// # Panics
/// If that is not all.
pub(crate) fn filled(len: usize, fill: impl FnOnce(&mut [MaybeUninit<f32>]) -> usize) -> Vec<f32> {
    let mut values: Vec<f32> = Vec::with_capacity(len);
    let written = fill(&mut values.spare_capacity_mut()[..len]);
    assert_eq!(written, len, "values written");
    // SAFETY: the capacity is `len` at least, and as many values were written to as many places. That the places differ
    // rests on the layers that use this: jobs have slices of the output of their own, the rows and columns of their tiles
    // differ, and the runs of a tile do not overlap.
    unsafe { values.set_len(len) };
    values
}
