//! Decoding of images from files that may be damaged, truncated, or have a false size in their header.

use crate::DatasetError;
use crate::depth_scale::DepthScale;
use crate::error::{COLOR_IMAGE, DEPTH_IMAGE, SEGMENT_IMAGE};
use crate::files::{MemoryRequirement, read_file};
use image::error::{DecodingError, ImageFormatHint};
use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, ImageError, ImageFormat, ImageReader, Limits};
use splatseg_geometry::{Image, SegmentMap};
use splatseg_jpeg::{Jpeg, JpegError};
use std::io::Cursor;
use std::path::Path;

/// Larger files are not frames of a video.
pub(crate) const MAX_IMAGE_FILE_BYTES: u64 = 256 << 20;
/// Larger images are not frames of a video.
pub(crate) const MAX_PIXELS: u64 = 1 << 26;
/// The highest compression ratio of DEFLATE, as used in PNG and zlib.
pub(crate) const MAX_DEFLATE_RATIO: u64 = 1032;
/// Maximum memory for reading an image, bytes per pixel: up to 8 in the decoder, up to 4 in the result, and as many in
/// the file.
const DECODING_BYTES_PER_PIXEL: u64 = 16;
/// Maximum unpacked size of the PNG chunks other than pixels. Colour profiles and text are not used.
const MAX_CHUNK_BYTES: u64 = 4 << 20;
/// Maximum number of pixels per byte of a file. A PNG pixel may have only one bit, and JPEG cannot do better.
const MAX_PIXELS_PER_BYTE: u64 = 8 * MAX_DEFLATE_RATIO;

/// Colour types in a PNG header.
const GREY: u8 = 0;
const RGB: u8 = 2;

/// Reads the bytes of an image file.
pub(crate) fn read_image_file(path: &Path, what: &'static str) -> Result<Vec<u8>, DatasetError> {
    read_file(path, what, MAX_IMAGE_FILE_BYTES)
}

/// Reads the `(width, height)` stated in an image file's header.
pub(crate) fn image_size(path: &Path, what: &'static str) -> Result<(usize, usize), DatasetError> {
    encoded_size(path, what, &read_image_file(path, what)?)
}

/// Reads a colour image (JPEG or PNG, any pixel format) as sRGB, `[height, width]`.
///
/// JPEG pixels equal those of libjpeg-turbo, and therefore of Pillow and OpenCV. The orientation tag is ignored,
/// because depth images have none.
///
/// # Errors
/// If the file cannot be read, is damaged, or is too large to be a frame of a video.
pub fn read_color_image(path: &Path) -> Result<Image<[u8; 3]>, DatasetError> {
    read_color(path)
}

/// [`read_color_image`], under the name used by the scenes.
pub(crate) fn read_color(path: &Path) -> Result<Image<[u8; 3]>, DatasetError> {
    decode_color(path, &read_image_file(path, COLOR_IMAGE)?)
}

/// Reads a segment map, `[height, width]`, from a PNG in either form written by `splatseg run`: 8- or 16-bit grey with
/// one value per segment, or 8-bit RGB as in COCO's panoptic format, id = R + 256 G + 65536 B.
///
/// # Errors
/// [`DatasetError`] if the file is missing or damaged, is any other kind of image (palettes, transparency and fewer
/// bits do not hold ids), or exceeds the memory limit.
pub fn read_segments_png(path: &Path) -> Result<SegmentMap, DatasetError> {
    let bytes = read_image_file(path, SEGMENT_IMAGE)?;
    let file = EncodedImage::new(path, SEGMENT_IMAGE, &bytes)?;
    file.require_png(&[(GREY, 8), (GREY, 16), (RGB, 8)], "a PNG with 8- or 16-bit grey or 8-bit RGB")?;
    if file.png_color_type() == Some(RGB) { decode_panoptic(path, &bytes) } else { decode_labels(path, &bytes) }
}

/// Reads the labels of a scene, `[height, width]`, from an 8- or 16-bit grey PNG.
pub(crate) fn read_labels(path: &Path) -> Result<SegmentMap, DatasetError> {
    decode_labels(path, &read_image_file(path, SEGMENT_IMAGE)?)
}

