//! Settings of the graph segmenter.

use splatseg_settings::{Allowed, settings};

settings! {
    /// Settings of [`GraphSegmenter`](crate::GraphSegmenter).
    pub struct GraphSettings in "graph" {
        /// Smallest segment returned, pixels.
        min_area: usize = 100, Allowed::between(0.0, 1e9);
        /// Frames with more pixels are segmented at 1/2, 1/3, … of their resolution. Other settings in pixels, except
        /// `min_area`, then refer to the smaller image. By default, 320×240 is kept and 640×480 is halved.
        max_pixels: usize = 120_000, Allowed::between(1.0, 1e9);
        /// Colours closer than this (ΔE) are smoothed together.
        color_smoothing: f32 = 12.0, Allowed::between(1e-6, 1000.0);
        /// Weight of a difference in lightness relative to one in hue or chroma.
        lightness: f32 = 0.6, Allowed::between(0.0, 1000.0);
    }
    sections {
        /// Fitting planes to surfaces.
        surface: SurfaceSettings;
        /// Growing pixels into patches.
        patches: PatchSettings;
        /// Merging patches into segments.
        borders: BorderWeights;
    }
}

settings! {
    /// Settings for fitting planes to surfaces.
    pub struct SurfaceSettings in "graph.surface" {
        /// Standard deviation of inverse depth, 1/m. The default is a Kinect's: 3 mm at 1 m, 27 mm at 3 m.
        noise: f32 = 0.003, Allowed::between(1e-6, 1000.0);
        /// Half the window width of a plane fit at 1 m depth, in pixels of a camera with a focal length of 289. It
        /// grows with the square root of depth.
        reach: f32 = 4.0, Allowed::between(1e-6, 1000.0);
        /// Minimum total weight of the 25 samples of a plane fit.
        support: f32 = 6.0, Allowed::between(1e-6, 1000.0);
        /// Distance by which planes are extended into holes in the depth, pixels.
        fill: usize = 4, Allowed::between(0.0, 1000.0);
    }
}

settings! {
    /// Settings for growing pixels into patches. The distance between two pixels is the sum of the first four terms.
    pub struct PatchSettings in "graph.patches" {
        /// Distance per ΔE of colour.
        color: f32 = 0.04, Allowed::between(0.0, 1000.0);
        /// Distance per noise-sized step in depth.
        step: f32 = 0.3, Allowed::between(0.0, 1000.0);
        /// Distance per radian of a concave turn.
        concave: f32 = 2.0, Allowed::between(0.0, 1000.0);
        /// Distance per radian of a convex turn.
        convex: f32 = 0.7, Allowed::between(0.0, 1000.0);
        /// Felzenszwalb and Huttenlocher's k. Larger values give larger patches.
        scale: f32 = 8.0, Allowed::between(1e-6, 1e6);
        /// Patches with fewer pixels are merged into a neighbour.
        min_area: usize = 20, Allowed::between(0.0, 1e9);
    }
}

settings! {
    /// Weights for merging patches into segments. The log-odds that a border separates two objects are the sum of these
    /// terms. Two patches are merged while the log-odds of their border are below 0.
    ///
    /// The weights follow a logistic regression on the rendered room `dev-a`, with two exceptions. The weight of
    /// concave turns is higher: a room full of sofas and shelves says little about mugs on tables, and all weights from
    /// 0.9 to 2.5 score the same there. And the bias is 0.5 to 1 above the regression's, since oversegmentation costs
    /// less than undersegmentation.
    pub struct BorderWeights in "graph.borders" {
        /// Log-odds of a border without any evidence. Larger values give more, smaller segments.
        bias: f32 = -3.9, Allowed::between(-1000.0, 1000.0);
        /// Weight of the fraction of the border with a step in depth.
        step: f32 = 1.6, Allowed::between(-1000.0, 1000.0);
        /// Weight of each radian of concave turn at the border.
        concave: f32 = 2.5, Allowed::between(-1000.0, 1000.0);
        /// Weight of each radian of convex turn at the border.
        convex: f32 = 0.0, Allowed::between(-1000.0, 1000.0);
        /// Weight of each 10 ΔE between the mean colours of the two sides, up to 50 ΔE.
        color_mean: f32 = 0.7, Allowed::between(-1000.0, 1000.0);
        /// Weight of each 10 ΔE across the border, up to 50 ΔE.
        color_border: f32 = 0.35, Allowed::between(-1000.0, 1000.0);
        /// Weight of the deviation of the two sides from a common plane, in units of `surface.noise`, up to 5.
        off_plane: f32 = 0.16, Allowed::between(-1000.0, 1000.0);
        /// Weight of the fraction of the border without depth.
        unknown: f32 = 1.0, Allowed::between(-1000.0, 1000.0);
        /// Weight of each doubling of the smaller side's area relative to 100 pixels.
        area: f32 = 0.2, Allowed::between(-1000.0, 1000.0);
        /// Weight of the fraction of the smaller side's outline that is this border.
        enclosure: f32 = 0.4, Allowed::between(-1000.0, 1000.0);
    }
}
