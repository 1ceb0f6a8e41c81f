//! Messages with depth.

use super::frame_messages::{in_camera, number};
use splatseg_dataset::whole_millimetres;
use splatseg_ros::{Image, Time};
use std::io;

/// The pixels of a depth image, little-endian. What is read from them equals the depth.
pub struct DepthPixels {
    format: DepthFormat,
    bytes: Vec<u8>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum DepthFormat {
    Millimetres,
    Metres,
}

impl DepthPixels {
    /// Stores depth in metres as millimetres of 16 bits if that is exact for all pixels, otherwise as it is.
    pub fn new(depth_m: &[f32]) -> Self {
        let millimetres = depth_m.iter().map(|depth| whole_millimetres(*depth).map(u16::to_le_bytes));
        match millimetres.collect::<Option<Vec<[u8; 2]>>>() {
            Some(pixels) => Self { format: DepthFormat::Millimetres, bytes: pixels.into_flattened() },
            None => {
                let bytes = depth_m.iter().flat_map(|depth| depth.to_le_bytes()).collect();
                Self { format: DepthFormat::Metres, bytes }
            }
        }
    }

    /// Returns true if the depth is stored as millimetres.
    pub fn is_whole_millimetres(&self) -> bool {
        self.format == DepthFormat::Millimetres
    }
}

/// The message of a depth image of `(width, height)` pixels, in the frame and pixels of colour.
///
/// # Errors
/// If a size does not fit into 32 bits.
pub fn depth_image(stamp: Time, (width, height): (usize, usize), pixels: &DepthPixels) -> io::Result<Image<'_>> {
    let (encoding, bytes_per_pixel) = match pixels.format {
        DepthFormat::Millimetres => ("16UC1", 2),
        DepthFormat::Metres => ("32FC1", 4),
    };
    Ok(Image {
        header: in_camera(stamp),
        height: number(height)?,
        width: number(width)?,
        encoding,
        is_bigendian: 0,
        step: number(bytes_per_pixel * width)?,
        data: &pixels.bytes,
    })
}
