//! The images of an object for a network: its view with some of its surroundings, and the same with these dimmed.

use splatseg_geometry::Image;
use splatseg_imaging::{ImageMap, resample_color};
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

/// An image in the middle of a square of a colour, resampled to sides of `side` pixels.
fn square(image: &Image<[u8; 3]>, around: [u8; 3], side: usize) -> Image<[u8; 3]> {
    let longest = image.width().max(image.height());
    let (left, top) = ((longest - image.width()) / 2, (longest - image.height()) / 2);
    let mut padded = Image::filled(longest, longest, around);
    for row in 0..image.height() {
        let start = (top + row) * longest + left;
        padded.pixels_mut()[start..start + image.width()].copy_from_slice(image.row(row));
    }
    resample_color(&padded, &ImageMap::resize((longest, longest), (side, side)))
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
