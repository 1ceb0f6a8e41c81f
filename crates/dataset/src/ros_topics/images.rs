//! Decoding of image messages.

use super::compressed_depth::{decode_compressed_depth, image_part, rvl_size};
use crate::DatasetError;
use crate::decode::{MAX_PIXELS, decode_color, decode_depth, encoded_size, require_decoding_memory};
use crate::depth_scale::DepthScale;
use crate::error::{COLOR_IMAGE, DEPTH_IMAGE};
use splatseg_geometry::Image;
use splatseg_ros::{CompressedImage, Image as RawImage};
use std::path::Path;

/// Supported colour encodings, for messages.
pub(crate) const COLOR_ENCODINGS: &str =
    "rgb8, bgr8, rgba8, bgra8, mono8, yuv422 (uyvy), yuv422_yuy2 (yuyv), nv12, or CompressedImage with JPEG or PNG";
/// Supported depth encodings, for messages.
pub(crate) const DEPTH_ENCODINGS: &str =
    "16UC1, mono16, 32FC1, or CompressedImage with PNG of 16 bits or compressedDepth";

/// Encoding of Orbbec's images that are JPEG files.
const JPEG: &str = "mjpg";
/// First bytes of every PNG, and the place of its bit depth.
const PNG_START: &[u8] = b"\x89PNG";
const BIT_DEPTH_AT: usize = 24;

/// Kind of an image, according to its encoding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ImageKind {
    Color,
    /// Grey: used as colour if there is no other, but often infrared.
    Grey,
    Depth,
    /// Depth that was converted to 8 bits, as by a JPEG: most of its precision is lost, so it is not used.
    EightBitDepth,
    /// Unsupported.
    Other,
}

/// Pixel format of colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ColorEncoding {
    /// Bytes per pixel, and the offsets of red, green and blue.
    Bytes(usize, [usize; 3]),
    /// Two pixels in four bytes: offsets of both luma values, then of the two chroma values.
    Pairs([usize; 4]),
    /// A plane of luma, then rows of both chroma values for every second row and column.
    Planes,
}

fn color_encoding(encoding: &str) -> Option<ColorEncoding> {
    Some(match encoding {
        "rgb8" => ColorEncoding::Bytes(3, [0, 1, 2]),
        "bgr8" => ColorEncoding::Bytes(3, [2, 1, 0]),
        "rgba8" => ColorEncoding::Bytes(4, [0, 1, 2]),
        "bgra8" => ColorEncoding::Bytes(4, [2, 1, 0]),
        "mono8" => ColorEncoding::Bytes(1, [0, 0, 0]),
        "yuv422" | "uyvy" | "UYVY" => ColorEncoding::Pairs([1, 3, 0, 2]),
        "yuv422_yuy2" | "yuyv" | "YUYV" => ColorEncoding::Pairs([0, 2, 1, 3]),
        "nv12" => ColorEncoding::Planes,
        _ => return None,
    })
}

/// Returns true if the name of a topic says that it has depth: `mono16` may also be infrared.
fn is_named_depth(topic: &str) -> bool {
    topic.to_ascii_lowercase().contains("depth")
}

/// Returns the kind of a `sensor_msgs/msg/Image`.
pub(crate) fn raw_kind(topic: &str, encoding: &str) -> ImageKind {
    match encoding {
        "mono8" => ImageKind::Grey,
        "16UC1" | "32FC1" => ImageKind::Depth,
        // Infrared cameras use it, too.
        "mono16" if is_named_depth(topic) => ImageKind::Depth,
        JPEG => ImageKind::Color,
        encoding if color_encoding(encoding).is_some() => ImageKind::Color,
        _ => ImageKind::Other,
    }
}

/// Returns the kind of a `sensor_msgs/msg/CompressedImage`.
pub(crate) fn compressed_kind(topic: &str, message: &CompressedImage<'_>) -> ImageKind {
    if is_compressed_depth(message.format) {
        return ImageKind::Depth;
    }
    let is_file = message.data.starts_with(b"\xFF\xD8") || message.data.starts_with(b"\x89PNG");
    // Original encoding, if the driver states it.
    match message.format.split(';').next().unwrap_or_default().trim() {
        _ if !is_file => ImageKind::Other,
        "mono8" => ImageKind::Grey,
        "16UC1" | "32FC1" => depth_kind(message.data),
        "mono16" if is_named_depth(topic) => depth_kind(message.data),
        "mono16" => ImageKind::Other,
        // Bit depth and colour type of a PNG.
        _ if message.data.starts_with(b"\x89PNG") && message.data.get(24..26) == Some(&[16, 0]) => ImageKind::Depth,
        _ => ImageKind::Color,
    }
}

