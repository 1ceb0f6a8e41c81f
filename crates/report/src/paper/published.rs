//! The paper's own results.

/// Methods on ScanNet-MV: name, then VSQ^1, VSQ^5, VSQ^10, VSQ^15, VSQ, STQ, AQ and SQ, percent.
pub const SCANNET_MV: [(&str, [f64; 8]); 7] = [
    ("FastSAM", [46.98, 39.19, 34.28, 31.21, 37.92, 28.17, 19.74, 40.19]),
    ("FastSPAM", [50.56, 42.78, 37.33, 34.03, 41.18, 30.33, 21.86, 42.09]),
    ("SAM2, detections", [45.53, 41.41, 39.28, 37.89, 41.03, 33.43, 27.47, 40.68]),
    ("SAM2, ground truth", [59.32, 52.68, 49.86, 47.81, 52.42, 33.83, 35.96, 31.82]),
    ("FastSAM-Splat", [48.07, 44.15, 41.98, 40.75, 43.74, 38.39, 32.83, 44.89]),
    ("SAM2-Splat, detections", [47.70, 44.16, 42.14, 41.02, 43.76, 35.01, 30.68, 39.94]),
    ("SAM2-Splat, ground truth", [62.85, 56.43, 54.03, 52.35, 56.42, 39.19, 41.99, 36.58]),
];

/// The ablation of FastSAM-Splat: feature dimension, VSQ and STQ.
pub const FEATURE_DIMS: [(usize, f64, f64); 5] =
    [(1, 20.00, 15.47), (4, 42.29, 36.97), (7, 43.08, 37.93), (14, 43.66, 38.38), (28, 43.74, 38.39)];

/// The enabled categories of re-prompting, for SAM2-Splat with detections: name, VSQ and STQ.
pub const CATEGORIES: [(&str, f64, f64); 5] = [
    ("none (SAM2)", 41.03, 33.43),
    ("not tracked", 41.09, 34.19),
    ("incorrect track", 41.73, 33.15),
    ("duplicated track", 43.05, 33.78),
    ("all three", 43.76, 35.01),
];

/// Clicks per re-prompted object, for SAM2-Splat: number, then VSQ and STQ with detections and with ground truth.
pub const CLICKS: [(usize, [f64; 2], [f64; 2]); 3] =
    [(1, [42.95, 34.03], [54.89, 37.29]), (3, [43.86, 34.99], [56.10, 38.72]), (5, [43.76, 35.01], [56.42, 39.19])];

/// Methods on MVPd: name, then VSQ^1, VSQ^5, VSQ^10, VSQ^15 and VSQ. The paper could not run SAM2 or SAM2-Splat there.
pub const MVPD: [(&str, [f64; 5]); 9] = [
    ("Video K-Net, ResNet50", [49.65, 49.60, 38.10, 29.56, 41.73]),
    ("Video K-Net, Swin-base", [50.83, 50.50, 38.71, 30.05, 42.52]),
    ("Tube-Link, ResNet50", [45.13, 20.50, 16.08, 14.05, 23.94]),
    ("Tube-Link, Swin-large", [48.17, 21.14, 16.60, 14.55, 25.12]),
    ("OV2Seg, ResNet50", [39.96, 38.52, 37.51, 36.71, 38.18]),
    ("OV2Seg, Swin-base", [40.22, 38.58, 37.43, 36.52, 38.19]),
    ("FastSAM", [61.18, 52.03, 44.38, 39.09, 49.17]),
    ("FastSPAM", [60.68, 54.10, 48.48, 44.35, 51.90]),
    ("FastSAM-Splat", [60.91, 57.68, 55.20, 53.26, 56.76]),
];

/// Speed and size of a method on the authors' GPU.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PublishedEfficiency {
    /// The method.
    pub name: &'static str,
    /// Frames per second.
    pub frames_per_second: f64,
    /// Parameters of the backbone, millions.
    pub backbone: f64,
    /// Numbers in the memory, millions, mean over the videos; `None` for methods without memory.
    pub memory: Option<f64>,
}

