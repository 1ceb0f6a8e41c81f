//! The tables of the methods' paper (Opipari et al., "Explicit Memory through Online 3D Gaussian Splatting Improves
//! Class-Agnostic Video Segmentation", RA-L 2025), with its numbers next to the measured ones.

mod curves;
mod efficiency;
mod published;
mod tables;
mod text;

pub use curves::{CurvePoint, CurveRow, PaperCurve};
pub use efficiency::EfficiencyRow;
pub(crate) use published::MESH_INSTANCES;
pub use published::{
    CATEGORIES, CLICKS, EFFICIENCY, FEATURE_DIMS, MVPD, PublishedEfficiency, Reference, SCANNET_MV, vsq_columns,
};
pub use tables::{Cell, PaperResults, PublishedTable, TableRow, paper_tables};
pub(crate) use text::heading;
pub use text::{csv, markdown};

/// The paper's tables of scores.
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
    /// Methods on MVPd.
    Mvpd,
}

/// A row of one of the paper's tables.
#[derive(Clone, Debug)]
pub struct PaperRow {
    /// Its table.
    pub table: PaperTable,
    /// Its name there.
    pub name: String,
    /// The paper's scores, percent: VSQ^1, VSQ^5, VSQ^10, VSQ^15, VSQ, STQ, AQ and SQ; `None` where it has none.
    pub published: [Option<f64>; 8],
    /// Its position in a curve; `None` in a table without curves.
    pub point: Option<CurvePoint>,
    /// Index of the measured variant in the benchmark of its table's data set; `None` if there is none.
    pub variant: Option<usize>,
    /// Reason why it was not measured, e.g. `needs weights of SAM 2.1`; also `None` for methods that are not ours.
    pub obstacle: Option<String>,
}

impl PaperTable {
    /// Every table, in the paper's order.
    pub const ALL: [Self; 5] = [Self::Methods, Self::FeatureDims, Self::Categories, Self::Clicks, Self::Mvpd];

    /// Its heading.
    pub fn title(self) -> &'static str {
        match self {
            Self::Methods => "Methods on ScanNet-MV",
            Self::FeatureDims => "Dimension of the segment-id feature (FastSAM-Splat, ScanNet-MV)",
            Self::Categories => "Categories of re-prompting (SAM2-Splat, detections, ScanNet-MV)",
            Self::Clicks => "Clicks per re-prompted object (SAM2-Splat, ScanNet-MV)",
            Self::Mvpd => "Methods on MVPd",
        }
    }

    /// True if its rows are measured on MVPd, false for ScanNet-MV.
    pub fn is_of_mvpd(self) -> bool {
        self == Self::Mvpd
    }
}
