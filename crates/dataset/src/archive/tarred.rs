//! Images inside a tar.gz file.
//!
//! A gzip stream has no random access: reading a frame in the middle means unpacking everything before it. So the
//! wanted members are copied once, on opening, to an unnamed temporary file, from which frames are then read in any
//! order. It contains the members unchanged (JPEG and PNG files), is in the system's folder for temporary files
//! (`TMPDIR`), and disappears when the scene is dropped or the program ends, even by a crash. Memory holds only the
//! members' offsets.
//!
//! An archive may unpack to [`MAX_RATIO`] times its size plus [`ALWAYS_UNPACKED_BYTES`], and a member to the maximum
//! size of an image file. Anything larger is treated as a decompression bomb.

use crate::DatasetError;
use crate::decode::MAX_IMAGE_FILE_BYTES;
use crate::files::{RandomAccessFile, open_file};
use flate2::read::MultiGzDecoder;
use std::collections::{BTreeMap, BTreeSet};
use std::io::{BufReader, Error, ErrorKind, Read, Result as IoResult};
use std::path::{Path, PathBuf};
use tar::{Archive, Entry, EntryType, PaxExtensions};

/// Maximum compression ratio. JPEG and PNG files hardly shrink, and JSON shrinks 20-fold.
const MAX_RATIO: u64 = 64;
/// Unpacked size allowed for an archive of any size.
const ALWAYS_UNPACKED_BYTES: u64 = 64 << 20;
/// Maximum length of a member name. No data set has longer ones.
const MAX_NAME_BYTES: u64 = 64 << 10;

/// Return value of a visitor: continue with the next member, or stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum MemberFlow {
    Continue,
    Stop,
}

/// Calls `visit` with the path (without a leading `./`), size and content of every regular file in the archive, in
/// order, until it returns [`MemberFlow::Stop`]. Files whose names are not UTF-8 are skipped.
pub(crate) fn for_each_member(
    path: &Path,
    mut visit: impl FnMut(&str, u64, &mut dyn Read) -> Result<MemberFlow, DatasetError>,
) -> Result<(), DatasetError> {
    let damaged = |source| DatasetError::Archive { path: path.to_owned(), source };
    let file = open_file(path)?;
    let packed_bytes = file.metadata().map_err(|source| DatasetError::Io { path: path.to_owned(), source })?.len();
    let left = packed_bytes.saturating_mul(MAX_RATIO).saturating_add(ALWAYS_UNPACKED_BYTES);
    let unpacked = Bounded { reader: MultiGzDecoder::new(BufReader::new(file)), left };
    let mut archive = Archive::new(unpacked);
    // Raw entries: the library would load a long name into memory whatever length it claims.
    let mut long_name = None;
    for entry in archive.entries().map_err(damaged)?.raw(true) {
        let mut entry = entry.map_err(damaged)?;
        match entry.header().entry_type() {
            EntryType::GNULongName => long_name = read_name(&mut entry).map_err(damaged)?,
            EntryType::XHeader => long_name = read_pax_path(&mut entry).map_err(damaged)?.or(long_name),
            EntryType::Regular | EntryType::Continuous => {
                let name = long_name.take().or_else(|| String::from_utf8(entry.path_bytes().into_owned()).ok());
                let size = entry.size();
                let Some(name) = name else { continue };
                if visit(name.trim_start_matches("./"), size, &mut entry)? == MemberFlow::Stop {
                    return Ok(());
                }
            }
            _ => long_name = None,
        }
    }
    Ok(())
}

/// Reads the name in a GNU long-name entry; `None` if it is not UTF-8.
fn read_name(entry: &mut Entry<'_, impl Read>) -> IoResult<Option<String>> {
    let mut bytes = read_small(entry)?;
    while bytes.last() == Some(&0) {
        bytes.pop();
    }
    Ok(String::from_utf8(bytes).ok())
}

