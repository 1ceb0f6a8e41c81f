//! Masks from prototypes.
//!
//! Ultralytics combines the prototypes for every detection, scales the whole map up, thresholds it at 0 and clears the
//! pixels outside the box. Here only the inside of the box is computed, and the scaling steps, all linear, are combined
//! into one.

use super::placement::{Placement, scaled_to_fit, window_start};
use super::resampling::{Resampling, Taps};
use super::{Candidates, Prototypes};
use rayon::prelude::*;
use splatseg_geometry::Mask;
use std::ops::Range;

/// Input pixels per prototype sample, along each axis.
const PROTOTYPE_STRIDE: usize = 4;

/// A rectangle of an image, as ranges of columns and rows.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Region {
    columns: Range<usize>,
    rows: Range<usize>,
}

impl Region {
    /// The pixels (column, row) with left ≤ column < right and top ≤ row < bottom within an image.
    fn from_box([left, top, right, bottom]: [f32; 4], (width, height): (usize, usize)) -> Self {
        let along = |from: f32, to: f32, size: usize| {
            let pixel = |position: f32| (position.ceil().max(0.0) as usize).min(size);
            pixel(from)..pixel(to).max(pixel(from))
        };
        Self { columns: along(left, right, width), rows: along(top, bottom, height) }
    }
}

/// Values in a rectangle of an image, row-major.
struct Patch {
    region: Region,
    values: Vec<f32>,
}

/// Scaling of prototypes, or of a mask, to an image, along both axes.
struct Scaling {
    columns: Resampling,
    rows: Resampling,
    /// `(width, height)` of the result in pixels.
    size: (usize, usize),
}

/// Computes the masks of the `kept` candidates at the image's size; `boxes_xyxy` are their boxes in image pixels
/// (Ultralytics' `retina_masks=True`, `process_mask_native`).
pub fn image_masks(
    candidates: &Candidates,
    kept: &[usize],
    boxes_xyxy: &[[f32; 4]],
    prototypes: &Prototypes,
    placement: Placement,
) -> Vec<Mask> {
    let scaling = prototypes_to_image(prototypes, placement);
    masks(candidates, kept, boxes_xyxy, prototypes, &scaling)
}

/// Computes the masks of the `kept` candidates at the input's size; `boxes_xyxy` are their boxes in input pixels
/// (Ultralytics' `retina_masks=False`, `process_mask`).
pub fn input_masks(
    candidates: &Candidates,
    kept: &[usize],
    boxes_xyxy: &[[f32; 4]],
    prototypes: &Prototypes,
    placement: Placement,
) -> Vec<Mask> {
    let (width, height) = placement.input;
    let scaling = Scaling {
        columns: Resampling::linear(prototypes.width, width),
        rows: Resampling::linear(prototypes.height, height),
        size: placement.input,
    };
    masks(candidates, kept, boxes_xyxy, prototypes, &scaling)
}

/// Scales a mask of the input to the image's size; a pixel is set if more than half is covered
/// (`scale_masks(…) > 0.5`).
pub fn input_mask_in_image(mask: &Mask, placement: Placement) -> Mask {
    let scaling = window_to_image((mask.width(), mask.height()), 1, placement.image);
    let region = Region { columns: 0..mask.width(), rows: 0..mask.height() };
    let mut values = vec![0.0; mask.width() * mask.height()];
    mask.pixel_indices().for_each(|index| values[index] = 1.0);
    let whole = Region { columns: 0..placement.image.0, rows: 0..placement.image.1 };
    thresholded(&Patch { region, values }, &scaling, whole, 0.5)
}

/// Scaling from prototypes to the image. If the padding is not a multiple of a prototype sample's size, the image's
/// window would start between two samples, so the maps are scaled up first.
fn prototypes_to_image(prototypes: &Prototypes, placement: Placement) -> Scaling {
    let (columns, rows) = placement.padding();
    let padding = columns | rows;
    let upscaling = PROTOTYPE_STRIDE / greatest_common_divisor(PROTOTYPE_STRIDE, padding | (padding / 2));
    window_to_image((prototypes.width, prototypes.height), upscaling, placement.image)
}

