//! Remembered evidence and a frame's predictions brought together (`splatseg_memory`'s `evidence/mod.rs`).

use cubecl::prelude::*;

/// Stands for an id where a prediction has no say.
pub(crate) const ABSTAIN: u32 = u32::MAX;

/// The segment with the most evidence once the prediction that is `seen` has its weight, `[height, width]`.
#[cube(launch)]
pub(crate) fn fuse(
    surfaces: &[u32],
    table_ids: &[u32],
    table_evidence: &[f32],
    seen: &[u32],
    fused: &mut [u32],
    observed: f32,
    unobserved: f32,
    pixels: u32,
) {
    let pixel = ABSOLUTE_POS;
    let pixels = pixels as usize;
    if pixel >= pixels {
        terminate!();
    }
    let prediction = seen[pixel];
    let mut best = observed;
    let mut segment = prediction;
    if prediction == 0 {
        best = unobserved;
    }
    if prediction == ABSTAIN {
        best = 0.0f32;
        segment = 0u32;
    }
    let known = surfaces[pixels + pixel] as usize;
    for place in 0..known {
        if table_ids[place * pixels + pixel] == prediction {
            best += table_evidence[place * pixels + pixel];
        }
    }
    for place in 0..known {
        let id = table_ids[place * pixels + pixel];
        let evidence = table_evidence[place * pixels + pixel];
        if id != prediction && (evidence > best || (evidence == best && id < segment)) {
            best = evidence;
            segment = id;
        }
    }
    fused[pixel] = segment;
}
