//! Settings of the affinity segmenter.

use splatseg_settings::{Allowed, settings};

settings! {
    /// Settings of [`AffinitySegmenter`](crate::AffinitySegmenter).
    pub struct AffinitySettings in "affinity" {
        /// Regions are merged while the mean log-odds of "same object" between them are above this. Lower values give
        /// fewer, larger segments. If not set, the value stored with the weights: -2.25 for the built-in ones.
        threshold: Option<f32> = None, Allowed::between(-100.0, 100.0);
        /// Smallest segment returned, pixels.
        min_area: usize = 100, Allowed::between(0.0, 1e9);
        /// Frames with more pixels are segmented at a lower resolution, with at most this many. The network was trained
        /// on 320×240.
        max_pixels: usize = 76_800, Allowed::between(1.0, 1e7);
        /// Frames whose depth, once smoothed, deviates from planes by more than this at a distance of 2 m, metres, are
        /// segmented with weights for noisy depth, such as that of a stereo camera. Only the built-in weights have those.
        noisy_depth: f64 = 0.0075, Allowed::between(0.0, 1e6);
    }
}
