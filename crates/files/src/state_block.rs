//! Named arrays as bytes: the one form of everything that is saved to be continued later.
//!
//! A saved map has such a block behind its Gaussians, the state of a stopped run is one, and so are the keyframes and
//! names that parts of the program hand to each other. The bytes are those of a
//! [safetensors](https://github.com/huggingface/safetensors) file: the length of the header as `u64`, the header in
//! JSON, the arrays in their order in the header; all numbers little-endian, arrays row-major. The same content has the
//! same bytes.
//!
//! - The header's `__metadata__` has one entry, `splatseg_state`: the version of the form, now 1.
//! - Names have dots: what belongs to one part of the program begins with the same word, such as `keyframes.id`.
//! - An array whose name ends in `.json` is text: JSON for the few things that are no arrays of numbers.
//! - `writer` is text: the program that wrote the block.
//!
//! **Rule for changes.** Arrays that a program does not know are ignored, and so are unknown fields of JSON. Whatever is
//! added must have a default that holds where it is missing. So something can be added without a new version, and older
//! programs leave it out. What an array means never changes: a new meaning gets a new name. If older programs would
//! misunderstand the rest, the version goes up. A program reads all versions up to its own, and refuses later ones with
//! one line that names the program that wrote them.

use crate::{MemoryLimit, display_bytes};
use safetensors::SafeTensors;
use safetensors::tensor::{Dtype, View};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};
use thiserror::Error;

/// Version of the form.
const VERSION: u32 = 1;
/// Entry of the header's metadata with the version.
const VERSION_KEY: &str = "splatseg_state";
/// Array with the name of the program.
const WRITER: &str = "writer";
/// The program, as text.
const PROGRAM: &str = concat!("splatseg ", env!("CARGO_PKG_VERSION"));
/// Maximum length of a header, when it is written and when it is read: parsing takes many times as much memory. A block
/// has tens of arrays, of about 100 bytes each.
const MAX_HEADER_BYTES: u64 = 1 << 20;
/// Bytes of the header's length.
const LENGTH_BYTES: usize = 8;
/// Maximum number of characters of a text from a file in an error.
const SHOWN_CHARS: usize = 100;

/// Named arrays, to be saved or just read. Names are in alphabetical order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StateBlock {
    arrays: BTreeMap<String, Array>,
}

#[derive(Clone, Debug, PartialEq)]
struct Array {
    kind: Dtype,
    shape: Vec<usize>,
    /// Little-endian.
    bytes: Vec<u8>,
}

/// Errors reading or writing a [`StateBlock`].
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum StateError {
    /// The bytes are no block, or were cut off or altered.
    #[error("no saved state, or a damaged one: {found}")]
    Damaged {
        /// The problem.
        found: String,
    },
    /// A later program wrote the block.
    #[error(
        "saved state of version {found}, written by {writer}; this is {PROGRAM}, which reads up to version {VERSION}"
    )]
    Version {
        /// The version of the block.
        found: u32,
        /// The program that wrote it.
        writer: String,
    },
    /// An array has another type or shape than expected, or a value that is impossible.
    #[error("{name}: found {found}, expected {expected}")]
    Array {
        /// The array's name.
        name: String,
        /// Its type and shape, or the value.
        found: String,
        /// Description of what is possible.
        expected: String,
    },
    /// The header or the whole is larger than is read or written.
    #[error("saved state: {found} of {what}, expected at most {max}")]
    TooLarge {
        /// Name of the part that is too large.
        what: &'static str,
        /// Its size.
        found: String,
        /// The largest possible size.
        max: String,
    },
}

mod number {
    use super::Dtype;

    /// The bytes of a number.
    pub trait Number: Copy {
        const KIND: Dtype;
        fn append(self, bytes: &mut Vec<u8>);
        /// The number from exactly as many bytes as it has.
        fn from_bytes(bytes: &[u8]) -> Option<Self>;
    }

    macro_rules! numbers {
        ($($number:ty => $kind:ident),*) => {$(
            impl Number for $number {
                const KIND: Dtype = Dtype::$kind;

                fn append(self, bytes: &mut Vec<u8>) {
                    bytes.extend_from_slice(&self.to_le_bytes());
                }

                fn from_bytes(bytes: &[u8]) -> Option<Self> {
                    Some(Self::from_le_bytes(bytes.try_into().ok()?))
                }
            }

            impl super::StateNumber for $number {}
        )*};
    }