/// The paper's efficiency table. It does not say how SAM2 was prompted; SAM2-Splat's memory of 26 M numbers is for its
/// row with detections.
pub const EFFICIENCY: [PublishedEfficiency; 11] = [
    efficiency("Video K-Net, ResNet50", 40.54, 26.0, None),
    efficiency("Video K-Net, Swin-base", 26.17, 88.0, None),
    efficiency("Tube-Link, ResNet50", 4.88, 26.0, None),
    efficiency("Tube-Link, Swin-large", 4.39, 197.0, None),
    efficiency("OV2Seg, ResNet50", 15.80, 26.0, None),
    efficiency("OV2Seg, Swin-base", 13.28, 88.0, None),
    efficiency("FastSAM", 64.57, 72.0, None),
    efficiency("FastSPAM", 6.60, 72.0, None),
    efficiency("SAM2, detections", 2.83, 81.0, None),
    efficiency("FastSAM-Splat", 2.84, 72.0, Some(28.0)),
    efficiency("SAM2-Splat, detections", 1.46, 81.0, Some(26.0)),
];

const fn efficiency(
    name: &'static str,
    frames_per_second: f64,
    backbone: f64,
    memory: Option<f64>,
) -> PublishedEfficiency {
    PublishedEfficiency { name, frames_per_second, backbone, memory }
}

/// 3D instances on ScanNet200, class-agnostic: AP, AP50 and AP25 as ESAM's paper (Xu et al., ICLR 2025) reports them.
pub(crate) const MESH_INSTANCES: (&str, [f64; 3]) = ("ESAM-E", [43.4, 65.4, 80.9]);

/// Published results shown beside a benchmark's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Reference {
    /// The paper's rows on ScanNet-MV.
    #[default]
    ScannetMv,
    /// The paper's rows on MVPd.
    Mvpd,
}

impl Reference {
    /// Mark of these rows, which may have been measured on other data than the benchmark's.
    pub(crate) fn mark(self) -> &'static str {
        match self {
            Self::ScannetMv => "paper, ScanNet-MV: other data",
            Self::Mvpd => "paper, MVPd",
        }
    }

    /// The rows: name and scores in the order of the columns of score tables.
    pub(crate) fn rows(self) -> Vec<(&'static str, [Option<f64>; 8])> {
        match self {
            Self::ScannetMv => SCANNET_MV.iter().map(|(name, scores)| (*name, scores.map(Some))).collect(),
            Self::Mvpd => MVPD.iter().map(|(name, scores)| (*name, vsq_columns(scores))).collect(),
        }
    }
}

/// The scores of MVPd's table in the columns of score tables; STQ, AQ and SQ are `None`.
pub fn vsq_columns(scores: &[f64; 5]) -> [Option<f64>; 8] {
    std::array::from_fn(|column| scores.get(column).copied())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// VSQ is the mean over k, so a typo in a row would break this relation.
    #[test]
    fn the_rows_agree_with_themselves() {
        let rows = SCANNET_MV.iter().map(|(name, scores)| (name, &scores[..5]));
        for (name, scores) in rows.chain(MVPD.iter().map(|(name, scores)| (name, &scores[..]))) {
            let mean = scores[..4].iter().sum::<f64>() / 4.0;
            assert!((mean - scores[4]).abs() < 0.011, "{name}: VSQ {} is not the mean {mean}", scores[4]);
        }
        let vsq_stq = |name: &str| SCANNET_MV.iter().find(|(known, _)| *known == name).map(|(_, row)| [row[4], row[5]]);
        let [_, _, clicks] = CLICKS;
        assert_eq!(vsq_stq("SAM2-Splat, detections"), Some(clicks.1));
        assert_eq!(vsq_stq("SAM2-Splat, ground truth"), Some(clicks.2));
        assert_eq!(vsq_stq("SAM2, detections"), Some([CATEGORIES[0].1, CATEGORIES[0].2]));
        assert_eq!(vsq_stq("SAM2-Splat, detections"), Some([CATEGORIES[4].1, CATEGORIES[4].2]));
        assert_eq!(vsq_stq("FastSAM-Splat"), Some([FEATURE_DIMS[4].1, FEATURE_DIMS[4].2]));
    }
}