/// Checks that an image of `size` `(width, height)` can be read within the memory limit.
pub(crate) fn require_decoding_memory(
    path: &Path,
    what: &'static str,
    size: (usize, usize),
) -> Result<(), DatasetError> {
    let remedy = "raise --memory-limit, or store smaller images";
    MemoryRequirement { what, size, bytes_per_pixel: DECODING_BYTES_PER_PIXEL, remedy }.check(path)
}

/// Like [`image_size`], but from a file's bytes. `path` is named in errors.
pub(crate) fn encoded_size(path: &Path, what: &'static str, bytes: &[u8]) -> Result<(usize, usize), DatasetError> {
    let file = EncodedImage::new(path, what, bytes)?;
    let (width, height) = match file.jpeg()? {
        Some(jpeg) => jpeg.size(),
        None => file.decoder()?.dimensions(),
    };
    Ok((width as usize, height as usize))
}

/// Returns how an image says that it is to be turned, from a file's bytes; not at all if it does not say, or cannot be read.
pub(crate) fn orientation(path: &Path, bytes: &[u8]) -> Orientation {
    let file = EncodedImage::new(path, COLOR_IMAGE, bytes);
    let stated = file.ok().and_then(|file| file.decoder().ok()?.orientation().ok());
    stated.unwrap_or(Orientation::NoTransforms)
}

/// Like [`read_color`], but from a file's bytes.
pub(crate) fn decode_color(path: &Path, bytes: &[u8]) -> Result<Image<[u8; 3]>, DatasetError> {
    let file = EncodedImage::new(path, COLOR_IMAGE, bytes)?;
    if let Some(image) = file.decode_jpeg()? {
        return Ok(image);
    }
    let pixels = file.decode()?.into_rgb8();
    let (width, height) = (pixels.width() as usize, pixels.height() as usize);
    Ok(Image::from_fn(width, height, |column, row| pixels.get_pixel(column as u32, row as u32).0))
}

/// Decodes a depth image, `[height, width]`, in metres from a 16-bit grey PNG. 0 and 65535 mean missing depth and become 0.
pub(crate) fn decode_depth(path: &Path, bytes: &[u8], scale: DepthScale) -> Result<Image<f32>, DatasetError> {
    let stored = decode_grey16(path, DEPTH_IMAGE, bytes)?;
    Ok(stored.map(|stored| scale.metres(*stored)))
}

/// Decodes the values of a 16-bit grey PNG, `[height, width]`. `what` names the image in errors.
pub(crate) fn decode_grey16(path: &Path, what: &'static str, bytes: &[u8]) -> Result<Image<u16>, DatasetError> {
    let file = EncodedImage::new(path, what, bytes)?;
    let expected = "a PNG with 16-bit grey";
    file.require_png(&[(GREY, 16)], expected)?;
    let DynamicImage::ImageLuma16(pixels) = file.decode()? else {
        return Err(file.pixel_kind("grey with transparent".to_owned(), expected));
    };
    Ok(Image::from_fn(pixels.width() as usize, pixels.height() as usize, |column, row| {
        pixels.get_pixel(column as u32, row as u32).0[0]
    }))
}

/// Like [`read_labels`], but from a file's bytes.
pub(crate) fn decode_labels(path: &Path, bytes: &[u8]) -> Result<SegmentMap, DatasetError> {
    decode_grey(path, SEGMENT_IMAGE, bytes)
}

/// Reads an 8- or 16-bit grey PNG, `[height, width]`. `what` names the image in errors.
pub(crate) fn read_grey(path: &Path, what: &'static str) -> Result<Image<u32>, DatasetError> {
    decode_grey(path, what, &read_image_file(path, what)?)
}

/// Like [`read_grey`], but from a file's bytes.
fn decode_grey(path: &Path, what: &'static str, bytes: &[u8]) -> Result<Image<u32>, DatasetError> {
    let file = EncodedImage::new(path, what, bytes)?;
    let expected = "a PNG with 8- or 16-bit grey";
    file.require_png(&[(GREY, 8), (GREY, 16)], expected)?;
    match file.decode()? {
        DynamicImage::ImageLuma8(pixels) => {
            Ok(labels_from(pixels.width(), pixels.height(), pixels.pixels().map(|pixel| u32::from(pixel.0[0]))))
        }
        DynamicImage::ImageLuma16(pixels) => {
            Ok(labels_from(pixels.width(), pixels.height(), pixels.pixels().map(|pixel| u32::from(pixel.0[0]))))
        }
        _ => Err(file.pixel_kind("grey with transparent".to_owned(), expected)),
    }
}