    numbers!(u8 => U8, u16 => U16, i16 => I16, u32 => U32, i32 => I32, u64 => U64, i64 => I64, f32 => F32, f64 => F64);
}

/// A number that arrays of a [`StateBlock`] consist of: `u8`, `u16`, `i16`, `u32`, `i32`, `u64`, `i64`, `f32` or `f64`.
pub trait StateNumber: number::Number {}

impl View for &Array {
    fn dtype(&self) -> Dtype {
        self.kind
    }

    fn shape(&self) -> &[usize] {
        &self.shape
    }

    fn data(&self) -> Cow<'_, [u8]> {
        Cow::Borrowed(&self.bytes)
    }

    fn data_len(&self) -> usize {
        self.bytes.len()
    }
}

impl StateBlock {
    /// Name of an array with the text that a map of version 4 has in place of a block. Only the part of the program that it
    /// belongs to can read it.
    pub const OLD_TEXT: &str = "text_of_version_4";

    /// True without arrays.
    pub fn is_empty(&self) -> bool {
        self.arrays.is_empty()
    }

    /// The names of all arrays, in alphabetical order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.arrays.keys().map(String::as_str)
    }

    /// Adds an array with the shape `[rows, row…]`; `row` is the shape of a row, empty for a list of numbers. Replaces an
    /// array of this name. Numbers that do not fill a row are left out.
    pub fn put<T: StateNumber>(&mut self, name: &str, row: &[usize], values: impl IntoIterator<Item = T>) {
        let mut bytes = Vec::new();
        values.into_iter().for_each(|value| value.append(&mut bytes));
        let row_bytes = row.iter().product::<usize>() * size_of::<T>();
        let rows = bytes.len().checked_div(row_bytes).unwrap_or(0);
        bytes.truncate(rows * row_bytes);
        let shape = std::iter::once(rows).chain(row.iter().copied()).collect();
        self.arrays.insert(name.to_owned(), Array { kind: T::KIND, shape, bytes });
    }

    /// Adds a single number, an array without axes.
    pub fn put_number<T: StateNumber>(&mut self, name: &str, value: T) {
        let mut bytes = Vec::new();
        value.append(&mut bytes);
        self.arrays.insert(name.to_owned(), Array { kind: T::KIND, shape: Vec::new(), bytes });
    }

    /// Adds text in JSON, as bytes. Its name should end in `.json`. Values that JSON cannot express are left out.
    pub fn put_json(&mut self, name: &str, value: &impl Serialize) {
        if let Ok(text) = serde_json::to_vec(value) {
            self.put(name, &[], text);
        }
    }

    /// Adds all arrays of another block, with `prefix` and a dot before their names.
    pub fn put_block(&mut self, prefix: &str, block: Self) {
        self.arrays.extend(block.arrays.into_iter().map(|(name, array)| (format!("{prefix}.{name}"), array)));
    }

    /// Removes the arrays whose names begin with `prefix` and a dot, and returns them without that.
    #[must_use]
    pub fn take_block(&mut self, prefix: &str) -> Self {
        let start = format!("{prefix}.");
        let of_block = |name: &String, _: &mut Array| name.starts_with(&start);
        let taken: Vec<(String, Array)> = self.arrays.extract_if(.., of_block).collect();
        Self { arrays: taken.into_iter().map(|(name, array)| (name[start.len()..].to_owned(), array)).collect() }
    }

    /// The numbers of an array `[rows, row…]`, row-major; none if there is no such array.
    ///
    /// # Errors
    /// [`StateError::Array`] if it has another type or shape.
    pub fn get<T: StateNumber>(&self, name: &str, row: &[usize]) -> Result<Vec<T>, StateError> {
        let Some(array) = self.arrays.get(name) else { return Ok(Vec::new()) };
        if array.kind != T::KIND || array.shape.get(1..) != Some(row) {
            let row: String = row.iter().map(|size| format!(", {size}")).collect();
            return Err(array.unexpected(name, format!("{} [any number{row}]", T::KIND)));
        }
        Ok(array.bytes.chunks_exact(size_of::<T>()).filter_map(T::from_bytes).collect())
    }

    /// As [`Self::get`], with `count` rows.
    ///
    /// # Errors
    /// [`StateError::Array`] if it has another type or shape, or is missing and `count` is not 0.
    pub fn get_rows<T: StateNumber>(&self, name: &str, count: usize, row: &[usize]) -> Result<Vec<T>, StateError> {
        let values = self.get(name, row)?;
        if values.len() == row.iter().product::<usize>().saturating_mul(count) {
            return Ok(values);
        }
        let found = self.arrays.get(name).map_or_else(|| "nothing".to_owned(), |array| format!("{:?}", array.shape));
        Err(StateError::Array { name: name.to_owned(), found, expected: format!("{count} rows") })
    }

    /// The rows of an array `[rows, N]`; none if there is no such array.
    ///
    /// # Errors
    /// As [`Self::get`].
    pub fn get_tuples<T: StateNumber, const N: usize>(&self, name: &str) -> Result<Vec<[T; N]>, StateError> {
        Ok(self.get(name, &[N])?.as_chunks().0.to_vec())
    }

    /// The numbers of an array `[rows, columns]`, row-major, and the number of columns; none if there is no such array.
    ///
    /// # Errors
    /// [`StateError::Array`] if it has another type, or not two axes.
    pub fn get_matrix<T: StateNumber>(&self, name: &str) -> Result<(usize, Vec<T>), StateError> {
        let Some(array) = self.arrays.get(name) else { return Ok((0, Vec::new())) };
        match *array.shape {
            [_, columns] => Ok((columns, self.get(name, &[columns])?)),
            _ => Err(array.unexpected(name, format!("{} with two axes", T::KIND))),
        }
    }

    /// A single number; `None` if there is no such array.
    ///
    /// # Errors
    /// [`StateError::Array`] if it has another type, or is not a single number.
    pub fn get_number<T: StateNumber>(&self, name: &str) -> Result<Option<T>, StateError> {
        let Some(array) = self.arrays.get(name) else { return Ok(None) };
        let value = Some(array).filter(|array| array.kind == T::KIND).and_then(|array| T::from_bytes(&array.bytes));
        value.map(Some).ok_or_else(|| array.unexpected(name, format!("one number of type {}", T::KIND)))
    }

    /// Parses the text written by [`Self::put_json`]. `None` if there is no such array.
    ///
    /// # Errors
    /// [`StateError::Array`] if it is not such a text.
    pub fn get_json<T: DeserializeOwned>(&self, name: &str) -> Result<Option<T>, StateError> {
        if !self.arrays.contains_key(name) {
            return Ok(None);
        }
        let wrong = |error: serde_json::Error| StateError::Array {
            name: name.to_owned(),
            found: shown(&error.to_string()),
            expected: "the JSON that this program writes".to_owned(),
        };
        serde_json::from_slice(&self.get::<u8>(name, &[])?).map(Some).map_err(wrong)
    }

    /// The block as bytes.
    ///
    /// # Errors
    /// [`StateError::TooLarge`] if [`Self::from_bytes`] would refuse it.
    pub fn to_bytes(&self) -> Result<Vec<u8>, StateError> {
        let writer = Array { kind: Dtype::U8, shape: vec![PROGRAM.len()], bytes: PROGRAM.as_bytes().to_vec() };
        let arrays = self.arrays.iter().map(|(name, array)| (name.as_str(), array));
        let arrays = arrays.filter(|(name, _)| *name != WRITER).chain(std::iter::once((WRITER, &writer)));
        // Only one entry: more would be written in any order.
        let metadata = HashMap::from([(VERSION_KEY.to_owned(), VERSION.to_string())]);
        let bytes = safetensors::serialize(arrays, Some(metadata))
            .map_err(|error| StateError::Damaged { found: error.to_string() })?;
        check_header(&bytes)?;
        Ok(bytes)
    }

    /// Reads the bytes of [`Self::to_bytes`]. Takes no more memory than the bytes, and a bounded amount for the header.
    ///
    /// # Errors
    /// [`StateError`] if the bytes are damaged, a later program wrote them, or they exceed the memory limit.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, StateError> {
        check_header(bytes)?;
        let (size, limit) = (bytes.len() as u64, MemoryLimit::in_force());
        if size > limit {
            let (found, max) = (display_bytes(size), format!("{} (memory_limit)", display_bytes(limit)));
            return Err(StateError::TooLarge { what: "arrays", found, max });
        }
        let damaged = |found: String| StateError::Damaged { found };
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(|error| damaged(shown(&error.to_string())))?;
        let metadata = header.metadata().as_ref();
        let version = metadata.and_then(|metadata| metadata.get(VERSION_KEY)?.parse::<u32>().ok());
        let version = version.filter(|version| *version > 0);
        let version = version.ok_or_else(|| damaged(format!("no version as {VERSION_KEY} in the metadata")))?;
        let tensors = SafeTensors::deserialize(bytes).map_err(|error| damaged(shown(&error.to_string())))?;
        if version > VERSION {
            let writer = tensors
                .tensor(WRITER)
                .map_or_else(|_| "an unknown program".to_owned(), |text| shown(&String::from_utf8_lossy(text.data())));
            return Err(StateError::Version { found: version, writer });
        }
        let array = |(name, tensor): (&str, safetensors::tensor::TensorView<'_>)| {
            let array = Array { kind: tensor.dtype(), shape: tensor.shape().to_vec(), bytes: tensor.data().to_vec() };
            (name.to_owned(), array)
        };
        Ok(Self { arrays: tensors.iter().filter(|(name, _)| *name != WRITER).map(array).collect() })
    }
}

