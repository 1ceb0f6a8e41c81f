//! Serialised messages: a four-byte encapsulation header followed by CDR (DDS-RTPS 2.3, section 10).

use re_cdr::{BigEndian, LittleEndian};
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Encapsulation of CDR version 1, big endian: the first two bytes of a message.
const CDR_BIG_ENDIAN: [u8; 2] = [0, 0];
/// Encapsulation of CDR version 1, little endian.
const CDR_LITTLE_ENDIAN: [u8; 2] = [0, 1];
/// Size of the encapsulation header: two bytes for the encoding and two unused ones.
const ENCAPSULATION_BYTES: usize = 4;

/// Errors decoding or encoding a message.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum CdrError {
    /// The encapsulation header is incomplete.
    #[error("found {0} bytes, expected a CDR message, which has at least 4")]
    TooShort(usize),
    /// The message is not encoded in plain CDR.
    #[error("found the encapsulation {0:02x} {1:02x}, expected 00 00 or 00 01 (plain CDR)")]
    Encapsulation(u8, u8),
    /// The content does not match the type, e.g. because of a wrong length.
    #[error("the message is damaged or of another type: {0}")]
    Content(String),
}

/// Decodes a message. Strings and byte arrays may borrow from `bytes`. Lengths are checked against the remaining bytes
/// before memory is allocated.
///
/// # Errors
/// [`CdrError`] if `bytes` is not a message of this type.
pub fn from_cdr<'a, T: Deserialize<'a>>(bytes: &'a [u8]) -> Result<T, CdrError> {
    let (encapsulation, content) =
        bytes.split_first_chunk::<ENCAPSULATION_BYTES>().ok_or(CdrError::TooShort(bytes.len()))?;
    let message = match [encapsulation[0], encapsulation[1]] {
        CDR_BIG_ENDIAN => re_cdr::from_bytes::<T, BigEndian>(content),
        CDR_LITTLE_ENDIAN => re_cdr::from_bytes::<T, LittleEndian>(content),
        [first, second] => return Err(CdrError::Encapsulation(first, second)),
    };
    message.map(|(message, _)| message).map_err(|error| CdrError::Content(error.to_string()))
}

/// Encodes a message, little endian.
///
/// # Errors
/// [`CdrError::Content`] for a type that CDR cannot represent; never for the types of this crate.
pub fn to_cdr(message: &impl Serialize) -> Result<Vec<u8>, CdrError> {
    let content = re_cdr::to_vec::<_, LittleEndian>(message).map_err(|error| CdrError::Content(error.to_string()))?;
    let mut bytes = Vec::with_capacity(ENCAPSULATION_BYTES + content.len());
    bytes.extend(CDR_LITTLE_ENDIAN);
    bytes.extend([0, 0]);
    bytes.extend(content);
    Ok(bytes)
}

/// Serialises a byte array in one piece, instead of byte by byte as by default in `serde`.
pub(crate) fn serialize_bytes<S: serde::Serializer>(bytes: &[u8], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_bytes(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{CameraInfo, Header, Image, Odometry, PoseStamped, TfMessage, Time, TransformStamped};
    use proptest::prelude::*;

    fn header() -> Header {
        Header { stamp: Time { sec: -3, nanosec: 7 }, frame_id: "camera".to_owned() }
    }

    #[test]
    fn the_layout_is_that_of_cdr() {
        let pixels = [1, 2, 3, 4, 5, 6];
        let image =
            Image { header: header(), height: 1, width: 2, encoding: "rgb8", is_bigendian: 0, step: 6, data: &pixels };
        let mut expected = vec![0, 1, 0, 0];
        expected.extend((-3i32).to_le_bytes());
        expected.extend(7u32.to_le_bytes());
        expected.extend([7, 0, 0, 0]);
        expected.extend(b"camera\0\0"); // terminating zero, one byte of padding
        expected.extend([1, 0, 0, 0, 2, 0, 0, 0, 5, 0, 0, 0]);
        expected.extend(b"rgb8\0");
        expected.extend([0, 0, 0]); // is_bigendian, two bytes of padding
        expected.extend([6, 0, 0, 0, 6, 0, 0, 0]);
        expected.extend(pixels);
        assert_eq!(to_cdr(&image).unwrap(), expected);
        let read: Image<'_> = from_cdr(&expected).unwrap();
        assert_eq!(read, image);
        assert_eq!(read.data.as_ptr(), expected[expected.len() - 6..].as_ptr(), "pixels are not copied");
    }

    #[test]
    fn both_byte_orders_are_read() {
        let mut bytes = vec![0, 0, 0, 0];
        bytes.extend(258i32.to_be_bytes());
        bytes.extend(9u32.to_be_bytes());
        bytes.extend([0, 0, 0, 2, b'a', 0]);
        let read: Header = from_cdr(&bytes).unwrap();
        assert_eq!(read, Header { stamp: Time { sec: 258, nanosec: 9 }, frame_id: "a".to_owned() });
        bytes[1] = 3;
        assert_eq!(from_cdr::<Header>(&bytes), Err(CdrError::Encapsulation(0, 3)));
        assert_eq!(from_cdr::<Header>(&bytes[..3]), Err(CdrError::TooShort(3)));
    }

    #[test]
    fn lengths_beyond_the_end_take_no_memory() {
        let mut bytes = vec![0, 1, 0, 0];
        bytes.extend(u32::MAX.to_le_bytes());
        assert!(matches!(from_cdr::<TfMessage>(&bytes), Err(CdrError::Content(_))));
        bytes[7] = 5; // 90 million transforms
        assert!(matches!(from_cdr::<TfMessage>(&bytes), Err(CdrError::Content(_))));
    }

    #[test]
    fn messages_are_the_same_after_writing_and_reading() {
        let tf = TransformStamped { header: header(), child_frame_id: "lens".to_owned(), ..Default::default() };
        let tf = TfMessage { transforms: vec![tf.clone(), TransformStamped::default(), tf] };
        assert_eq!(from_cdr::<TfMessage>(&to_cdr(&tf).unwrap()).unwrap(), tf);
        let info = CameraInfo { header: header(), d: vec![0.5; 5], ..Default::default() };
        assert_eq!(from_cdr::<CameraInfo>(&to_cdr(&info).unwrap()).unwrap(), info);
        let mut odometry = Odometry { header: header(), child_frame_id: "base".to_owned(), ..Default::default() };
        odometry.pose.covariance[5][5] = 4.0;
        let bytes = to_cdr(&odometry).unwrap();
        assert_eq!(from_cdr::<Odometry>(&bytes).unwrap(), odometry);
    }

    proptest! {
        #[test]
        fn any_bytes_are_a_message_or_an_error(mut bytes in prop::collection::vec(any::<u8>(), 0..300), plain in any::<bool>()) {
            if plain && bytes.len() > 1 {
                bytes[..2].copy_from_slice(&[0, 1]);
            }
            let _ = from_cdr::<Image<'_>>(&bytes);
            let _ = from_cdr::<CameraInfo>(&bytes);
            let _ = from_cdr::<TfMessage>(&bytes);
            let _ = from_cdr::<Odometry>(&bytes);
            let _ = from_cdr::<PoseStamped>(&bytes);
            let _ = from_cdr::<crate::PointCloud2<'_>>(&bytes);
            let _ = from_cdr::<crate::MarkerArray<'_>>(&bytes);
            let _ = from_cdr::<crate::OccupancyGrid>(&bytes);
        }
    }
}