/// Returns the kind of an image file that was made of depth.
fn depth_kind(data: &[u8]) -> ImageKind {
    let is_deep = data.starts_with(PNG_START) && data.get(BIT_DEPTH_AT).is_none_or(|bits| *bits == 16);
    if is_deep { ImageKind::Depth } else { ImageKind::EightBitDepth }
}

/// Returns the size of a compressed image, `(width, height)`, if its header can be read.
pub(crate) fn compressed_size(message: &CompressedImage<'_>) -> Option<(usize, usize)> {
    let data = if is_compressed_depth(message.format) { image_part(message.data) } else { message.data };
    if data.starts_with(b"\xFF\xD8") || data.starts_with(PNG_START) {
        encoded_size(Path::new(""), COLOR_IMAGE, data).ok()
    } else {
        is_compressed_depth(message.format).then(|| rvl_size(data)).flatten()
    }
}

fn is_compressed_depth(format: &str) -> bool {
    format.to_ascii_lowercase().contains("compresseddepth")
}

/// Decodes a colour image. `path` is named in errors.
pub(crate) fn raw_color(message: &RawImage<'_>, path: &Path) -> Result<Image<[u8; 3]>, DatasetError> {
    if message.encoding == JPEG {
        return decode_color(path, message.data);
    }
    let encoding = color_encoding(message.encoding)
        .ok_or_else(|| unknown_encoding(path, COLOR_IMAGE, message.encoding, COLOR_ENCODINGS))?;
    let (width, row_bytes) = match encoding {
        ColorEncoding::Bytes(bytes, _) => (message.width as usize, (message.width as usize).saturating_mul(bytes)),
        ColorEncoding::Pairs(_) => (message.width as usize, (message.width as usize).div_ceil(2).saturating_mul(4)),
        ColorEncoding::Planes => return planes_color(message, path),
    };
    let rows = rows(message, row_bytes, COLOR_IMAGE, path)?;
    let mut pixels = Vec::with_capacity(width * message.height as usize);
    for row in rows {
        match encoding {
            ColorEncoding::Bytes(bytes, places) => pixels.extend(
                row.chunks_exact(bytes).map(|pixel| places.map(|at| pixel.get(at).copied().unwrap_or_default())),
            ),
            ColorEncoding::Pairs(places) => {
                let start = pixels.len();
                for pair in row.as_chunks::<4>().0 {
                    let [first, second, u, v] = places.map(|at| pair.get(at).copied().unwrap_or_default());
                    pixels.extend([rgb_of(first, u, v), rgb_of(second, u, v)]);
                }
                pixels.truncate(start + width);
            }
            ColorEncoding::Planes => {}
        }
    }
    image_of(message, pixels, path)
}

/// Decodes a colour image in two planes (NV12).
fn planes_color(message: &RawImage<'_>, path: &Path) -> Result<Image<[u8; 3]>, DatasetError> {
    let (width, height) = (message.width as usize, message.height as usize);
    let luma = RawImage { data: message.data, ..message.clone() };
    let luma: Vec<&[u8]> = rows(&luma, width, COLOR_IMAGE, path)?.collect();
    let start = (message.step as usize).saturating_mul(height);
    let chroma = RawImage {
        width: message.width.div_ceil(2),
        height: message.height.div_ceil(2),
        data: message.data.get(start..).unwrap_or_default(),
        ..message.clone()
    };
    let chroma: Vec<&[u8]> = rows(&chroma, width.div_ceil(2) * 2, COLOR_IMAGE, path)?.collect();
    let at = |plane: &[&[u8]], row: usize, column: usize| plane.get(row).and_then(|row| row.get(column)).copied();
    let pixels = (0..height).flat_map(|row| (0..width).map(move |column| (row, column))).map(|(row, column)| {
        let [u, v] = [0, 1].map(|part| at(&chroma, row / 2, column / 2 * 2 + part).unwrap_or_default());
        rgb_of(at(&luma, row, column).unwrap_or_default(), u, v)
    });
    image_of(message, pixels.collect(), path)
}

