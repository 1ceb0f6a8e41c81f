//! The heads: from the features of a frame and prompts to masks, object scores and object pointers.

mod hole_filling;
mod mask_decoder;
mod object_mask;
mod sam_heads;
mod two_way_transformer;

pub(crate) use hole_filling::fill_holes;
#[cfg(test)]
pub(crate) use mask_decoder::DecodedMasks;
pub use object_mask::ObjectMask;
pub(crate) use sam_heads::{HeadOutputs, MaskChoice, SamHeads};