/// Decodes segment ids, `[height, width]`, from a PNG in COCO's panoptic format: R + 256 G + 65536 B.
pub(crate) fn decode_panoptic(path: &Path, bytes: &[u8]) -> Result<SegmentMap, DatasetError> {
    let file = EncodedImage::new(path, SEGMENT_IMAGE, bytes)?;
    let expected = "a PNG with 8-bit RGB";
    file.require_png(&[(RGB, 8)], expected)?;
    let DynamicImage::ImageRgb8(pixels) = file.decode()? else {
        return Err(file.pixel_kind("RGB with transparent".to_owned(), expected));
    };
    let ids = pixels.pixels().map(|pixel| u32::from_le_bytes([pixel.0[0], pixel.0[1], pixel.0[2], 0]));
    Ok(labels_from(pixels.width(), pixels.height(), ids))
}

fn labels_from(width: u32, height: u32, mut ids: impl Iterator<Item = u32>) -> SegmentMap {
    Image::from_fn(width as usize, height as usize, |_, _| ids.next().unwrap_or(0))
}

/// An encoded image file.
struct EncodedImage<'a> {
    path: &'a Path,
    what: &'static str,
    bytes: &'a [u8],
    format: ImageFormat,
}

impl<'a> EncodedImage<'a> {
    fn new(path: &'a Path, what: &'static str, bytes: &'a [u8]) -> Result<Self, DatasetError> {
        let format =
            image::guess_format(bytes).map_err(|source| DatasetError::Image { path: path.to_owned(), what, source })?;
        Ok(Self { path, what, bytes, format })
    }

    fn pixel_kind(&self, found: String, expected: &'static str) -> DatasetError {
        DatasetError::PixelKind { path: self.path.to_owned(), what: self.what, found, expected }
    }

    /// Checks that the image has one of these `(colour type, bit depth)`. Reads the header itself, because the decoder
    /// would widen 1-, 2- and 4-bit pixels and look up palettes, both of which change ids.
    fn require_png(&self, kinds: &[(u8, u8)], expected: &'static str) -> Result<(), DatasetError> {
        if self.format != ImageFormat::Png {
            return Err(self.pixel_kind(format!("{:?}", self.format), expected));
        }
        // Signature (8 bytes), length and "IHDR" (8), width and height (8), bit depth, colour type.
        let (Some(bit_depth), Some(color_type)) = (self.bytes.get(24), self.png_color_type()) else {
            return Ok(()); // Shorter than a header: decoding reports the error.
        };
        if kinds.contains(&(color_type, *bit_depth)) {
            return Ok(());
        }
        let kind = match color_type {
            GREY => "grey",
            RGB => "RGB",
            3 => "palette",
            4 => "grey with alpha",
            6 => "RGBA",
            _ => "unknown",
        };
        Err(self.pixel_kind(format!("{bit_depth}-bit {kind}"), expected))
    }

    /// Returns the colour type in a PNG header.
    fn png_color_type(&self) -> Option<u8> {
        self.bytes.get(25).copied()
    }

    fn decoding_failed(&self, source: image::ImageError) -> DatasetError {
        DatasetError::Image { path: self.path.to_owned(), what: self.what, source }
    }