/// Decodes a depth image, metres. `path` is named in errors. Without `scale`, whole numbers are millimetres and others
/// metres.
pub(crate) fn raw_depth(
    message: &RawImage<'_>,
    scale: Option<DepthScale>,
    path: &Path,
) -> Result<Image<f32>, DatasetError> {
    let width = message.width as usize;
    let is_big_endian = message.is_bigendian != 0;
    let mut pixels = Vec::new();
    match message.encoding {
        "16UC1" | "mono16" => {
            let scale = scale.unwrap_or(DepthScale::MILLIMETRES);
            for row in rows(message, width.saturating_mul(2), DEPTH_IMAGE, path)? {
                let number = |bytes: &[u8; 2]| {
                    if is_big_endian { u16::from_be_bytes(*bytes) } else { u16::from_le_bytes(*bytes) }
                };
                pixels.extend(row.as_chunks().0.iter().map(|bytes| scale.metres(number(bytes))));
            }
        }
        "32FC1" => {
            let scale = scale.unwrap_or(DepthScale::METRES);
            for row in rows(message, width.saturating_mul(4), DEPTH_IMAGE, path)? {
                let number = |bytes: &[u8; 4]| {
                    if is_big_endian { f32::from_be_bytes(*bytes) } else { f32::from_le_bytes(*bytes) }
                };
                pixels.extend(row.as_chunks().0.iter().map(|bytes| scale.measured(number(bytes))));
            }
        }
        other => return Err(unknown_encoding(path, DEPTH_IMAGE, other, DEPTH_ENCODINGS)),
    }
    image_of(message, pixels, path)
}

/// Every Nth row is read to find the order of bytes.
const ORDER_ROWS: usize = 8;
/// The other order of bytes is that of the numbers if neighbours differ by this many times less in it.
const SMOOTHER: u64 = 20;

/// Returns true if the numbers of a depth image of 16 bits have the other order of bytes than the message says: they are far
/// smoother then. Numbers that need one byte only say nothing.
pub(crate) fn has_swapped_bytes(message: &RawImage<'_>) -> bool {
    let row_bytes = (message.width as usize).saturating_mul(2);
    if !matches!(message.encoding, "16UC1" | "mono16") || message.step == 0 || row_bytes == 0 {
        return false;
    }
    let (mut as_stated, mut swapped, mut pairs, mut of_two_bytes) = (0_u64, 0_u64, 0_u64, 0_u64);
    let rows = message.data.chunks(message.step as usize).step_by(ORDER_ROWS);
    for row in rows.filter_map(|row| row.get(..row_bytes)) {
        for [one, next] in row.as_chunks::<2>().0.array_windows() {
            if *one == [0; 2] || *next == [0; 2] {
                continue;
            }
            let differences = [u16::from_le_bytes, u16::from_be_bytes].map(|read| read(*one).abs_diff(read(*next)));
            let [little, big] = differences.map(u64::from);
            let (stated, other) = if message.is_bigendian == 0 { (little, big) } else { (big, little) };
            (as_stated, swapped) = (as_stated + stated, swapped + other);
            (pairs, of_two_bytes) = (pairs + 1, of_two_bytes + u64::from(!one.contains(&0)));
        }
    }
    2 * of_two_bytes > pairs && as_stated > pairs && as_stated > SMOOTHER * swapped
}

/// Decodes a compressed colour image. `path` is named in errors.
pub(crate) fn compressed_color(message: &CompressedImage<'_>, path: &Path) -> Result<Image<[u8; 3]>, DatasetError> {
    decode_color(path, message.data)
}

/// Decodes a compressed depth image, metres. `path` is named in errors. For `scale`, see [`raw_depth`].
pub(crate) fn compressed_depth(
    message: &CompressedImage<'_>,
    scale: Option<DepthScale>,
    path: &Path,
) -> Result<Image<f32>, DatasetError> {
    if is_compressed_depth(message.format) {
        return decode_compressed_depth(path, message.format, message.data, scale);
    }
    decode_depth(path, message.data, scale.unwrap_or(DepthScale::MILLIMETRES))
}

