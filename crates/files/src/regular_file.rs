//! Regular files of limited size.

use std::fs::{File, FileType, Metadata};
use std::io::{Error, ErrorKind, Read, Result};
use std::path::Path;

/// Opens a regular file for reading. Symlinks are followed; their target must be a regular file, too.
///
/// # Errors
/// Errors of the operating system, and [`InvalidInput`](ErrorKind::InvalidInput) for a folder, a device, a FIFO or a
/// socket.
pub fn open_file(path: &Path) -> Result<File> {
    // Checked before opening: opening a FIFO waits for a writer, and opening a device can have side effects.
    require_regular(&std::fs::metadata(path)?)?;
    let file = File::open(path)?;
    // Checked again after opening: the file may have been replaced in between.
    require_regular(&file.metadata()?)?;
    Ok(file)
}

/// Reads a regular file of at most `limit` bytes.
///
/// # Errors
/// The errors of [`open_file`], and [`FileTooLarge`](ErrorKind::FileTooLarge) for a longer file, which is not read.
pub fn read_file(path: &Path, limit: u64) -> Result<Vec<u8>> {
    let file = open_file(path)?;
    let len = file.metadata()?.len();
    let too_large =
        |len: u64| Error::new(ErrorKind::FileTooLarge, format!("{len} bytes are too many, at most {limit} are read"));
    if len > limit {
        return Err(too_large(len));
    }
    let mut bytes = Vec::with_capacity(usize::try_from(len).unwrap_or_default());
    // The file may grow meanwhile, and some file systems report no length.
    file.take(limit.saturating_add(1)).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > limit { Err(too_large(bytes.len() as u64)) } else { Ok(bytes) }
}

fn require_regular(metadata: &Metadata) -> Result<()> {
    if metadata.is_file() {
        return Ok(());
    }
    let found = kind_of(metadata.file_type());
    Err(Error::new(ErrorKind::InvalidInput, format!("it is {found}, expected a regular file")))
}

#[cfg(unix)]
fn kind_of(file_type: FileType) -> &'static str {
    use std::os::unix::fs::FileTypeExt;
    match file_type {
        kind if kind.is_dir() => "a folder",
        kind if kind.is_fifo() => "a FIFO",
        kind if kind.is_socket() => "a socket",
        kind if kind.is_char_device() || kind.is_block_device() => "a device",
        _ => "a special file",
    }
}

#[cfg(not(unix))]
fn kind_of(file_type: FileType) -> &'static str {
    if file_type.is_dir() { "a folder" } else { "a special file" }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_up_to_the_limit_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        std::fs::write(&path, b"four").unwrap();
        assert_eq!(read_file(&path, 4).unwrap(), b"four");
        let error = read_file(&path, 3).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::FileTooLarge);
        assert_eq!(error.to_string(), "4 bytes are too many, at most 3 are read");
        assert_eq!(read_file(&folder.path().join("b"), 3).unwrap_err().kind(), ErrorKind::NotFound);
    }

    #[cfg(unix)]
    #[test]
    fn special_files_are_refused_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let (fifo, zero, link) = (folder.path().join("fifo"), folder.path().join("zero"), folder.path().join("link"));
        assert!(std::process::Command::new("mkfifo").arg(&fifo).status().unwrap().success());
        std::os::unix::fs::symlink("/dev/zero", &zero).unwrap();
        for (path, kind) in [(fifo.as_path(), "a FIFO"), (&zero, "a device"), (folder.path(), "a folder")] {
            let error = open_file(path).unwrap_err();
            assert_eq!(error.kind(), ErrorKind::InvalidInput);
            assert_eq!(error.to_string(), format!("it is {kind}, expected a regular file"));
        }
        std::fs::write(folder.path().join("file"), b"text").unwrap();
        std::os::unix::fs::symlink(folder.path().join("file"), &link).unwrap();
        assert_eq!(read_file(&link, 10).unwrap(), b"text");
    }
}
