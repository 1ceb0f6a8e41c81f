//! The tables of the paper that the methods come from (Opipari et al., "Explicit Memory through Online 3D Gaussian
//! Splatting Improves Class-Agnostic Video Segmentation", RA-L 2025), with its numbers next to the measured ones.

mod document;
mod published;

pub use document::document;
pub use published::{FEATURE_DIMS, SCANNET_MV};
pub(crate) use published::{FRAMES_PER_SECOND, MARK, MILLION_PARAMETERS, MVPD_VSQ};

/// The paper's tables that a benchmark can measure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum PaperTable {
    /// Methods on ScanNet-MV.
    Methods,
    /// Dimensions of the segment-id feature.
    FeatureDims,
    /// Categories of re-prompting.
    Categories,
    /// Clicks for each re-prompted object.
    Clicks,
}

/// A row of one of the paper's tables.
#[derive(Clone, Debug)]
pub struct PaperRow {
    /// Its table.
    pub table: PaperTable,
    /// Its name there.
    pub name: String,
    /// The paper's scores, percent: VSQ^1, VSQ^5, VSQ^10, VSQ^15, VSQ, STQ, AQ and SQ; `None` where we have none.
    pub published: [Option<f64>; 8],
    /// Index of the variant that measures it; `None` if the benchmark has none.
    pub variant: Option<usize>,
    /// Why it was not measured, e.g. `needs weights of SAM 2.1`.
    pub obstacle: Option<String>,
}

impl PaperTable {
    /// Every table, in the paper's order.
    pub const ALL: [Self; 4] = [Self::Methods, Self::FeatureDims, Self::Categories, Self::Clicks];

    /// Its heading.
    pub(crate) fn title(self) -> &'static str {
        match self {
            Self::Methods => "Methods on ScanNet-MV",
            Self::FeatureDims => "Dimension of the segment-id feature (FastSAM-Splat)",
            Self::Categories => "Categories of re-prompting (SAM2-Splat, detections)",
            Self::Clicks => "Clicks per re-prompted object (SAM2-Splat, detections)",
        }
    }
}
