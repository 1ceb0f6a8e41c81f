//! Two saved maps in one, as by `splatseg merge`.

use crate::errors::{runtime_error, value_error};
use pyo3::prelude::*;
use splatseg::geometry::Pose;
use splatseg::merging::{MergeOptions, merge_maps};
use splatseg::pipeline::NamedMap;
use std::path::{Path, PathBuf};

/// Merges two maps and writes the result to `out`. Returns the report as JSON. `transform` is a 4x4 matrix, row-major.
#[pyfunction]
pub fn merge(
    py: Python<'_>,
    earlier: PathBuf,
    later: PathBuf,
    out: PathBuf,
    transform: Option<[f64; 16]>,
) -> PyResult<String> {
    let pose = transform.map(|rows| Pose::from_saved_row_major(rows).map_err(|error| format!("transform: {error}")));
    let options = MergeOptions { earlier_from_later: pose.transpose().map_err(value_error)? };
    py.detach(move || merged(&earlier, &later, &out, &options))
}

fn merged(earlier: &Path, later: &Path, out: &Path, options: &MergeOptions) -> PyResult<String> {
    let load = |path: &Path| NamedMap::load(path).map_err(value_error);
    let merged = merge_maps(load(earlier)?, load(later)?, options)
        .map_err(|error| value_error(format!("{} and {}: {error}", earlier.display(), later.display())))?;
    merged.map.save(out).map_err(runtime_error)?;
    serde_json::to_string(&merged.report).map_err(runtime_error)
}
