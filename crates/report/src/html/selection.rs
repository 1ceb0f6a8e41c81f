//! Selection of the scenes, variants and frames shown on a page.

use crate::Benchmark;
use std::collections::BTreeSet;

/// Maximum number of pictures on a page, each 10 to 20 kB.
const MAX_PICTURES: usize = 720;
/// Maximum number of scenes with pictures and curves.
const MAX_SCENES: usize = 12;
/// Minimum number of frames of a scene.
const MIN_FRAMES: usize = 6;
/// Maximum number of variants with pictures.
const MAX_VARIANTS: usize = 24;
/// With more variants than this, the page opens with the first of each method.
const MAX_OPEN: usize = 8;

/// The part of a benchmark that a page shows in pictures and curves. Its size is bounded, and the same benchmark always
/// gives the same selection.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct PageSelection {
    /// Indices of scenes with results, evenly spaced.
    pub scenes: Vec<usize>,
    /// Indices of the variants with pictures.
    pub variants: Vec<usize>,
    /// The variants initially side by side; only these have curves over the frames.
    pub open: Vec<usize>,
    /// Maximum number of frames of each scene.
    pub frames: usize,
}

impl PageSelection {
    /// The selection for a benchmark.
    pub fn new(benchmark: &Benchmark) -> Self {
        let (variants, open) = variants(benchmark);
        let panels = variants.len() + 2;
        let measured: BTreeSet<usize> = benchmark.measurements.iter().map(|measurement| measurement.scene).collect();
        let measured: Vec<usize> = measured.into_iter().collect();
        let count = measured.len().min((MAX_PICTURES / (panels * MIN_FRAMES)).clamp(1, MAX_SCENES));
        let scenes: Vec<usize> = (0..count).map(|index| measured[index * measured.len() / count]).collect();
        let frames = (MAX_PICTURES / (panels * count.max(1))).max(MIN_FRAMES);
        Self { scenes, variants, open, frames }
    }
}

/// The variants with pictures, and the subset that the page opens with: all, or the first of each method.
fn variants(benchmark: &Benchmark) -> (Vec<usize>, Vec<usize>) {
    let all: Vec<usize> = (0..benchmark.variants.len()).collect();
    if all.len() <= MAX_OPEN {
        return (all.clone(), all);
    }
    let method = |variant: &usize| &benchmark.variants[*variant].method;
    let is_first = |variant: &usize| all.iter().position(|other| method(other) == method(variant)) == Some(*variant);
    let (mut firsts, others): (Vec<usize>, Vec<usize>) = all.iter().partition(|variant| is_first(variant));
    firsts.truncate(MAX_OPEN);
    let mut drawn: Vec<usize> = firsts.iter().chain(&others).copied().take(MAX_VARIANTS).collect();
    drawn.sort_unstable();
    (drawn, firsts)
}
