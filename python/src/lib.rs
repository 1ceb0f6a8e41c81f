//! The Python module `splatseg._splatseg`, on which the Python package `splatseg` is built.
//!
//! The package in `package/splatseg/` adds names, types and documentation. This module checks arrays (`arrays.rs`) and
//! calls the library without the GIL.

mod arrays;
mod command;
mod depth;
mod errors;
mod evaluation;
mod lens;
mod live;
mod merging;
mod names;
mod pictures;
mod pipeline;
mod sam2;
mod saved_map;
mod scene;
mod segmenter;
mod settings;

use pyo3::prelude::*;

/// The compiled part of the Python package `splatseg`.
#[pymodule]
mod _splatseg {
    #[pymodule_export]
    use super::command::run_command;
    #[pymodule_export]
    use super::depth::Depth;
    #[pymodule_export]
    use super::evaluation::evaluate;
    #[pymodule_export]
    use super::lens::Lens;
    #[pymodule_export]
    use super::live::Live;
    #[pymodule_export]
    use super::merging::merge;
    #[pymodule_export]
    use super::names::Names;
    #[pymodule_export]
    use super::pictures::{overlay, overlay_png, segment_color};
    #[pymodule_export]
    use super::pipeline::Pipeline;
    #[pymodule_export]
    use super::sam2::Sam2;
    #[pymodule_export]
    use super::saved_map::{FloorPlan, SavedMap};
    #[pymodule_export]
    use super::scene::{Frames, Scene};
    #[pymodule_export]
    use super::segmenter::Segmenter;
    #[pymodule_export]
    use super::settings::check_settings;

    #[pymodule_export]
    #[allow(non_upper_case_globals, reason = "Python's name for it")]
    const __version__: &str = env!("CARGO_PKG_VERSION");
}
