//! Softmax attention on plain slices, without the full matrix of scores.
//!
//! [`multi_head_attention`] is the general case. [`window_attention`] attends within square windows of a map (Hiera).
//! [`AxialKeys`] attends to maps with an axial rotary position encoding without computing their keys (SAM 2's memory
//! attention).

mod axial;
mod axial_scores;
mod rotary;
mod softmax;
mod softmax_attention;
mod windows;

pub use axial::{AxialKeys, RememberedMaps};
pub use rotary::{rotary_angles, rotate};
pub use softmax_attention::{HeadRows, multi_head_attention};
pub use windows::{WindowShape, max_pool, window_attention};
