//! Doubts about the input of a run.

/// Subject of a doubt.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum DoubtKind {
    /// Given poses, or the unit of their positions.
    Poses,
    /// The unit of depth.
    DepthUnit,
    /// The registration of depth to colour.
    Registration,
    /// The times of colour and depth.
    Delay,
    /// The camera's focal length.
    FocalLength,
    /// The light or the exposure of the images.
    Exposure,
}

impl DoubtKind {
    /// True if what came with the frames contradicts what they show, so that results are likely to be wrong. The others
    /// are hints: tracking copes with them, but less well than it could.
    pub const fn is_contradiction(self) -> bool {
        !matches!(self, Self::FocalLength | Self::Exposure)
    }
}

/// Something conspicuous about the input.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InputDoubt {
    /// Its subject.
    pub kind: DoubtKind,
    /// A sentence for the user: what was found, and what mends it.
    pub text: String,
}
