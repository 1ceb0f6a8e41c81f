//! Conversion from components to pixels.

use super::color::{ColorModel, from_ycbcr};
use super::frame::{Frame, Plane};
use super::upsample::Upsampler;

/// Converts the planes, one for each component, to row-major RGB pixels.
pub(super) fn pixels(frame: &Frame, planes: &[Plane], model: ColorModel) -> Vec<[u8; 3]> {
    let mut image = vec![[0; 3]; frame.width * frame.height];
    let components = frame.components.iter().zip(planes);
    let mut rows: Vec<Upsampler> =
        components.map(|(component, plane)| Upsampler::new(frame, component, plane)).collect();
    for (row, pixels) in image.chunks_exact_mut(frame.width).enumerate() {
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