/// Returns the rows of an image, `row_bytes` each, without padding.
fn rows<'a>(
    message: &RawImage<'a>,
    row_bytes: usize,
    what: &'static str,
    path: &Path,
) -> Result<impl Iterator<Item = &'a [u8]>, DatasetError> {
    let (width, height) = (message.width, message.height);
    let wrong = |field: &str, found: String, expected: String| DatasetError::Field {
        path: path.to_owned(),
        field: format!("{what}, {field}"),
        found,
        expected,
    };
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 || pixels > MAX_PIXELS {
        return Err(wrong("size", format!("{width}x{height}"), format!("1 to {MAX_PIXELS} pixels")));
    }
    let step = message.step as usize;
    if step < row_bytes {
        let expected = format!("at least {row_bytes}, for {width} pixels of {}", message.encoding);
        return Err(wrong("step", step.to_string(), expected));
    }
    // The last row may lack its padding.
    let needed = (height as usize - 1).saturating_mul(step).saturating_add(row_bytes);
    if message.data.len() < needed {
        return Err(wrong(
            "data",
            format!("{} bytes", message.data.len()),
            format!("{needed}, for {height} rows of {step}"),
        ));
    }
    require_decoding_memory(path, what, (width as usize, height as usize))?;
    Ok(message.data.chunks(step).take(height as usize).filter_map(move |row| row.get(..row_bytes)))
}

fn image_of<T: Clone>(message: &RawImage<'_>, pixels: Vec<T>, path: &Path) -> Result<Image<T>, DatasetError> {
    Image::from_pixels(message.width as usize, message.height as usize, pixels)
        .map_err(|error| DatasetError::Other { scene: path.display().to_string(), source: error.into() })
}

fn unknown_encoding(path: &Path, what: &str, found: &str, expected: &str) -> DatasetError {
    DatasetError::Field {
        path: path.to_owned(),
        field: format!("{what}, encoding"),
        found: format!("{:?}", found.chars().take(40).collect::<String>()),
        expected: expected.to_owned(),
    }
}

