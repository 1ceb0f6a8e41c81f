//! A run-length encoded mask in JSON: `{"size": [height, width], "counts": ...}`.

use serde::Serialize;
use splatseg_geometry::{RleError, RunLengths};

/// A COCO RLE.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Segmentation {
    /// Height and width, pixels.
    pub size: [usize; 2],
    /// The run lengths.
    pub counts: Counts,
}

/// Run lengths, down the columns.
#[derive(Clone, Debug, Serialize)]
#[serde(untagged)]
pub(super) enum Counts {
    /// COCO's compressed text.
    Compressed(String),
    /// Numbers of pixels.
    Lengths(Vec<u32>),
}

impl Segmentation {
    /// Compresses a mask.
    pub fn compressed(runs: &RunLengths) -> Self {
        Self { size: [runs.height, runs.width], counts: Counts::Compressed(runs.to_compressed()) }
    }

    /// The mask. Run lengths that are listed as numbers are checked against the size only when they are decoded.
    ///
    /// # Errors
    /// If compressed text is damaged.
    pub fn into_runs(self) -> Result<RunLengths, RleError> {
        let [height, width] = self.size;
        match self.counts {
            Counts::Compressed(text) => RunLengths::from_compressed(width, height, &text),
            Counts::Lengths(counts) => Ok(RunLengths { width, height, counts }),
        }
    }
}
