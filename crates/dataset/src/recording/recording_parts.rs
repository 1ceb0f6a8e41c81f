//! The files of a recording: one, or several into which rosbag2 has split it, each of which may be compressed.

use super::container::Container;
use super::mkv;
use super::zstd::{self, ZstdError};
use crate::DatasetError;
use crate::files::open_file;
use crate::listing::all_names_in;
use splatseg_files::display_bytes;
use std::ffi::OsString;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Endings of compressed files. Whether one is compressed, the content says.
const COMPRESSED_ENDINGS: [&str; 2] = [".zstd", ".zst"];
/// File of rosbag2 that lists those of a recording.
const METADATA: &str = "metadata.yaml";
/// A compressed file may unpack to this many times its size, and always to the second number of bytes.
const MAX_RATIO: u64 = 100;
const ALWAYS_UNPACKED_BYTES: u64 = 1 << 30;
const READ_BUFFER_BYTES: usize = 1 << 20;

/// A recording: its name in messages, and its files in order.
#[derive(Clone, Debug)]
pub(crate) struct RecordingParts {
    pub(crate) container: Container,
    /// The file, or the folder of several.
    pub(crate) path: PathBuf,
    pub(crate) files: Vec<PathBuf>,
    /// Numbers of the files that are missing among those of a split recording.
    pub(crate) missing: Vec<u64>,
}

impl RecordingParts {
    /// Returns true if a path has the name of a recording in a container, or is a folder containing some.
    pub(crate) fn looks_like(path: &Path, container: Container) -> bool {
        if !path.is_dir() {
            return is_recording(path, container);
        }
        !names_of_recordings(path, container).is_empty() || packed_otherwise(path, container).is_some()
    }

    /// Finds the recording at a path in any container: the file itself, or the only one in the folder.
    ///
    /// # Errors
    /// If the folder contains no recording, or several.
    pub(crate) fn find_any(path: &Path) -> Result<Self, DatasetError> {
        let container = Container::ALL.into_iter().find(|container| Self::looks_like(path, *container));
        Self::find(path, container.unwrap_or(Container::Mcap))
    }

    /// Finds the recording at a path in a container: the file itself, or the only one in the folder.
    ///
    /// # Errors
    /// If the folder contains no recording, or several.
    pub(crate) fn find(path: &Path, container: Container) -> Result<Self, DatasetError> {
        let only = |file: PathBuf| Self { container, path: file.clone(), files: vec![file], missing: Vec::new() };
        if !path.is_dir() {
            return Ok(only(path.to_owned()));
        }
        let names = names_of_recordings(path, container);
        match names.as_slice() {
            [] => Err(no_recording(path, container)),
            [name] => Ok(only(path.join(name))),
            several => split(path, several, container).ok_or_else(|| DatasetError::SeveralSequences {
                path: path.to_owned(),
                sequences: several.iter().map(|name| name.to_string_lossy().into_owned()).collect(),
            }),
        }
    }

    /// Returns the recording's name: that of its file or folder, without endings.
    pub(crate) fn name(&self) -> String {
        let name =
            stem(&self.path, self.container).or_else(|| Some(self.path.file_name()?.to_string_lossy().into_owned()));
        name.unwrap_or_else(|| "recording".to_owned())
    }
}

/// Returns the name of a recording without its endings; `None` for other files.
fn stem(path: &Path, container: Container) -> Option<String> {
    let name = path.file_name()?.to_string_lossy().into_owned();
    let without = |name: &str, ending: &str| {
        let start = name.len().checked_sub(ending.len())?;
        let (stem, end) = name.split_at_checked(start)?;
        end.eq_ignore_ascii_case(ending).then(|| stem.to_owned())
    };
    let unpacked = COMPRESSED_ENDINGS.iter().find_map(|ending| without(&name, ending));
    let unpacked = unpacked.as_deref().unwrap_or(&name);
    container.endings().iter().find_map(|ending| without(unpacked, ending))
}

/// Returns true if a file is a recording: by its name, or by its content if other videos have such names.
fn is_recording(path: &Path, container: Container) -> bool {
    if container == Container::Mkv { mkv::is_recording(path) } else { stem(path, container).is_some() }
}

/// Returns true if a name in lower case ends like those of a container.
fn ends_with_one_of(name: &str, container: Container) -> bool {
    container.endings().iter().any(|ending| name.ends_with(ending))
}

/// Returns the names of the recordings in a folder. Of one that is there compressed and not, only the latter.
fn names_of_recordings(folder: &Path, container: Container) -> Vec<OsString> {
    let stem_of = |name: &OsString| stem(Path::new(name), container);
    let names = all_names_in(folder).into_iter().filter(|name| folder.join(name).is_file());
    let is_named = |name: &OsString| stem_of(name).is_some() && is_recording(&folder.join(name), container);
    let names: Vec<OsString> = names.filter(is_named).collect();
    let is_plain = |name: &&OsString| ends_with_one_of(&name.to_string_lossy().to_ascii_lowercase(), container);
    let plain: Vec<Option<String>> = names.iter().filter(is_plain).map(stem_of).collect();
    names.iter().filter(|name| is_plain(name) || !plain.contains(&stem_of(name))).cloned().collect()
}