/// Converts luma and chroma to RGB (ITU-R BT.601 with luma from 16 to 235, as in cameras and OpenCV).
fn rgb_of(y: u8, u: u8, v: u8) -> [u8; 3] {
    // Factors times 2^20.
    const Y: i64 = 1_220_542;
    const U_TO_BLUE: i64 = 2_116_026;
    const U_TO_GREEN: i64 = -409_993;
    const V_TO_GREEN: i64 = -852_492;
    const V_TO_RED: i64 = 1_673_527;
    let luma = (i64::from(y) - 16).max(0) * Y + (1 << 19);
    let (u, v) = (i64::from(u) - 128, i64::from(v) - 128);
    [V_TO_RED * v, V_TO_GREEN * v + U_TO_GREEN * u, U_TO_BLUE * u]
        .map(|difference| ((luma + difference) >> 20).clamp(0, 255) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn raw<'a>(encoding: &'a str, (width, height): (u32, u32), step: u32, data: &'a [u8]) -> RawImage<'a> {
        RawImage { height, width, encoding, step, data, ..Default::default() }
    }

    #[test]
    fn every_order_of_bytes_gives_the_same_colour() {
        let (rgb, padded) = ([10, 20, 30, 40, 50, 60], 8);
        for (encoding, data) in [
            ("rgb8", vec![10, 20, 30, 40, 50, 60, 9, 9, 10, 20, 30, 40, 50, 60]),
            ("bgr8", vec![30, 20, 10, 60, 50, 40, 9, 9, 30, 20, 10, 60, 50, 40]),
            ("rgba8", vec![10, 20, 30, 7, 40, 50, 60, 7, 10, 20, 30, 7, 40, 50, 60, 7]),
            ("bgra8", vec![30, 20, 10, 7, 60, 50, 40, 7, 30, 20, 10, 7, 60, 50, 40, 7]),
        ] {
            let image = raw_color(&raw(encoding, (2, 2), padded, &data), Path::new("a")).unwrap();
            assert_eq!(image.pixels().as_flattened(), [rgb, rgb].as_flattened(), "{encoding}");
        }
        let grey = raw_color(&raw("mono8", (2, 1), 2, &[5, 6]), Path::new("a")).unwrap();
        assert_eq!(grey.pixels(), [[5; 3], [6; 3]]);
    }

    #[test]
    fn numbers_that_are_no_depth_are_missing() {
        let numbers = [1.5_f32, 1e10, -1.0, f32::NAN, f32::INFINITY, 3.4e38];
        let data: Vec<u8> = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
        let depth = raw_depth(&raw("32FC1", (6, 1), 24, &data), None, Path::new("a")).unwrap();
        assert_eq!(depth.pixels(), [1.5, 0.0, 0.0, 0.0, 0.0, 0.0]);
    }

    #[test]
    fn the_order_of_bytes_is_that_in_which_depth_is_smooth() {
        let depth = |column: usize, row: usize| (900 + 3 * column + 40 * (column / 16) + 5 * row) as u16;
        let places = || (0..16).flat_map(|row| (0..64).map(move |column| (column, row)));
        let bytes = |write: fn(u16) -> [u8; 2], depth: &dyn Fn(usize, usize) -> u16| -> Vec<u8> {
            places().flat_map(|(column, row)| write(depth(column, row))).collect()
        };
        let is_swapped = |is_bigendian: u8, data: &[u8]| {
            has_swapped_bytes(&RawImage { is_bigendian, ..raw("16UC1", (64, 16), 128, data) })
        };
        let (little, big) = (bytes(u16::to_le_bytes, &depth), bytes(u16::to_be_bytes, &depth));
        assert_eq!([is_swapped(0, &little), is_swapped(1, &big)], [false; 2]);
        assert_eq!([is_swapped(0, &big), is_swapped(1, &little)], [true; 2]);
        // Numbers of one byte, a constant, noise, and nothing.
        let shallow = bytes(u16::to_le_bytes, &|column, row| ((column + row) << 8) as u16);
        let constant = bytes(u16::to_le_bytes, &|_, _| 1000);
        let noise = bytes(u16::to_le_bytes, &|column, row| (1 + column * 7919 + row * 104_729) as u16);
        for data in [&shallow, &constant, &noise, &vec![0; 2048]] {
            assert_eq!([is_swapped(0, data), is_swapped(1, data)], [false; 2]);
        }
        assert!(!has_swapped_bytes(&raw("16UC1", (0, 0), 0, &[])) && !is_swapped(0, &[1; 7]));
    }

    #[test]
    fn pairs_of_pixels_share_their_colour_difference() {
        // White, black, and the red, green and blue of BT.601.
        for (yuv, rgb) in [
            ([235, 128, 128], [255, 255, 255]),
            ([16, 128, 128], [0, 0, 0]),
            ([81, 90, 240], [254, 0, 0]),
            ([145, 54, 34], [0, 255, 1]),
            ([41, 240, 110], [0, 0, 255]),
        ] {
            let [y, u, v] = yuv;
            let uyvy = raw_color(&raw("yuv422", (2, 1), 4, &[u, y, v, y]), Path::new("a")).unwrap();
            let yuyv = raw_color(&raw("yuv422_yuy2", (2, 1), 4, &[y, u, y, v]), Path::new("a")).unwrap();
            for pixel in uyvy.pixels().iter().chain(yuyv.pixels()) {
                assert!(pixel.iter().zip(rgb).all(|(a, b)| a.abs_diff(b) <= 1), "{yuv:?}: {pixel:?}, not {rgb:?}");
            }
        }
        let planes = [[235, 235, 16, 16], [235, 235, 16, 16], [128, 128, 128, 128]].concat();
        let nv12 = raw_color(&raw("nv12", (4, 2), 4, &planes), Path::new("a")).unwrap();
        assert_eq!(nv12.row(1), [[255; 3], [255; 3], [0; 3], [0; 3]]);
        let red = raw_color(&raw("nv12", (2, 2), 2, &[81, 81, 81, 81, 90, 240]), Path::new("a")).unwrap();
        assert!(red.pixels().iter().all(|[r, g, b]| *r > 250 && *g < 4 && *b < 4), "{red:?}");
        assert!(raw_color(&raw("nv12", (2, 2), 2, &[81; 5]), Path::new("a")).is_err());
        let odd = raw_color(&raw("yuyv", (1, 2), 4, &[99; 8]), Path::new("a")).unwrap();
        assert_eq!(odd.size(), (1, 2));
    }

    #[test]
    fn depth_is_metres_in_both_byte_orders() {
        let depth = raw_depth(&raw("16UC1", (3, 1), 6, &[0xE8, 3, 0, 0, 0xFF, 0xFF]), None, Path::new("a")).unwrap();
        assert_eq!(depth.pixels(), [1.0, 0.0, 0.0]);
        let mut swapped = raw("16UC1", (1, 1), 2, &[3, 0xE8]);
        swapped.is_bigendian = 1;
        assert_eq!(raw_depth(&swapped, None, Path::new("a")).unwrap().pixels(), [1.0]);
        let stored = [1.5f32, 2.5].map(f32::to_le_bytes).concat();
        let padded = [&stored[..4], &[0; 4], &stored[4..]].concat();
        let scale = Some(DepthScale::of_format(5000.0));
        assert_eq!(raw_depth(&raw("16UC1", (1, 1), 2, &[0xC4, 9]), scale, Path::new("a")).unwrap().pixels(), [0.5]);
        let thousandths = Some(DepthScale::MILLIMETRES);
        let floats = raw_depth(&raw("32FC1", (1, 2), 8, &padded), thousandths, Path::new("a")).unwrap();
        assert_eq!(floats.pixels(), [0.0015, 0.0025]);
        assert_eq!(raw_depth(&raw("32FC1", (1, 2), 8, &padded), None, Path::new("a")).unwrap().pixels(), [1.5, 2.5]);
    }

    #[test]
    fn images_that_do_not_fit_their_bytes_are_errors() {
        for (message, text) in [
            (raw("rgb8", (2, 2), 6, &[0; 11]), "a: colour image, data: found 11 bytes, expected 12, for 2 rows of 6"),
            (
                raw("rgb8", (2, 2), 5, &[0; 99]),
                "a: colour image, step: found 5, expected at least 6, for 2 pixels of rgb8",
            ),
            (raw("rgb8", (0, 2), 0, &[]), "a: colour image, size: found 0x2, expected 1 to 67108864 pixels"),
            (
                raw("rgb8", (u32::MAX, u32::MAX), u32::MAX, &[]),
                "a: colour image, size: found 4294967295x4294967295, expected",
            ),
            (
                raw("bayer_rggb8", (2, 2), 2, &[0; 4]),
                "a: colour image, encoding: found \"bayer_rggb8\", expected rgb8,",
            ),
        ] {
            let error = raw_color(&message, Path::new("a")).unwrap_err().to_string();
            assert!(error.starts_with(text), "{error}");
        }
        let error = raw_depth(&raw("rgb8", (1, 1), 3, &[0; 3]), None, Path::new("a")).unwrap_err().to_string();
        assert!(error.starts_with("a: depth image, encoding: found \"rgb8\", expected 16UC1"), "{error}");
    }

    #[test]
    fn kinds_are_distinguished() {
        assert_eq!(raw_kind("/ir/image_raw", "mono16"), ImageKind::Other);
        assert_eq!(raw_kind("/depth/image_raw", "mono16"), ImageKind::Depth);
        assert_eq!(raw_kind("/a", "bayer_rggb8"), ImageKind::Other);
        let png = |bits: u8| [b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\x01\0\0\0\x01".as_slice(), &[bits, 0]].concat();
        let (deep, shallow) = (png(16), png(8));
        let kind = |format, data| compressed_kind("/a", &CompressedImage { format, data, ..Default::default() });
        assert_eq!(kind("rgb8; jpeg compressed bgr8", b"\xFF\xD8\xFF"), ImageKind::Color);
        assert_eq!(kind("mono8; jpeg compressed ", b"\xFF\xD8\xFF"), ImageKind::Grey);
        assert_eq!(kind("h264", b"\0\0\0\x01"), ImageKind::Other);
        assert_eq!(kind("16UC1; compressedDepth", b""), ImageKind::Depth);
        assert_eq!(kind("16UC1; png compressed ", b"\x89PNG"), ImageKind::Depth);
        assert_eq!(kind("16UC1; png compressed ", &deep), ImageKind::Depth);
        assert_eq!(kind("16UC1; png compressed ", &shallow), ImageKind::EightBitDepth);
        assert_eq!(kind("16UC1; jpeg compressed mono8", b"\xFF\xD8\xFF"), ImageKind::EightBitDepth);
        assert_eq!(kind("32FC1; jpeg compressed mono8", b"\xFF\xD8\xFF"), ImageKind::EightBitDepth);
    }
}
