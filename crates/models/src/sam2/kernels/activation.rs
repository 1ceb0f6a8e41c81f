//! Activations that follow no layer.

use crate::product::{Activation, Instructions, LANES};
use rayon::prelude::*;

/// Replaces all `values` by their activations.
pub fn apply_to_all(activation: Activation, values: &mut [f32]) {
    let instructions = Instructions::best();
    values.par_chunks_mut(1024 * LANES).for_each(|values| {
        instructions.vectorized(
            #[inline(always)]
            || activation.apply(values),
        );
    });
}
