//! Feature maps that keep the padding of a 3×3 convolution between layers, for small networks.
//!
//! With few channels, packing pixels for [`gemm`](crate::gemm) takes longer than the product. So the rows of a
//! [`FeatureMap`] are separated by one zero, and zeros precede the first row and follow the last. Every kernel tap is
//! then a shift of the whole map, and [`MapConvolution`] reads its vectors of pixels in place. A tile of outputs stays
//! in registers over all channels and taps: the order of every sum is fixed, so results do not depend on the number of
//! threads.

mod convolution;
mod direct;
mod resize;
#[cfg(test)]
mod tests;
mod tile;
mod winograd;

pub use convolution::MapConvolution;
pub use resize::{add_doubled, mean_per_channel};

use crate::AlignedVec;

/// Extra values after the last padding row, so that a tile of outputs may extend past the end.
const SLACK: usize = 64;

/// A multi-channel image, `[channels, height, width]`, with a border of zeros.
#[derive(Clone, Debug, PartialEq)]
pub struct FeatureMap {
    layout: MapLayout,
    channels: usize,
    values: AlignedVec,
}

/// Memory layout of a channel. The *position* of a pixel is `row * pitch + column`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct MapLayout {
    pub height: usize,
    pub width: usize,
}

impl MapLayout {
    /// Positions per row: its pixels and one zero.
    pub fn pitch(self) -> usize {
        self.width + 1
    }

    /// Number of zeros before the first pixel of a channel.
    pub fn lead(self) -> usize {
        self.pitch() + 1
    }

    /// Positions per channel, including the zero after each row.
    pub fn positions(self) -> usize {
        self.height * self.pitch()
    }

    /// Values per channel, including padding.
    pub fn plane(self) -> usize {
        (self.lead() + self.positions() + self.pitch() + 1 + SLACK).next_multiple_of(16)
    }
}

/// An empty map, to be reshaped later.
impl Default for FeatureMap {
    fn default() -> Self {
        Self::zeros(0, 0, 0)
    }
}

impl FeatureMap {
    /// A map of zeros.
    pub fn zeros(channels: usize, height: usize, width: usize) -> Self {
        let layout = MapLayout { height, width };
        Self { layout, channels, values: AlignedVec::zeros(channels * layout.plane()) }
    }

    /// Changes the map to this shape. Keeps the values if the shape is already right; otherwise sets all to zero.
    pub fn reshape(&mut self, channels: usize, height: usize, width: usize) {
        if (self.channels, self.layout) != (channels, MapLayout { height, width }) {
            *self = Self::zeros(channels, height, width);
        }
    }

    /// Number of channels.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.layout.height
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.layout.width
    }

    /// The pixels of one row of a channel.
    ///
    /// # Panics
    /// If `channel` or `row` is out of range.
    pub fn row(&self, channel: usize, row: usize) -> &[f32] {
        assert!(row < self.layout.height, "row {row} of a map of height {}", self.layout.height);
        &self.values[channel * self.layout.plane() + self.layout.lead() + row * self.layout.pitch()..]
            [..self.layout.width]
    }

    /// Iterates over the channels and, for each, over its rows in order, for changes in place.
    pub fn rows_mut(&mut self) -> impl Iterator<Item = impl Iterator<Item = &mut [f32]>> {
        let layout = self.layout;
        self.planes_mut().map(move |plane| {
            let rows = plane[layout.lead()..][..layout.positions()].chunks_exact_mut(layout.pitch());
            rows.map(move |row| &mut row[..layout.width])
        })
    }

    pub(crate) fn layout(&self) -> MapLayout {
        self.layout
    }

    pub(crate) fn values(&self) -> &[f32] {
        &self.values
    }

    pub(crate) fn values_mut(&mut self) -> &mut [f32] {
        &mut self.values
    }

    /// The channels with their padding. Padding must stay zero.
    pub(crate) fn planes_mut(&mut self) -> impl Iterator<Item = &mut [f32]> {
        let plane = self.layout.plane();
        self.values.chunks_exact_mut(plane)
    }
}
