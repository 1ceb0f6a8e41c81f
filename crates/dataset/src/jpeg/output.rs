//! From components to pixels.

use super::color::{ColorModel, from_ycbcr};
use super::frame::{Frame, Plane};
use super::upsample::Upsampler;
use splatseg_geometry::Image;

/// The image as sRGB. There is a plane for each component.
pub(super) fn image(frame: &Frame, planes: &[Plane], model: ColorModel) -> Image<[u8; 3]> {
    let mut image = Image::filled(frame.width, frame.height, [0; 3]);
    let components = frame.components.iter().zip(planes);
    let mut rows: Vec<Upsampler> =
        components.map(|(component, plane)| Upsampler::new(frame, component, plane)).collect();
    for (row, pixels) in image.pixels_mut().chunks_exact_mut(frame.width).enumerate() {
        match &mut rows[..] {
            [only] => grey(only.row(row), pixels),
            [first, second, third] => {
                let samples = [first, second, third].map(|component| &component.row(row)[..pixels.len()]);
                match model {
                    ColorModel::YCbCr => from_ycbcr(samples, pixels),
                    ColorModel::Rgb | ColorModel::Grey => as_is(samples, pixels),
                }
            }
            _ => {}
        }
    }
    image
}

fn grey(samples: &[u8], pixels: &mut [[u8; 3]]) {
    for (pixel, sample) in pixels.iter_mut().zip(samples) {
        *pixel = [*sample; 3];
    }
}

fn as_is([red, green, blue]: [&[u8]; 3], pixels: &mut [[u8; 3]]) {
    for (((pixel, red), green), blue) in pixels.iter_mut().zip(red).zip(green).zip(blue) {
        *pixel = [*red, *green, *blue];
    }
}