impl Array {
    fn unexpected(&self, name: &str, expected: String) -> StateError {
        StateError::Array { name: shown(name), found: format!("{} {:?}", self.kind, self.shape), expected }
    }
}

/// Checks the length of the header.
fn check_header(bytes: &[u8]) -> Result<(), StateError> {
    let length = bytes.first_chunk::<LENGTH_BYTES>().map(|length| u64::from_le_bytes(*length));
    let length = length.ok_or_else(|| StateError::Damaged { found: format!("only {} bytes", bytes.len()) })?;
    if length <= MAX_HEADER_BYTES {
        return Ok(());
    }
    let (found, max) = (format!("{length} bytes"), format!("{MAX_HEADER_BYTES}"));
    Err(StateError::TooLarge { what: "header", found, max })
}

/// The beginning of a text that may be long, without line ends.
fn shown(text: &str) -> String {
    text.chars().map(|letter| if letter.is_control() { ' ' } else { letter }).take(SHOWN_CHARS).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn block() -> StateBlock {
        let mut block = StateBlock::default();
        block.put("keyframes.size", &[2], [160u32, 120, 160, 90]);
        block.put("keyframes.grey", &[], [1u8, 2, 3]);
        block.put("keyframes.pose", &[2, 2], [0.5f64, -0.0, f64::MAX, 1e-300]);
        block.put_number("frames", 7u64);
        block.put_number("given", -1i64);
        block.put("empty", &[], std::iter::empty::<f32>());
        block.put("points", &[3], [-5i16, 4, 3]);
        block.put("depth", &[], [u16::MAX]);
        block.put_json("state.json", &("a", 2.5, None::<u8>));
        block
    }

    #[test]
    fn arrays_are_read_as_they_were_written() {
        let bytes = block().to_bytes().unwrap();
        let mut read = StateBlock::from_bytes(&bytes).unwrap();
        assert_eq!(read, block());
        assert_eq!(read.to_bytes().unwrap(), bytes, "the same bytes whatever order a hash map has");
        assert_eq!(read.get_tuples("keyframes.size"), Ok(vec![[160u32, 120], [160, 90]]));
        assert_eq!(read.get::<f64>("keyframes.pose", &[2, 2]).unwrap()[1].to_bits(), (-0.0f64).to_bits());
        assert_eq!((read.get_number("frames"), read.get_number("given")), (Ok(Some(7u64)), Ok(Some(-1i64))));
        assert_eq!(read.get_json("state.json"), Ok(Some(("a".to_owned(), 2.5, None::<u8>))));
        let keyframes = read.take_block("keyframes");
        assert_eq!(keyframes.names().collect::<Vec<_>>(), ["grey", "pose", "size"]);
        assert!(read.names().all(|name| !name.starts_with("keyframes")));
        read.put_block("keyframes", keyframes);
        assert_eq!(read, block());
    }

    #[test]
    fn it_is_a_safetensors_file() {
        let bytes = block().to_bytes().unwrap();
        let (_, header) = SafeTensors::read_metadata(&bytes).unwrap();
        assert_eq!(header.metadata().as_ref().unwrap()["splatseg_state"], "1");
        let size = header.info("keyframes.size").unwrap();
        assert_eq!((size.dtype, &size.shape[..]), (Dtype::U32, &[2, 2][..]));
        assert!(header.info("frames").unwrap().shape.is_empty());
    }

    #[test]
    fn missing_arrays_mean_the_default_and_wrong_ones_are_named() {
        let block = block();
        assert_eq!(block.get::<f32>("unknown", &[3]), Ok(vec![]));
        assert_eq!(block.get_number::<u8>("unknown"), Ok(None));
        assert_eq!(block.get_json::<u8>("unknown"), Ok(None));
        assert!(block.get_rows::<u32>("unknown", 1, &[]).is_err());
        assert_eq!(block.get_rows::<u32>("unknown", 0, &[]), Ok(vec![]));
        let error = block.get::<f32>("keyframes.size", &[2]).unwrap_err().to_string();
        assert_eq!(error, "keyframes.size: found U32 [2, 2], expected F32 [any number, 2]");
        assert!(block.get::<u32>("keyframes.size", &[]).is_err() && block.get::<u64>("frames", &[]).is_err());
        assert!(block.get_number::<u32>("keyframes.size").is_err());
        let error = block.get_rows::<u32>("keyframes.size", 3, &[2]).unwrap_err().to_string();
        assert_eq!(error, "keyframes.size: found [2, 2], expected 3 rows");
        assert!(block.get_json::<u8>("state.json").unwrap_err().to_string().starts_with("state.json: found "));
    }

    /// The bytes of a block with this version and one array.
    fn of_version(version: &str, writer: &str) -> Vec<u8> {
        let array = Array { kind: Dtype::U8, shape: vec![writer.len()], bytes: writer.as_bytes().to_vec() };
        let metadata = HashMap::from([(VERSION_KEY.to_owned(), version.to_owned())]);
        safetensors::serialize([("writer", &array)], Some(metadata)).unwrap()
    }

    #[test]
    fn later_versions_are_refused_with_the_program_that_wrote_them() {
        assert!(StateBlock::from_bytes(&of_version("1", "splatseg 0.0.1")).unwrap().is_empty());
        let error = StateBlock::from_bytes(&of_version("2", "splatseg 9.1")).unwrap_err().to_string();
        assert!(error.starts_with("saved state of version 2, written by splatseg 9.1; this is splatseg "), "{error}");
        assert!(error.ends_with("reads up to version 1"), "{error}");
        for version in ["0", "-1", "one", ""] {
            assert!(matches!(StateBlock::from_bytes(&of_version(version, "")), Err(StateError::Damaged { .. })));
        }
    }

    #[test]
    fn other_bytes_are_refused() {
        for bytes in [&b""[..], b"{}", b"{\"session\":0}", &[0; 8], &[0; 64], &[255; 64]] {
            assert!(StateBlock::from_bytes(bytes).is_err(), "{bytes:?}");
        }
    }

    #[test]
    fn a_header_is_as_long_when_written_as_when_read() {
        let with_name = |length: usize| {
            let mut block = StateBlock::default();
            block.put(&"n".repeat(length), &[], [1u8]);
            block.to_bytes()
        };
        let longest = (1..=256).find_map(|less| with_name((1 << 20) - less).ok()).unwrap();
        assert!(StateBlock::from_bytes(&longest).is_ok());
        assert_eq!(longest[..8], (1u64 << 20).to_le_bytes());
        assert!(matches!(with_name(1 << 20), Err(StateError::TooLarge { what: "header", .. })));
    }

    proptest! {
        #[test]
        fn damaged_bytes_are_errors_or_have_the_same_structure(
            changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..4),
            cut in prop::option::of(any::<prop::sample::Index>()),
        ) {
            let mut bytes = block().to_bytes().unwrap();
            for (place, value) in changes {
                let place = place.index(bytes.len());
                bytes[place] = value;
            }
            let is_cut = cut.is_some();
            if let Some(cut) = cut {
                bytes.truncate(cut.index(bytes.len()));
            }
            if let Ok(read) = StateBlock::from_bytes(&bytes) {
                prop_assert!(!is_cut);
                let size: usize = read.arrays.values().map(|array| array.bytes.len()).sum();
                prop_assert!(size <= bytes.len());
                prop_assert_eq!(&StateBlock::from_bytes(&read.to_bytes().unwrap()).unwrap(), &read);
            }
        }
    }
}
