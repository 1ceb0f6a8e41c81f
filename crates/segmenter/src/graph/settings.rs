//! Settings of the graph segmenter.

use crate::SegmenterError;
use serde::{Deserialize, Serialize};

/// Settings of [`GraphSegmenter`](crate::GraphSegmenter).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GraphSettings {
    /// Smallest segment returned, pixels. Default 100.
    pub min_area: usize,
    /// Frames with more pixels are segmented at 1/2, 1/3, … of their resolution. All other sizes in pixels but
    /// `min_area` are then those of the smaller image. Default 120000: 320×240 is left as it is, 640×480 is halved.
    pub max_pixels: usize,
    /// Colours closer than this (ΔE) are smoothed together. Default 12.
    pub color_smoothing: f32,
    /// What a difference in lightness counts beside one in hue or chroma. Default 0.6.
    pub lightness: f32,
    /// How surfaces are measured.
    pub surface: SurfaceSettings,
    /// How pixels grow into patches.
    pub patches: PatchSettings,
    /// How patches are merged into segments.
    pub borders: BorderWeights,
}

/// How surfaces are measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SurfaceSettings {
    /// Standard deviation of inverse depth, 1/m. Default 0.003, a Kinect's: 3 mm at 1 m, 27 mm at 3 m.
    pub noise: f32,
    /// Half the width of the window of a plane fit at 1 m depth, pixels of a camera with a focal length of 289; grows
    /// with the square root of depth. Default 4.
    pub reach: f32,
    /// Least summed weight of the 25 samples of a plane fit. Default 6.
    pub support: f32,
    /// How far planes are carried into holes in the depth, pixels. Default 4.
    pub fill: usize,
}

/// How pixels grow into patches. A pair of pixels is as far apart as the sum of these terms.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PatchSettings {
    /// Distance per ΔE of colour. Default 0.04.
    pub color: f32,
    /// Distance per noise-sized step in depth. Default 0.3.
    pub step: f32,
    /// Distance per radian of a concave turn. Default 2.
    pub concave: f32,
    /// Distance per radian of a convex turn. Default 0.7.
    pub convex: f32,
    /// Felzenszwalb and Huttenlocher's k: larger patches for larger values. Default 8.
    pub scale: f32,
    /// Patches smaller than this join a neighbour, pixels. Default 20.
    pub min_area: usize,
}

/// How patches are merged into segments: the log-odds that the border between two of them parts two objects are a sum
/// of these terms; while they are below 0, the two are merged.
///
/// The weights follow a logistic regression on the rendered room `dev-a`, with two exceptions. That of concave turns is
/// set higher: a room full of sofas and shelves teaches little of mugs on tables, and any weight from 0.9 to 2.5 scores
/// the same there. And the bias is 0.5 to 1 above the regression's, since a cut too many costs less than one too few.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BorderWeights {
    /// Of a border that shows nothing; more makes more, smaller segments. Default -3.9.
    pub bias: f32,
    /// For the fraction of the border with a step in depth. Default 1.6.
    pub step: f32,
    /// For each radian of concave turn at the border. Default 2.5.
    pub concave: f32,
    /// For each radian of convex turn at the border. Default 0.
    pub convex: f32,
    /// For each 10 ΔE between the mean colours of the two sides, up to 50. Default 0.7.
    pub color_mean: f32,
    /// For each 10 ΔE across the border, up to 50. Default 0.35.
    pub color_border: f32,
    /// For each noise level by which the two sides miss a common plane, up to 5. Default 0.16.
    pub off_plane: f32,
    /// For the fraction of the border without depth. Default 1.
    pub unknown: f32,
    /// For each doubling of the smaller side's area, from 100 pixels. Default 0.2.
    pub area: f32,
    /// For the fraction of the smaller side's outline that is this border. Default 0.4.
    pub enclosure: f32,
}

impl Default for GraphSettings {
    fn default() -> Self {
        Self {
            min_area: 100,
            max_pixels: 120_000,
            color_smoothing: 12.0,
            lightness: 0.6,
            surface: SurfaceSettings::default(),
            patches: PatchSettings::default(),
            borders: BorderWeights::default(),
        }
    }
}

impl Default for SurfaceSettings {
    fn default() -> Self {
        Self { noise: 0.003, reach: 4.0, support: 6.0, fill: 4 }
    }
}

impl Default for PatchSettings {
    fn default() -> Self {
        Self { color: 0.04, step: 0.3, concave: 2.0, convex: 0.7, scale: 8.0, min_area: 20 }
    }
}

impl Default for BorderWeights {
    fn default() -> Self {
        Self {
            bias: -3.9,
            step: 1.6,
            concave: 2.5,
            convex: 0.0,
            color_mean: 0.7,
            color_border: 0.35,
            off_plane: 0.16,
            unknown: 1.0,
            area: 0.2,
            enclosure: 0.4,
        }
    }
}

impl GraphSettings {
    /// Returns `self` if every setting is in its range.
    pub(super) fn validated(self) -> Result<Self, SegmenterError> {
        let (surface, patches, borders) = (&self.surface, &self.patches, &self.borders);
        let above_zero = [
            ("color_smoothing", self.color_smoothing),
            ("surface.noise", surface.noise),
            ("surface.reach", surface.reach),
            ("surface.support", surface.support),
            ("patches.scale", patches.scale),
        ];
        let not_negative = [
            ("lightness", self.lightness),
            ("patches.color", patches.color),
            ("patches.step", patches.step),
            ("patches.concave", patches.concave),
            ("patches.convex", patches.convex),
        ];
        let finite = [
            ("borders.bias", borders.bias),
            ("borders.step", borders.step),
            ("borders.concave", borders.concave),
            ("borders.convex", borders.convex),
            ("borders.color_mean", borders.color_mean),
            ("borders.color_border", borders.color_border),
            ("borders.off_plane", borders.off_plane),
            ("borders.unknown", borders.unknown),
            ("borders.area", borders.area),
            ("borders.enclosure", borders.enclosure),
        ];
        for (fields, lowest, expected) in [
            (&above_zero[..], 1e-6, "a finite number, 0.000001 or more"),
            (&not_negative[..], 0.0, "a finite number, 0 or more"),
            (&finite[..], f32::MIN, "a finite number"),
        ] {
            for (field, value) in fields {
                if !(value.is_finite() && *value >= lowest) {
                    return Err(SegmenterError::Setting { field, found: value.to_string(), expected });
                }
            }
        }
        if self.max_pixels == 0 {
            let found = "0".to_owned();
            return Err(SegmenterError::Setting { field: "max_pixels", found, expected: "at least 1" });
        }
        if surface.fill > 1000 {
            let found = surface.fill.to_string();
            return Err(SegmenterError::Setting { field: "surface.fill", found, expected: "at most 1000 pixels" });
        }
        Ok(self)
    }
}