/// Scaling that enlarges by an integer, crops the image's window (all but the padding) and resizes it to the image's
/// size.
fn window_to_image(map: (usize, usize), upscaling: usize, image: (usize, usize)) -> Scaling {
    let frame = (map.0 * upscaling, map.1 * upscaling);
    let scaled = scaled_to_fit(image, frame);
    let along = |from: usize, frame: usize, scaled: usize, to: usize| {
        let scaled = scaled.clamp(1, frame);
        let start = window_start(frame - scaled);
        Resampling::from_window(from, start..start + scaled, to, upscaling)
    };
    Scaling {
        columns: along(map.0, frame.0, scaled.0, image.0),
        rows: along(map.1, frame.1, scaled.1, image.1),
        size: image,
    }
}

fn greatest_common_divisor(a: usize, b: usize) -> usize {
    if b == 0 { a } else { greatest_common_divisor(b, a % b) }
}

fn masks(
    candidates: &Candidates,
    kept: &[usize],
    boxes_xyxy: &[[f32; 4]],
    prototypes: &Prototypes,
    scaling: &Scaling,
) -> Vec<Mask> {
    kept.par_iter()
        .zip(boxes_xyxy)
        .map(|(index, box_xyxy)| {
            let region = Region::from_box(*box_xyxy, scaling.size);
            let sources = Region {
                columns: scaling.columns.sources(region.columns.clone()),
                rows: scaling.rows.sources(region.rows.clone()),
            };
            let logits = combined_prototypes(prototypes, candidates.coefficients(*index), sources);
            thresholded(&logits, scaling, region, 0.0)
        })
        .collect()
}

/// Computes mask logits in a region: the sum of the prototypes, weighted by the coefficients.
fn combined_prototypes(prototypes: &Prototypes, coefficients: &[f32], region: Region) -> Patch {
    let width = region.columns.len();
    let mut values = vec![0.0; width * region.rows.len()];
    let area = prototypes.width * prototypes.height;
    if width > 0 {
        for (coefficient, map) in coefficients.iter().zip(prototypes.values.chunks_exact(area)) {
            for (row, output) in region.rows.clone().zip(values.chunks_exact_mut(width)) {
                let samples = &map[row * prototypes.width..][region.columns.clone()];
                for (value, sample) in output.iter_mut().zip(samples) {
                    *value += coefficient * sample;
                }
            }
        }
    }
    Patch { region, values }
}

/// Returns the mask of the pixels in `region` at which the scaled `patch` exceeds a threshold. The patch must contain
/// all samples that the region depends on.
fn thresholded(patch: &Patch, scaling: &Scaling, region: Region, threshold: f32) -> Mask {
    let mut mask = Mask::empty(scaling.size.0, scaling.size.1);
    let width = region.columns.len();
    if width == 0 || region.rows.is_empty() {
        return mask;
    }
    // Resample along the rows of the patch, then along its columns.
    let columns = scaling.columns.taps(region.columns.clone());
    let mut stretched = vec![0.0; width * patch.region.rows.len()];
    let lines = patch.values.chunks_exact(patch.region.columns.len()).zip(stretched.chunks_exact_mut(width));
    for (samples, output) in lines {
        for (value, taps) in output.iter_mut().zip(columns) {
            let samples = &samples[taps.first - patch.region.columns.start..][..taps.count];
            *value = samples.iter().zip(taps.weights).map(|(sample, weight)| sample * weight).sum();
        }
    }
    let mut line = vec![0.0; width];
    for (row, taps) in region.rows.clone().zip(scaling.rows.taps(region.rows.clone())) {
        sum_rows(&mut line, taps, &stretched[(taps.first - patch.region.rows.start) * width..]);
        for (column, value) in region.columns.clone().zip(&line) {
            if *value > threshold {
                mask.set(column, row, true);
            }
        }
    }
    mask
}

/// Computes the weighted sum of the first rows of `rows`, each as long as `line`.
fn sum_rows(line: &mut [f32], taps: &Taps, rows: &[f32]) {
    line.fill(0.0);
    for (row, weight) in rows.chunks_exact(line.len()).zip(&taps.weights[..taps.count]) {
        for (value, sample) in line.iter_mut().zip(row) {
            *value += weight * sample;
        }
    }
}