/// Returns the parts of a recording that rosbag2 has split: beside its list, with one name and increasing numbers.
fn split(folder: &Path, names: &[OsString], container: Container) -> Option<RecordingParts> {
    if !folder.join(METADATA).is_file() {
        return None;
    }
    let numbered = |name: &OsString| {
        let stem = stem(Path::new(name), container)?;
        let (base, number) = stem.rsplit_once('_')?;
        Some((base.to_owned(), number.parse::<u64>().ok()?, folder.join(name)))
    };
    let mut parts: Vec<(String, u64, PathBuf)> = names.iter().map(numbered).collect::<Option<_>>()?;
    parts.sort();
    let (first, last) = (parts.first()?, parts.last()?);
    let is_one = parts.iter().all(|(base, ..)| *base == first.0);
    let is_repeated = parts.windows(2).any(|pair| pair.first().map(|part| part.1) == pair.last().map(|part| part.1));
    let most = parts.len() as u64 * 2;
    if !is_one || is_repeated {
        return None;
    }
    // The first ones may have been deleted on purpose. A wrong number must not list millions.
    let missing = (first.1..=last.1).filter(|number| parts.iter().all(|(_, other, _)| other != number));
    let missing = missing.take(usize::try_from(most).unwrap_or(usize::MAX)).collect();
    let files = parts.into_iter().map(|(_, _, path)| path).collect();
    Some(RecordingParts { container, path: folder.to_owned(), files, missing })
}

/// Returns the error for a folder without recordings, which names those compressed in another way.
fn no_recording(folder: &Path, container: Container) -> DatasetError {
    match packed_otherwise(folder, container) {
        Some(name) => DatasetError::Field {
            path: folder.join(&name),
            field: "compression".to_owned(),
            found: format!("{:?}", name.rsplit('.').next().unwrap_or_default()),
            expected: format!(
                "zstd (.zstd or .zst), or a file that was unpacked to {} before",
                container.endings().first().unwrap_or(&"")
            ),
        },
        None => DatasetError::NoFrames { path: folder.to_owned(), expected: container.expected() },
    }
}

/// Returns the first name in a folder of a recording that is compressed in an unknown way.
fn packed_otherwise(folder: &Path, container: Container) -> Option<String> {
    // What a compressed video is, its name does not say.
    if container == Container::Mkv {
        return None;
    }
    let names = all_names_in(folder).into_iter().map(|name| name.to_string_lossy().into_owned());
    names.filter(|name| stem(Path::new(name), container).is_none() && folder.join(name).is_file()).find(|name| {
        let lower = name.to_ascii_lowercase();
        lower.rsplit_once('.').is_some_and(|(start, _)| ends_with_one_of(start, container))
    })
}

/// A file of a recording, opened for reading.
#[derive(Debug)]
pub(super) struct OpenPart {
    pub(super) file: File,
    /// Its size, unpacked.
    pub(super) bytes: u64,
    /// True if it was compressed as a whole.
    pub(super) was_packed: bool,
    /// Damage to the compressed data.
    pub(super) damage: Option<String>,
}

impl OpenPart {
    /// Opens a file. One that was compressed as a whole is unpacked to an unnamed temporary file, which disappears when it
    /// is closed.
    ///
    /// # Errors
    /// If it cannot be read, would unpack to far more than recordings do, or the temporary file cannot be written.
    pub(super) fn new(path: &Path) -> Result<Self, DatasetError> {
        let io_error = |source| DatasetError::Io { path: path.to_owned(), source };
        let mut file = open_file(path)?;
        let bytes = file.metadata().map_err(io_error)?.len();
        let mut start = Vec::new();
        Read::by_ref(&mut file).take(zstd::MAGIC.len() as u64).read_to_end(&mut start).map_err(io_error)?;
        file.seek(SeekFrom::Start(0)).map_err(io_error)?;
        if !zstd::is_zstd(&start) {
            return Ok(Self { file, bytes, was_packed: false, damage: None });
        }
        Self::unpacked(path, file, bytes)
    }

    fn unpacked(path: &Path, packed: File, packed_bytes: u64) -> Result<Self, DatasetError> {
        let limit = packed_bytes.saturating_mul(MAX_RATIO).saturating_add(ALWAYS_UNPACKED_BYTES);
        let field = |field: &str, found: String, expected: String| DatasetError::Field {
            path: path.to_owned(),
            field: field.to_owned(),
            found,
            expected,
        };
        let no_room = |error: std::io::Error| {
            let expected = format!(
                "room to unpack {} of zstd data in {}: set TMPDIR to a folder on a larger disk, or unpack them with zstd -d",
                display_bytes(packed_bytes),
                std::env::temp_dir().display()
            );
            field("temporary file", error.to_string(), expected)
        };
        let mut file = tempfile::tempfile().map_err(no_room)?;
        let mut reader = BufReader::with_capacity(READ_BUFFER_BYTES, packed);
        let damage = match zstd::unpack(&mut reader, &mut file, limit) {
            Ok(_) => None,
            Err(ZstdError::Damaged(what)) => Some(what),
            Err(ZstdError::TooLarge(what)) => {
                let expected = format!(
                    "at most {MAX_RATIO} times its size and {}: if it is a recording, unpack it with zstd -d",
                    display_bytes(ALWAYS_UNPACKED_BYTES)
                );
                return Err(field("zstd data", what, expected));
            }
            Err(ZstdError::Write(error)) => return Err(no_room(error)),
        };
        let bytes = file.metadata().map_err(no_room)?.len();
        if bytes == 0 {
            let found = damage.unwrap_or_else(|| "nothing in them".to_owned());
            return Err(field("zstd data", found, "a recording".to_owned()));
        }
        file.seek(SeekFrom::Start(0)).map_err(no_room)?;
        let damage = damage
            .map(|what| format!("{}: {what}; it is read up to byte {bytes} of what it unpacks to", path.display()));
        Ok(Self { file, bytes, was_packed: true, damage })
    }
}
