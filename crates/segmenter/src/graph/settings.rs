//! Settings of the graph segmenter.

use splatseg_settings::{Allowed, settings};

settings! {
    /// Settings of [`GraphSegmenter`](crate::GraphSegmenter).
    pub struct GraphSettings in "graph" {
        /// Smallest segment returned, pixels.
        min_area: usize = 100, Allowed::between(0.0, 1e9);
        /// Frames with more pixels are segmented at 1/2, 1/3, … of their resolution. All other sizes in pixels but
        /// `min_area` are then those of the smaller image. 320×240 is left as it is, 640×480 is halved.
        max_pixels: usize = 120_000, Allowed::between(1.0, 1e9);
        /// Colours closer than this (ΔE) are smoothed together.
        color_smoothing: f32 = 12.0, Allowed::between(1e-6, 1000.0);
        /// What a difference in lightness counts beside one in hue or chroma.
        lightness: f32 = 0.6, Allowed::between(0.0, 1000.0);
    }
    sections {
        /// How surfaces are measured.
        surface: SurfaceSettings;
        /// How pixels grow into patches.
        patches: PatchSettings;
        /// How patches are merged into segments.
        borders: BorderWeights;
    }
}

settings! {
    /// How surfaces are measured.
    pub struct SurfaceSettings in "graph.surface" {
        /// Standard deviation of inverse depth, 1/m. A kinect's: 3 mm at 1 m, 27 mm at 3 m.
        noise: f32 = 0.003, Allowed::between(1e-6, 1000.0);
        /// Half the width of the window of a plane fit at 1 m depth, pixels of a camera with a focal length of 289;
        /// grows with the square root of depth.
        reach: f32 = 4.0, Allowed::between(1e-6, 1000.0);
        /// Least summed weight of the 25 samples of a plane fit.
        support: f32 = 6.0, Allowed::between(1e-6, 1000.0);
        /// How far planes are carried into holes in the depth, pixels.
        fill: usize = 4, Allowed::between(0.0, 1000.0);
    }
}

settings! {
    /// How pixels grow into patches. A pair of pixels is as far apart as the sum of these terms.
    pub struct PatchSettings in "graph.patches" {
        /// Distance per ΔE of colour.
        color: f32 = 0.04, Allowed::between(0.0, 1000.0);
        /// Distance per noise-sized step in depth.
        step: f32 = 0.3, Allowed::between(0.0, 1000.0);
        /// Distance per radian of a concave turn.
        concave: f32 = 2.0, Allowed::between(0.0, 1000.0);
        /// Distance per radian of a convex turn.
        convex: f32 = 0.7, Allowed::between(0.0, 1000.0);
        /// Felzenszwalb and Huttenlocher's k: larger patches for larger values.
        scale: f32 = 8.0, Allowed::between(1e-6, 1e6);
        /// Patches smaller than this join a neighbour, pixels.
        min_area: usize = 20, Allowed::between(0.0, 1e9);
    }
}

settings! {
    /// How patches are merged into segments: the log-odds that the border between two of them parts two objects are a sum
    /// of these terms; while they are below 0, the two are merged.
    ///
    /// The weights follow a logistic regression on the rendered room `dev-a`, with two exceptions. That of concave turns is
    /// set higher: a room full of sofas and shelves teaches little of mugs on tables, and any weight from 0.9 to 2.5 scores
    /// the same there. And the bias is 0.5 to 1 above the regression's, since a cut too many costs less than one too few.
    pub struct BorderWeights in "graph.borders" {
        /// Of a border that shows nothing; more makes more, smaller segments.
        bias: f32 = -3.9, Allowed::between(-1000.0, 1000.0);
        /// For the fraction of the border with a step in depth.
        step: f32 = 1.6, Allowed::between(-1000.0, 1000.0);
        /// For each radian of concave turn at the border.
        concave: f32 = 2.5, Allowed::between(-1000.0, 1000.0);
        /// For each radian of convex turn at the border.
        convex: f32 = 0.0, Allowed::between(-1000.0, 1000.0);
        /// For each 10 ΔE between the mean colours of the two sides, up to 50.
        color_mean: f32 = 0.7, Allowed::between(-1000.0, 1000.0);
        /// For each 10 ΔE across the border, up to 50.
        color_border: f32 = 0.35, Allowed::between(-1000.0, 1000.0);
        /// For each noise level by which the two sides miss a common plane, up to 5.
        off_plane: f32 = 0.16, Allowed::between(-1000.0, 1000.0);
        /// For the fraction of the border without depth.
        unknown: f32 = 1.0, Allowed::between(-1000.0, 1000.0);
        /// For each doubling of the smaller side's area, from 100 pixels.
        area: f32 = 0.2, Allowed::between(-1000.0, 1000.0);
        /// For the fraction of the smaller side's outline that is this border.
        enclosure: f32 = 0.4, Allowed::between(-1000.0, 1000.0);
    }
}