/// Reads the path in a PAX header, if there is one.
fn read_pax_path(entry: &mut Entry<'_, impl Read>) -> IoResult<Option<String>> {
    let bytes = read_small(entry)?;
    let path = PaxExtensions::new(&bytes).flatten().find(|extension| extension.key_bytes() == b"path");
    Ok(path.and_then(|extension| extension.value().ok().map(str::to_owned)))
}

fn read_small(entry: &mut Entry<'_, impl Read>) -> IoResult<Vec<u8>> {
    let mut bytes = Vec::new();
    entry.take(MAX_NAME_BYTES + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > MAX_NAME_BYTES {
        return Err(Error::new(ErrorKind::InvalidData, format!("a name of more than {MAX_NAME_BYTES} bytes")));
    }
    Ok(bytes)
}

/// A reader that returns an error, rather than the end, after a maximum number of bytes.
struct Bounded<R> {
    reader: R,
    left: u64,
}

impl<R: Read> Read for Bounded<R> {
    fn read(&mut self, buffer: &mut [u8]) -> IoResult<usize> {
        let read = self.reader.read(buffer)?;
        self.left = self.left.checked_sub(read as u64).ok_or_else(|| {
            let text = format!(
                "it unpacks to more than {MAX_RATIO} times its size and {} MiB: no archive of images does",
                ALWAYS_UNPACKED_BYTES >> 20
            );
            Error::new(ErrorKind::InvalidData, text)
        })?;
        Ok(read)
    }
}

/// Members of a tar.gz file, copied to a temporary file and readable in any order, from any thread.
#[derive(Debug)]
pub(crate) struct UnpackedMembers {
    archive: PathBuf,
    file: RandomAccessFile,
    /// Offset and length in the temporary file, by member path.
    places: BTreeMap<String, (u64, u64)>,
}

impl UnpackedMembers {
    /// Copies the members named in `wanted` out of the archive, reading no further than the last of them. Missing
    /// members are absent from the result.
    pub(crate) fn unpack(archive: &Path, wanted: &BTreeSet<String>) -> Result<Self, DatasetError> {
        let io_error = |source| DatasetError::Io { path: archive.to_owned(), source };
        let mut file =
            tempfile::tempfile().map_err(|source| DatasetError::Io { path: std::env::temp_dir(), source })?;
        let mut places = BTreeMap::new();
        let mut end = 0;
        for_each_member(archive, |name, size, content| {
            if !wanted.contains(name) || places.contains_key(name) {
                return Ok(MemberFlow::Continue);
            }
            if size > MAX_IMAGE_FILE_BYTES {
                let path = archive.join(name);
                return Err(DatasetError::FileTooBig { path, what: "image", bytes: size, limit: MAX_IMAGE_FILE_BYTES });
            }
            let copied = std::io::copy(content, &mut file).map_err(io_error)?;
            if copied != size {
                let what = format!("{name} of {size} bytes");
                return Err(DatasetError::EndsEarly { path: archive.to_owned(), what, end: size, bytes: copied });
            }
            places.insert(name.to_owned(), (end, size));
            end += size;
            Ok(if places.len() == wanted.len() { MemberFlow::Stop } else { MemberFlow::Continue })
        })?;
        Ok(Self { archive: archive.to_owned(), file: RandomAccessFile::new(file), places })
    }

    /// Returns the path of a member, for messages.
    pub(crate) fn path_of(&self, name: &str) -> PathBuf {
        self.archive.join(name)
    }

    pub(crate) fn contains(&self, name: &str) -> bool {
        self.places.contains_key(name)
    }

    /// Reads a member. `what` names its content in errors.
    pub(crate) fn read(&self, name: &str, what: &'static str) -> Result<Vec<u8>, DatasetError> {
        let path = self.path_of(name);
        let Some((offset, len)) = self.places.get(name) else {
            return Err(DatasetError::MissingFile { path, what });
        };
        self.file.read(*offset, *len).map_err(|source| DatasetError::Io { path, source })
    }
}
