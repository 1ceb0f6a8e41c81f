//! Names of a stream's coordinate frames.

/// Names of the coordinate frames of a stream, as in the headers of its messages.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CoordinateFrames {
    /// The optical frame of the colour images; empty if they name none.
    pub camera: String,
    /// The frame of the poses. `None` if there are no poses, or they name none.
    pub world: Option<String>,
}
