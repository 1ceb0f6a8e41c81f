//! Depth that is predicted from colour, for cameras without a depth sensor and for what a sensor does not measure.
//!
//! A [`DepthPredictor`] returns the depth of a frame's colour image. Predictions are smooth and plausible, but their scale
//! and their large shapes are off by several percent, differently in every frame. So a prediction is fitted to what is
//! known better ([`DepthFit`]): to the measured depth of the same frame, whose holes it then fills ([`filled`]), or to the
//! depth that the map shows at the camera's pose.
//!
//! | file | |
//! | --- | --- |
//! | `predictor.rs` | the trait |
//! | `fit.rs` | scale, shift and smooth residual of a prediction |
//! | `residual.rs` | the smooth part of it |
//! | `holes.rs` | holes of measured depth filled with a prediction |

mod fit;
mod holes;
mod predictor;
mod residual;

pub use fit::{DepthFit, FitPrior};
pub use holes::{FilledDepth, filled};
pub use predictor::{DepthPredictor, DepthPredictorError, PredictedDepth};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
