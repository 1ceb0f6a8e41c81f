//! Errors of SAM 2.1, EdgeTAM and EfficientTAM.

use thiserror::Error;

/// Errors loading weights, prompting or tracking.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum Sam2Error {
    /// A tensor of the network is missing from the checkpoint.
    #[error("tensor `{name}` is missing")]
    MissingTensor {
        /// The tensor's name.
        name: String,
    },
    /// A tensor does not have the shape that the network needs.
    #[error("tensor `{name}` has shape {found:?} instead of {expected:?}")]
    TensorShape {
        /// The tensor's name.
        name: String,
        /// Shape in the checkpoint.
        found: Vec<usize>,
        /// The shape that the network needs.
        expected: Vec<usize>,
    },
    /// The checkpoint contains a tensor that is not part of the network.
    #[error("tensor `{name}` is not part of the network")]
    UnexpectedTensor {
        /// The tensor's name.
        name: String,
    },
    /// The checkpoint is of another network.
    #[error("not a checkpoint of SAM 2.1, EdgeTAM or EfficientTAM: the first layer of the image encoder is missing")]
    OtherNetwork,
    /// The trunk matches no published configuration.
    #[error(
        "no SAM 2.1 has an image encoder with {blocks} blocks and {embed_dim} channels in the first (tiny: 12 and 96, \
         small: 16 and 96, base_plus: 24 and 112, large: 48 and 144)"
    )]
    UnknownConfiguration {
        /// Number of trunk blocks in the checkpoint.
        blocks: usize,
        /// Channels of the first trunk block.
        embed_dim: usize,
    },
    /// The shapes of the tensors do not make a network.
    #[error("the shapes of the tensors fit neither EdgeTAM nor EfficientTAM: {reason}")]
    UnusualShape {
        /// The size that does not fit.
        reason: String,
    },
    /// A tensor could not be read.
    #[error("tensor `{name}` cannot be read: {reason}")]
    UnreadableTensor {
        /// The tensor's name.
        name: String,
        /// The cause.
        reason: String,
    },
    /// The device failed. The predictor cannot continue its video.
    #[error("the device failed: {message}")]
    Device {
        /// Message from the device.
        message: String,
    },
    /// A setting is out of range.
    #[error("{field} is {found}, but it must be {expected}")]
    Setting {
        /// The setting's name.
        field: &'static str,
        /// The value found.
        found: String,
        /// The allowed values.
        expected: String,
    },
    /// Frames of one video differ in size.
    #[error("the frame has {}x{} pixels, but the video began with {}x{}", found.0, found.1, expected.0, expected.1)]
    FrameSize {
        /// `(width, height)` of the frame.
        found: (usize, usize),
        /// `(width, height)` of the first frame.
        expected: (usize, usize),
    },
    /// A prompt came before the first frame.
    #[error("there is no frame to prompt on yet")]
    NoFrame,
    /// The object is not being tracked.
    #[error("there is no object {object}")]
    UnknownObject {
        /// The requested id.
        object: u64,
    },
    /// A prompt without points, box or mask.
    #[error("the prompt of object {object} is empty")]
    EmptyPrompt {
        /// The object prompted.
        object: u64,
    },
    /// A mask prompt that is empty, or becomes empty when resized to the network's input.
    #[error("the mask given for object {object} has no pixel at the network's resolution")]
    EmptyMask {
        /// The object prompted.
        object: u64,
    },
    /// A mask prompt whose size differs from the frame's.
    #[error("the mask given for object {object} has {}x{} pixels, but the frame has {}x{}", found.0, found.1, expected.0, expected.1)]
    MaskSize {
        /// The object prompted.
        object: u64,
        /// `(width, height)` of the mask.
        found: (usize, usize),
        /// `(width, height)` of the frame.
        expected: (usize, usize),
    },
    /// A coordinate that is not finite or lies outside the frame.
    #[error(
        "the prompt of object {object} has the point ({x}, {y}), but the frame covers 0..{width} by 0..{height} pixels"
    )]
    PointOutside {
        /// The object prompted.
        object: u64,
        /// Column, in pixels.
        x: f32,
        /// Row, in pixels.
        y: f32,
        /// Width of the frame.
        width: usize,
        /// Height of the frame.
        height: usize,
    },
    /// A box without area.
    #[error("the box of object {object} goes from ({}, {}) to ({}, {}): it has no area", corners[0], corners[1], corners[2], corners[3])]
    EmptyBox {
        /// The object prompted.
        object: u64,
        /// x0, y0, x1, y1 in pixels.
        corners: [f32; 4],
    },
    /// A box in a prompt that adds points to earlier ones: a box must come first.
    #[error("the prompt of object {object} adds a box to earlier points: give the box with the first points")]
    LateBox {
        /// The object prompted.
        object: u64,
    },
}