    /// Reads the header of a JPEG and checks its size. `None` for other formats and for kinds of JPEG left to
    /// [`image`].
    fn jpeg(&self) -> Result<Option<Jpeg<'a>>, DatasetError> {
        if self.format != ImageFormat::Jpeg {
            return Ok(None);
        }
        match Jpeg::read_header(self.bytes) {
            Ok(jpeg) => self.check_size(jpeg.size()).map(|()| Some(jpeg)),
            Err(JpegError::Unsupported(_)) => Ok(None),
            Err(error) => Err(self.jpeg_failed(error)),
        }
    }

    /// Decodes a JPEG. `None` for other formats and for kinds of JPEG left to [`image`].
    fn decode_jpeg(&self) -> Result<Option<Image<[u8; 3]>>, DatasetError> {
        self.require_end()?;
        let Some(jpeg) = self.jpeg()? else { return Ok(None) };
        let (width, height) = jpeg.size();
        match jpeg.decode() {
            Ok(pixels) => Image::from_pixels(width as usize, height as usize, pixels)
                .map(Some)
                .map_err(|error| self.jpeg_failed(error)),
            Err(JpegError::Unsupported(_)) => Ok(None),
            Err(error) => Err(self.jpeg_failed(error)),
        }
    }

    fn jpeg_failed(&self, error: impl std::error::Error + Send + Sync + 'static) -> DatasetError {
        let hint = ImageFormatHint::Exact(ImageFormat::Jpeg);
        self.decoding_failed(ImageError::Decoding(DecodingError::new(hint, error)))
    }

    fn check_size(&self, size: (u32, u32)) -> Result<(), DatasetError> {
        check_stated_size(self.path, self.what, self.bytes.len(), size)
    }

    /// Returns a decoder that has read the header, and checks the size it states.
    fn decoder(&self) -> Result<impl ImageDecoder + '_, DatasetError> {
        let mut reader = ImageReader::with_format(Cursor::new(self.bytes), self.format);
        if let Some((width, height)) = self.png_size() {
            self.check_size((width, height))?;
            // The PNG decoder counts one row of up to 8 bytes per pixel, and the unpacked size of chunks.
            let mut limits = Limits::no_limits();
            limits.max_alloc = Some(u64::from(width) * 8 + MAX_CHUNK_BYTES);
            reader.limits(limits);
        }
        let decoder = reader.into_decoder().map_err(|source| self.decoding_failed(source))?;
        self.check_size(decoder.dimensions())?;
        Ok(decoder)
    }

    /// Returns the size in a PNG header, which precedes everything else. `None` for other formats.
    fn png_size(&self) -> Option<(u32, u32)> {
        let side = |at: usize| Some(u32::from_be_bytes(self.bytes.get(at..at + 4)?.try_into().ok()?));
        if self.format == ImageFormat::Png { Some((side(16)?, side(20)?)) } else { None }
    }

    /// Checks that a JPEG is not truncated.
    fn require_end(&self) -> Result<(), DatasetError> {
        if self.format == ImageFormat::Jpeg && jpeg_is_cut_off(self.bytes) {
            return Err(DatasetError::CutOff { path: self.path.to_owned(), what: self.what });
        }
        Ok(())
    }

    fn decode(&self) -> Result<DynamicImage, DatasetError> {
        self.require_end()?;
        DynamicImage::from_decoder(self.decoder()?).map_err(|source| self.decoding_failed(source))
    }
}

/// Checks a size that a header states before memory is taken for it. `bytes` is the length of the file.
pub(crate) fn check_stated_size(
    path: &Path,
    what: &'static str,
    bytes: usize,
    (width, height): (u32, u32),
) -> Result<(), DatasetError> {
    let pixels = u64::from(width) * u64::from(height);
    if pixels > MAX_PIXELS || pixels > bytes as u64 * MAX_PIXELS_PER_BYTE {
        let path = path.to_owned();
        return Err(DatasetError::ImplausibleSize { path, what, width, height, bytes, limit: MAX_PIXELS });
    }
    require_decoding_memory(path, what, (width as usize, height as usize))
}

/// Returns true if a JPEG is truncated. The decoder of `image` silently fills the rest with grey. Compressed data
/// contains no markers, so an end marker must follow the last start of a scan.
fn jpeg_is_cut_off(bytes: &[u8]) -> bool {
    let last = |marker: u8| bytes.windows(2).rposition(|pair| pair == [0xFF, marker]);
    match (last(0xDA), last(0xD9)) {
        (Some(scan), Some(end)) => end < scan,
        _ => true,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn jpeg_needs_an_end() {
        assert!(jpeg_is_cut_off(&[0xFF, 0xD8, 0xFF, 0xDA, 1, 2]));
        assert!(jpeg_is_cut_off(&[0xFF, 0xD8, 0xFF, 0xD9, 0xFF, 0xDA, 1, 2]));
        assert!(!jpeg_is_cut_off(&[0xFF, 0xD8, 0xFF, 0xDA, 1, 2, 0xFF, 0xD9, 0]));
    }
}
