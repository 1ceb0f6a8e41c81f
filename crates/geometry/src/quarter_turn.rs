//! Turns of an image by multiples of 90°.

use serde::{Deserialize, Serialize};

/// A turn of an image by a multiple of 90°, clockwise as one looks at it.
///
/// ```
/// use splatseg_geometry::{Image, QuarterTurn};
/// let image = Image::from_pixels(2, 1, vec!['a', 'b'])?;
/// let turned = image.turned(QuarterTurn::Right);
/// assert_eq!((turned.size(), turned.pixels()), ((1, 2), &['a', 'b'][..]));
/// assert_eq!(turned.turned(QuarterTurn::Right.inverse()), image);
/// # Ok::<(), splatseg_geometry::ImageSizeError>(())
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum QuarterTurn {
    /// No turn.
    #[default]
    None,
    /// By 90° clockwise: what was on the left is on top.
    Right,
    /// By 180°.
    Half,
    /// By 90° anticlockwise: what was on the right is on top.
    Left,
}

impl QuarterTurn {
    /// All turns, by increasing angle.
    pub const ALL: [Self; 4] = [Self::None, Self::Right, Self::Half, Self::Left];

    /// The angle, degrees clockwise.
    pub const fn degrees(self) -> u32 {
        match self {
            Self::None => 0,
            Self::Right => 90,
            Self::Half => 180,
            Self::Left => 270,
        }
    }

    /// The turn that undoes this one.
    #[must_use]
    pub const fn inverse(self) -> Self {
        match self {
            Self::Right => Self::Left,
            Self::Left => Self::Right,
            other => other,
        }
    }

    /// The size (width, height) of an image of this size after the turn.
    pub const fn size(self, (width, height): (usize, usize)) -> (usize, usize) {
        match self {
            Self::None | Self::Half => (width, height),
            Self::Right | Self::Left => (height, width),
        }
    }

    /// Where a vector of an image, (right, down), points after the turn.
    pub const fn vector(self, (right, down): (i32, i32)) -> (i32, i32) {
        match self {
            Self::None => (right, down),
            Self::Right => (-down, right),
            Self::Half => (-right, -down),
            Self::Left => (down, -right),
        }
    }

    /// Where pixel (column, row) of an image of size (width, height) is after the turn.
    pub const fn pixel(self, (column, row): (usize, usize), (width, height): (usize, usize)) -> (usize, usize) {
        match self {
            Self::None => (column, row),
            Self::Right => (height - 1 - row, column),
            Self::Half => (width - 1 - column, height - 1 - row),
            Self::Left => (row, width - 1 - column),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Image;

    #[test]
    fn pixels_and_vectors_turn_alike() {
        let size = (5, 3);
        for turn in QuarterTurn::ALL {
            let [one, other] = [(1, 0), (3, 2)].map(|pixel| turn.pixel(pixel, size));
            let between = (other.0 as i32 - one.0 as i32, other.1 as i32 - one.1 as i32);
            assert_eq!(turn.vector((2, 2)), between);
            let back = turn.inverse();
            assert_eq!((back.pixel(one, turn.size(size)), back.size(turn.size(size))), ((1, 0), size));
            assert_eq!(back.vector(turn.vector((4, -7))), (4, -7));
        }
    }

    #[test]
    fn turns_are_clockwise() {
        let image = Image::from_fn(3, 2, |column, row| 10 * row + column);
        assert_eq!(image.turned(QuarterTurn::Right).pixels(), [10, 0, 11, 1, 12, 2]);
        assert_eq!(image.turned(QuarterTurn::Half).pixels(), [12, 11, 10, 2, 1, 0]);
        assert_eq!(image.turned(QuarterTurn::Left).pixels(), [2, 12, 1, 11, 0, 10]);
        assert_eq!(QuarterTurn::ALL.map(QuarterTurn::degrees), [0, 90, 180, 270]);
    }
}
