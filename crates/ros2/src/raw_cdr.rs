//! Messages as bytes: RustDDS neither encodes nor decodes them.

use rustdds::RepresentationIdentifier;
use rustdds::bytes::Bytes;
use rustdds::no_key::{Decode, DefaultDecoder, DeserializerAdapter, SerializerAdapter};
use std::convert::Infallible;

/// Size of the encapsulation header, which RustDDS adds and removes.
const HEADER: usize = 4;

/// A message in CDR, with its encapsulation header.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct RawCdr(pub Vec<u8>);

/// Passes messages through.
pub(crate) struct RawAdapter;

/// See [`RawAdapter`].
#[derive(Clone)]
pub(crate) struct RawDecoder;

impl Decode<'_, RawCdr> for RawDecoder {
    type Error = Infallible;

    fn decode_bytes(self, content: &[u8], encoding: RepresentationIdentifier) -> Result<RawCdr, Infallible> {
        let second = u8::from(encoding != RepresentationIdentifier::CDR_BE);
        let mut bytes = Vec::with_capacity(HEADER + content.len());
        bytes.extend([0, second, 0, 0]);
        bytes.extend(content);
        Ok(RawCdr(bytes))
    }
}

impl DeserializerAdapter<RawCdr> for RawAdapter {
    type Error = Infallible;
    type Decoded = RawCdr;

    fn supported_encodings() -> &'static [RepresentationIdentifier] {
        &[RepresentationIdentifier::CDR_LE, RepresentationIdentifier::CDR_BE]
    }

    fn transform_decoded(decoded: RawCdr) -> RawCdr {
        decoded
    }
}

impl DefaultDecoder<RawCdr> for RawAdapter {
    type Decoder = RawDecoder;
    const DECODER: RawDecoder = RawDecoder;
}

impl SerializerAdapter<RawCdr> for RawAdapter {
    type Error = Infallible;

    fn output_encoding() -> RepresentationIdentifier {
        // `splatseg_ros::to_cdr` writes no other.
        RepresentationIdentifier::CDR_LE
    }

    fn to_bytes(message: &RawCdr) -> Result<Bytes, Infallible> {
        Ok(Bytes::copy_from_slice(message.0.get(HEADER..).unwrap_or_default()))
    }
}
