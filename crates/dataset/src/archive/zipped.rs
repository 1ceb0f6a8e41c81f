//! Images inside a zip file.

use crate::DatasetError;
use crate::files::open_file;
use splatseg_files::MemoryLimit;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use zip::ZipArchive;

/// Maximum unpacked size of an image. The largest segment images have a few hundred kilobytes.
const MAX_MEMBER_BYTES: u64 = 32 << 20;
/// Maximum length of the end of a zip file that can contain its directory's end record: 22 bytes, a zip64 locator of 20
/// bytes, and a comment of up to 65535.
const TAIL_BYTES: u64 = 22 + 20 + 65_535;
/// Length of the record with the 64-bit counts of a directory.
const ZIP64_END_BYTES: usize = 56;
/// Least length of a member's entry in the directory.
const MEMBER_BYTES: u64 = 46;
/// Memory that the list takes for each member, about.
const MEMBER_MEMORY: u64 = 512;
/// Divisor of the memory limit that gives the limit of the list.
const MEMORY_PART: u64 = 4;

/// A zip file whose images can be read individually, from any thread.
#[derive(Debug)]
pub(crate) struct ZippedImages {
    path: PathBuf,
    archive: Mutex<ZipArchive<File>>,
}

impl ZippedImages {
    /// Reads the list of a zip file's members.
    pub(crate) fn open(path: &Path) -> Result<Self, DatasetError> {
        let io_error = |source| DatasetError::Io { path: path.to_owned(), source };
        let mut file = open_file(path)?;
        if let Some(members) = zip64_members(&mut file).map_err(io_error)? {
            let most = MemoryLimit::in_force() / MEMORY_PART / MEMBER_MEMORY;
            if members > most {
                return Err(DatasetError::Field {
                    path: path.to_owned(),
                    field: "zip64 directory".to_owned(),
                    found: match members {
                        u64::MAX => "no number of members".to_owned(),
                        members => format!("{members} members"),
                    },
                    expected: format!("at most {most}, for which there is memory"),
                });
            }
        }
        let archive = ZipArchive::new(file)
            .map_err(|error| DatasetError::Archive { path: path.to_owned(), source: error.into() })?;
        Ok(Self { path: path.to_owned(), archive: Mutex::new(archive) })
    }

    /// Returns the path of a member, for messages.
    pub(crate) fn place(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }

    /// Returns the names of all members, without those that are not text.
    pub(crate) fn names(&self) -> Vec<String> {
        let archive = self.archive.lock().unwrap_or_else(PoisonError::into_inner);
        archive.file_names().flatten().map(|name| name.into_owned()).collect()
    }

    /// Reads a member; also returns its path for messages. `None` if there is no such member.
    pub(crate) fn read(&self, name: &str, what: &'static str) -> Result<Option<(PathBuf, Vec<u8>)>, DatasetError> {
        let path = self.place(name);
        let damaged = |source: std::io::Error| DatasetError::Archive { path: path.clone(), source };
        // A panicked reader leaves no state behind, because every read seeks first.
        let mut archive = self.archive.lock().unwrap_or_else(PoisonError::into_inner);
        if archive.index_for_name(name).is_none() {
            return Ok(None);
        }
        let member = archive.by_name(name).map_err(|error| damaged(error.into()))?;
        // The stated size may be wrong: the buffer grows with the data, up to one byte over the limit.
        let mut bytes = Vec::new();
        member.take(MAX_MEMBER_BYTES + 1).read_to_end(&mut bytes).map_err(damaged)?;
        if bytes.len() as u64 > MAX_MEMBER_BYTES {
            let bytes = bytes.len() as u64;
            return Err(DatasetError::FileTooBig { path, what, bytes, limit: MAX_MEMBER_BYTES });
        }
        Ok(Some((path, bytes)))
    }
}

/// Returns the number of members that a zip64 directory at the end of the file states: `u64::MAX` if it states none or more
/// than the file has room for; `None` if there is no such directory. A plain one counts to 65535.
fn zip64_members(file: &mut File) -> std::io::Result<Option<u64>> {
    let len = file.seek(SeekFrom::End(0))?;
    file.seek(SeekFrom::Start(len.saturating_sub(TAIL_BYTES)))?;
    let mut tail = Vec::new();
    file.take(TAIL_BYTES).read_to_end(&mut tail)?;
    // The 20 bytes of the zip64 locator come right before the end record.
    let locators =
        tail.windows(24).filter(|window| window.starts_with(b"PK\x06\x07") && window.ends_with(b"PK\x05\x06"));
    let mut most = None;
    for locator in locators {
        let mut record = [0; ZIP64_END_BYTES];
        file.seek(SeekFrom::Start(number(locator, 8).min(len)))?;
        let is_record = file.read_exact(&mut record).is_ok() && record.starts_with(b"PK\x06\x06");
        let members = number(&record, 32);
        let fits = members.checked_mul(MEMBER_BYTES).is_some_and(|bytes| bytes <= len);
        most = most.max(Some(if is_record && fits { members } else { u64::MAX }));
    }
    Ok(most)
}

/// A little-endian number of eight bytes; 0 beyond the end.
fn number(bytes: &[u8], at: usize) -> u64 {
    bytes.get(at..).and_then(|rest| rest.first_chunk()).map_or(0, |bytes| u64::from_le_bytes(*bytes))
}
