//! The images of an object for a network: its view with some of its surroundings, and the same with these dimmed.

use splatseg_geometry::Image;
use splatseg_objects::ObjectView;

/// Share of the surroundings' contrast that is left when they are dimmed.
const DIMMED: f32 = 0.2;

/// The two square images of a view with sides of `side` pixels: as it is, and with what does not show the object dimmed.
pub(super) fn crops(view: &ObjectView, side: usize) -> [Image<[u8; 3]>; 2] {
    let around = mean(view);
    let dimmed = Image::from_fn(view.image.width(), view.image.height(), |column, row| {
        let pixel = view.image[(column, row)];
        if view.mask[(column, row)] { pixel } else { blend(pixel, around) }
    });
    [square(&view.image, around, side), square(&dimmed, around, side)]
}

/// Mean colour of a view.
fn mean(view: &ObjectView) -> [u8; 3] {
    let pixels = view.image.pixels();
    let count = pixels.len().max(1) as u64;
    std::array::from_fn(|channel| {
        let sum: u64 = pixels.iter().map(|pixel| u64::from(pixel[channel])).sum();
        (sum / count) as u8
    })
}

fn blend(pixel: [u8; 3], around: [u8; 3]) -> [u8; 3] {
    std::array::from_fn(|channel| {
        let (value, mean) = (f32::from(pixel[channel]), f32::from(around[channel]));
        (mean + DIMMED * (value - mean)).round() as u8
    })
}

/// An image in the middle of a square of a colour, resampled with a triangle filter.
fn square(image: &Image<[u8; 3]>, around: [u8; 3], side: usize) -> Image<[u8; 3]> {
    let longest = image.width().max(image.height());
    let (left, top) = ((longest - image.width()) / 2, (longest - image.height()) / 2);
    let taps = Taps::new(longest, side);
    let inside = |at: usize, start: usize, length: usize| at.checked_sub(start).filter(|at| *at < length);
    // Rows first: [longest, side].
    let mut rows = vec![[0f32; 3]; longest * side];
    for (row, out) in rows.chunks_exact_mut(side).enumerate() {
        let source = inside(row, top, image.height()).map(|row| image.row(row));
        let pixel = |column: usize| match (source, inside(column, left, image.width())) {
            (Some(source), Some(column)) => source[column],
            _ => around,
        };
        for (out, taps) in out.iter_mut().zip(&taps.0) {
            for (offset, weight) in taps.weights.iter().enumerate() {
                let pixel = pixel(taps.first + offset);
                (0..3).for_each(|channel| out[channel] += weight * f32::from(pixel[channel]));
            }
        }
    }
    Image::from_fn(side, side, |column, row| {
        let taps = &taps.0[row];
        let mut sum = [0f32; 3];
        for (offset, weight) in taps.weights.iter().enumerate() {
            let value = rows[(taps.first + offset) * side + column];
            (0..3).for_each(|channel| sum[channel] += weight * value[channel]);
        }
        sum.map(|value| value.round().clamp(0.0, 255.0) as u8)
    })
}

/// For each pixel of the result along an axis, the pixels that it is made of.
struct Taps(Vec<PixelTaps>);

struct PixelTaps {
    first: usize,
    /// Weights with the sum 1.
    weights: Vec<f32>,
}

impl Taps {
    fn new(from: usize, to: usize) -> Self {
        let scale = from as f32 / to as f32;
        let reach = scale.max(1.0);
        let of = |index: usize| {
            let center = (index as f32 + 0.5) * scale;
            let first = (center - reach).max(0.0) as usize;
            let end = ((center + reach).ceil() as usize).clamp(first + 1, from);
            let weight = |at: usize| (1.0 - (at as f32 + 0.5 - center).abs() / reach).max(0.0);
            let mut weights: Vec<f32> = (first..end).map(weight).collect();
            let sum: f32 = weights.iter().sum();
            weights.iter_mut().for_each(|weight| *weight /= sum.max(1e-6));
            PixelTaps { first, weights }
        };
        Self((0..to).map(of).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view(width: usize, height: usize) -> ObjectView {
        let image =
            Image::from_fn(width, height, |column, _| if column * 2 < width { [200, 0, 0] } else { [0, 0, 200] });
        let mask = Image::from_fn(width, height, |column, _| column * 2 < width);
        ObjectView { image, mask }
    }

    #[test]
    fn a_view_lies_in_the_middle_and_its_surroundings_are_dimmed() {
        for side in [16, 64, 300] {
            let [whole, dimmed] = crops(&view(80, 40), side);
            assert_eq!((whole.size(), dimmed.size()), ((side, side), (side, side)));
            assert_eq!(whole[(side / 4, side / 2)], [200, 0, 0]);
            assert_eq!(whole[(3 * side / 4, side / 2)], [0, 0, 200]);
            // Above and below the view.
            assert_eq!(whole[(side / 4, 0)], [100, 0, 100]);
            assert_eq!(dimmed[(side / 4, side / 2)], [200, 0, 0]);
            assert_eq!(dimmed[(3 * side / 4, side / 2)], [80, 0, 120]);
        }
        assert_eq!(crops(&view(1, 1), 8)[0].size(), (8, 8));
    }
}
