//! A network for images and words, with the labels that objects can get.

use crate::errors::value_error;
use numpy::PyArray1;
use pyo3::prelude::*;
use splatseg::names::{ClipNames, Vocabulary};
use std::path::PathBuf;
use std::sync::Arc;

/// A network with its vocabulary.
#[pyclass(frozen, module = "splatseg._splatseg")]
pub struct Names(pub Arc<ClipNames>);

#[pymethods]
impl Names {
    #[new]
    #[pyo3(signature = (path, vocabulary=None, labels=None, min_score=None))]
    fn new(
        py: Python<'_>,
        path: PathBuf,
        vocabulary: Option<PathBuf>,
        labels: Option<Vec<String>>,
        min_score: Option<f64>,
    ) -> PyResult<Self> {
        let min_score = min_score.unwrap_or(ClipNames::MIN_SCORE);
        if !(0.0..=1.0).contains(&min_score) {
            return Err(value_error(format!("min_score is {min_score}, expected 0 to 1")));
        }
        let names = py.detach(|| ClipNames::open(&path, vocabulary.as_deref())).map_err(value_error)?;
        let names = match labels {
            Some(labels) => names.with_vocabulary(Vocabulary::of(labels).map_err(value_error)?),
            None => names,
        };
        Ok(Self(Arc::new(names.with_min_score(min_score))))
    }

    /// The labels.
    fn labels(&self) -> Vec<String> {
        self.0.vocabulary().labels().map(str::to_owned).collect()
    }

    /// The embedding of a text.
    fn embed_text(&self, py: Python<'_>, text: &str) -> PyResult<Py<PyArray1<f32>>> {
        let embedding = py.detach(|| self.0.embed_text(text)).map_err(value_error)?;
        Ok(PyArray1::from_vec(py, embedding).unbind())
    }
}
