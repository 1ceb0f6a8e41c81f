//! Scales a component's rows to the image's width and height as libjpeg does by default.
//!
//! Components with half the width, half the height or both are interpolated linearly between the samples' centres: 3/4
//! of the nearer and 1/4 of the farther sample, in fixed point. The rounding of halves alternates between pixels, to
//! avoid a bias. Samples are repeated for other ratios, and for components of at most two columns that are widened.

use super::frame::{Component, Frame, Plane};

/// Narrower components are repeated instead of interpolated horizontally.
const MIN_INTERPOLATED_WIDTH: usize = 3;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Method {
    AsIs,
    Repeat { across: usize, down: usize },
    Across,
    Down,
    Both,
}

impl Method {
    fn of(frame: &Frame, component: &Component) -> Self {
        let across = frame.max_sampling.0 / component.sampling.0;
        let down = frame.max_sampling.1 / component.sampling.1;
        let wide = component.size.0 >= MIN_INTERPOLATED_WIDTH;
        match (across, down) {
            (1, 1) => Self::AsIs,
            (2, 1) if wide => Self::Across,
            (1, 2) => Self::Down,
            (2, 2) if wide => Self::Both,
            _ => Self::Repeat { across, down },
        }
    }
}

/// Computes rows of a component at the image's size.
pub(super) struct Upsampler<'a> {
    method: Method,
    plane: &'a Plane,
    /// Width and height of the component.
    size: (usize, usize),
    /// Buffer for a row at full width.
    row: Vec<u8>,
    /// Buffer for the weighted sums of a row before horizontal interpolation.
    sums: Vec<u16>,
}

impl<'a> Upsampler<'a> {
    /// Creates an upsampler for a component of `frame` with the samples `plane`.
    pub(super) fn new(frame: &Frame, component: &Component, plane: &'a Plane) -> Self {
        let across = frame.max_sampling.0 / component.sampling.0;
        Self {
            method: Method::of(frame, component),
            plane,
            size: component.size,
            row: vec![0; component.size.0 * across],
            sums: vec![0; component.size.0],
        }
    }

    /// Computes row `row` of the image. The result may be wider than the image.
    pub(super) fn row(&mut self, row: usize) -> &[u8] {
        let width = self.size.0;
        match self.method {
            Method::AsIs => return self.plane.row(row, width),
            Method::Repeat { across, down } => {
                let samples = self.plane.row(row / down, width);
                for (repeated, sample) in self.row.chunks_exact_mut(across).zip(samples) {
                    repeated.fill(*sample);
                }
            }
            Method::Across => {
                for (sum, sample) in self.sums.iter_mut().zip(self.plane.row(row, width)) {
                    *sum = u16::from(*sample);
                }
                widen::<1, 2, 2>(&self.sums, &mut self.row);
            }
            Method::Down => {
                let (near, far) = self.nearest_rows(row);
                let bias = 1 + row as u16 % 2;
                for ((value, near), far) in self.row.iter_mut().zip(near).zip(far) {
                    *value = ((3 * u16::from(*near) + u16::from(*far) + bias) >> 2) as u8;
                }
            }
            Method::Both => {
                let (near, far) = self.nearest_rows(row);
                for ((sum, near), far) in self.sums.iter_mut().zip(near).zip(far) {
                    *sum = 3 * u16::from(*near) + u16::from(*far);
                }
                widen::<8, 7, 4>(&self.sums, &mut self.row);
            }
        }
        &self.row
    }

    /// Returns the nearest and second nearest row to the image's row `row`, for a component with half the image's
    /// height.
    fn nearest_rows(&self, row: usize) -> (&'a [u8], &'a [u8]) {
        let (width, height) = self.size;
        let near = row / 2;
        let far = if row.is_multiple_of(2) { near.saturating_sub(1) } else { (near + 1).min(height - 1) };
        (self.plane.row(near, width), self.plane.row(far, width))
    }
}

/// Doubles the width. Each value gives two: (3 · value + left or right neighbour + `LEFT` or `RIGHT`) >> `SHIFT`. The
/// ends repeat beyond the row.
fn widen<const LEFT: u16, const RIGHT: u16, const SHIFT: u32>(values: &[u16], row: &mut [u8]) {
    let (Some(first), Some(last)) = (values.first(), values.last()) else { return };
    let left = |value: u16, neighbour: u16| ((3 * value + neighbour + LEFT) >> SHIFT) as u8;
    let right = |value: u16, neighbour: u16| ((3 * value + neighbour + RIGHT) >> SHIFT) as u8;
    let (pairs, _) = row.as_chunks_mut::<2>();
    let [first_pair, inner @ .., last_pair] = pairs else { return };
    for ((pair, before), (value, after)) in inner.iter_mut().zip(values).zip(values[1..].iter().zip(&values[2..])) {
        *pair = [left(*value, *before), right(*value, *after)];
    }
    *first_pair = [left(*first, *first), right(*first, values[1])];
    *last_pair = [left(*last, values[values.len() - 2]), right(*last, *last)];
}
