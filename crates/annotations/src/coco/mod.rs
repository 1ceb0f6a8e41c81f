//! COCO masks: <https://cocodataset.org/#format-data>.
//!
//! `predictions.rs` reads a video's predictions, which `one_video.rs` selects, `mask_file.rs` the masks of one frame, and
//! `writer.rs` writes all masks of a run. `segmentation.rs` has the run-length encoding that they share.

mod mask_file;
mod one_video;
mod part;
mod predictions;
mod segmentation;
mod writer;

pub use mask_file::{MaskFileError, read_mask_file};
pub use predictions::EncodedMask;
pub(crate) use predictions::{frame_name, read_document, read_masks};
pub use writer::{CocoImage, CocoLabel, CocoWriter};
