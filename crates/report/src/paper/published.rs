//! The paper's own results.

/// How the paper's rows are marked: they were measured on other data than a benchmark's.
pub(crate) const MARK: &str = "paper, ScanNet-MV: other data";

/// The paper's table for ScanNet-MV: name, then VSQ^1, VSQ^5, VSQ^10, VSQ^15, VSQ, STQ, AQ and SQ, percent.
pub const SCANNET_MV: [(&str, [f64; 8]); 7] = [
    ("FastSAM", [46.98, 39.19, 34.28, 31.21, 37.92, 28.17, 19.74, 40.19]),
    ("FastSPAM", [50.56, 42.78, 37.33, 34.03, 41.18, 30.33, 21.86, 42.09]),
    ("SAM2, detections", [45.53, 41.41, 39.28, 37.89, 41.03, 33.43, 27.47, 40.68]),
    ("SAM2, ground truth", [59.32, 52.68, 49.86, 47.81, 52.42, 33.83, 35.96, 31.82]),
    ("FastSAM-Splat", [48.07, 44.15, 41.98, 40.75, 43.74, 38.39, 32.83, 44.89]),
    ("SAM2-Splat, detections", [47.70, 44.16, 42.14, 41.02, 43.76, 35.01, 30.68, 39.94]),
    ("SAM2-Splat, ground truth", [62.85, 56.43, 54.03, 52.35, 56.42, 39.19, 41.99, 36.58]),
];

/// The paper's ablation of FastSAM-Splat: feature dimension, VSQ and STQ.
pub const FEATURE_DIMS: [(usize, f64, f64); 5] =
    [(1, 20.00, 15.47), (4, 42.29, 36.97), (7, 43.08, 37.93), (14, 43.66, 38.38), (28, 43.74, 38.39)];

/// Frames per second on the authors' GPU, by the names of [`SCANNET_MV`]. The paper does not say how SAM2 was prompted.
pub(crate) const FRAMES_PER_SECOND: [(&str, f64); 5] = [
    ("FastSAM", 64.57),
    ("FastSPAM", 6.60),
    ("SAM2, detections", 2.83),
    ("FastSAM-Splat", 2.84),
    ("SAM2-Splat, detections", 1.46),
];

/// Millions of parameters in the splat at the end of a video.
pub(crate) const MILLION_PARAMETERS: [(&str, f64); 2] = [("FastSAM-Splat", 28.0), ("SAM2-Splat, detections", 26.0)];

/// VSQ on MVPd.
pub(crate) const MVPD_VSQ: [(&str, f64); 6] = [
    ("Video K-Net", 42.52),
    ("Tube-Link", 25.12),
    ("OV2Seg", 38.19),
    ("FastSAM", 49.17),
    ("FastSPAM", 51.90),
    ("FastSAM-Splat", 56.76),
];
