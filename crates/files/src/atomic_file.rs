//! Files that appear complete or not at all.

use std::ffi::OsStr;
use std::fs::File;
use std::io::{BufWriter, Error, ErrorKind, Result, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use tempfile::TempPath;

/// Beginning of the names of temporary files.
const PREFIX: &str = ".writing-";
/// Random characters at the end of these names.
const RANDOM_CHARS: usize = 6;
/// Characters of the destination's name in these names. Names may have 255 bytes.
const NAME_CHARS: usize = 50;

/// A buffered file that is renamed to its destination on commit.
///
/// It is locked while it is open, so that [`remove_leftovers`] knows those of programs that were killed.
#[derive(Debug)]
pub struct AtomicFile {
    // Declared first, so that it is closed before the temporary file is removed.
    file: BufWriter<File>,
    temporary: TempPath,
    path: PathBuf,
}

impl AtomicFile {
    /// Starts a file with the destination `path`. Its folder must exist. If `path` is a link to a file, that file is the
    /// destination. If there is a file, the new one gets its permissions.
    ///
    /// # Errors
    /// If no file can be created in that folder.
    pub fn create(path: impl Into<PathBuf>) -> Result<Self> {
        let path = linked(path.into());
        let prefix = temporary_prefix(&path);
        let mut builder = tempfile::Builder::new();
        builder.prefix(&prefix).rand_bytes(RANDOM_CHARS);
        // Temporary files are private by default; the result gets the mode of any new file (less the umask).
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        let (file, temporary) = builder.tempfile_in(folder_of(&path))?.into_parts();
        // A file that only its owner may read stays so. Some file systems have no permissions.
        if let Ok(replaced) = std::fs::metadata(&path) {
            let _ = file.set_permissions(replaced.permissions());
        }
        // Some network file systems have no locks. What a killed program leaves there stays.
        let _ = file.try_lock();
        Ok(Self { file: BufWriter::new(file), temporary, path })
    }

    /// Drops everything behind the first `bytes` bytes, which must have been [flushed](Write::flush). What is written next
    /// follows them, also after an error of writing: a part of what could not be written may be in the file.
    ///
    /// # Errors
    /// If fewer bytes are in the file, or it cannot be cut.
    pub fn truncate(&mut self, bytes: u64) -> Result<()> {
        let mut file = self.file.get_ref().try_clone()?;
        let found = file.metadata()?.len();
        if found < bytes {
            return Err(Error::other(format!("{found} bytes are in the file, expected {bytes} or more")));
        }
        file.set_len(bytes)?;
        file.seek(SeekFrom::Start(bytes))?;
        // Taken apart, so that it does not write its buffer.
        let _ = std::mem::replace(&mut self.file, BufWriter::new(file)).into_parts();
        Ok(())
    }

    /// Renames the file to its destination, replacing any existing file. Returns when both the content and the name are on
    /// the disk: after a power cut there is the old file or the new one.
    ///
    /// # Errors
    /// If the last bytes cannot be written or the file cannot be renamed.
    pub fn commit(self) -> Result<()> {
        let file = self.file.into_inner().map_err(|error| error.into_error())?;
        sync(&file)?;
        self.temporary.persist(&self.path).map_err(|error| error.error)?;
        sync_folder(folder_of(&self.path))
    }

    /// As [`AtomicFile::commit`], but does not wait for the disk: after a power cut within the next half minute the file
    /// may be empty. For files of which there are many; [`sync_file_system`] waits for all of them.
    ///
    /// # Errors
    /// As [`AtomicFile::commit`].
    pub fn commit_unsynced(self) -> Result<()> {
        let _file = self.file.into_inner().map_err(|error| error.into_error())?;
        self.temporary.persist(&self.path).map_err(|error| error.error)
    }

    /// As [`AtomicFile::commit`], unless the destination exists.
    ///
    /// # Errors
    /// As [`AtomicFile::commit`], and [`AlreadyExists`](std::io::ErrorKind::AlreadyExists) if the destination exists.
    pub fn commit_new(self) -> Result<()> {
        let file = self.file.into_inner().map_err(|error| error.into_error())?;
        sync(&file)?;
        self.temporary.persist_noclobber(&self.path).map_err(|error| error.error)?;
        sync_folder(folder_of(&self.path))
    }

    /// As [`AtomicFile::commit_new`], but does not wait for the disk; see [`AtomicFile::commit_unsynced`].
    ///
    /// # Errors
    /// As [`AtomicFile::commit_new`].
    pub fn commit_new_unsynced(self) -> Result<()> {
        let _file = self.file.into_inner().map_err(|error| error.into_error())?;
        self.temporary.persist_noclobber(&self.path).map(drop).map_err(|error| error.error)
    }
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> Result<()> {
        self.file.flush()
    }
}

/// Writes `bytes` to `path` as an [`AtomicFile`], replacing any existing file, and waits for the disk.
///
/// # Errors
/// If the folder does not exist or the file cannot be written.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<()> {
    let mut file = AtomicFile::create(path)?;
    file.write_all(bytes)?;
    file.commit()
}

/// As [`write_atomically`], but does not wait for the disk; see [`AtomicFile::commit_unsynced`].
///
/// # Errors
/// As [`write_atomically`].
pub fn write_unsynced(path: &Path, bytes: &[u8]) -> Result<()> {
    let mut file = AtomicFile::create(path)?;
    file.write_all(bytes)?;
    file.commit_unsynced()
}

/// Removes what killed programs have left of writing to `path`: temporary files for it that nobody has open. Returns how
/// many were removed. What cannot be removed stays.
pub fn remove_leftovers(path: &Path) -> usize {
    let path = &linked(path.to_owned());
    let prefix = temporary_prefix(path);
    let is_leftover = |name: &OsStr| {
        let random = name.to_str().and_then(|name| name.strip_prefix(&prefix));
        random.is_some_and(|random| {
            random.len() == RANDOM_CHARS && random.bytes().all(|byte| byte.is_ascii_alphanumeric())
        })
    };
    let entries = std::fs::read_dir(folder_of(path)).into_iter().flatten().flatten();
    let found = entries.filter(|entry| is_leftover(&entry.file_name())).map(|entry| entry.path());
    let is_free = |path: &PathBuf| {
        let is_file = path.symlink_metadata().is_ok_and(|metadata| metadata.is_file());
        is_file && File::open(path).is_ok_and(|file| file.try_lock().is_ok())
    };
    found.filter(is_free).filter(|path| std::fs::remove_file(path).is_ok()).count()
}

/// Waits until everything that was written to the file system of `folder` is on the disk. Does nothing on systems other
/// than Linux.
///
/// # Errors
/// If the folder cannot be opened, or the disk reports an error.
pub fn sync_file_system(folder: &Path) -> Result<()> {
    #[cfg(target_os = "linux")]
    {
        let folder = File::open(folder)?;
        ignore_unsupported(rustix::fs::syncfs(&folder).map_err(Into::into))
    }
    #[cfg(not(target_os = "linux"))]
    {
        let _ = folder;
        Ok(())
    }
}

/// Waits until the names of a folder's files are on the disk. Only Unix systems can open a folder.
fn sync_folder(folder: &Path) -> Result<()> {
    if cfg!(unix) { sync(&File::open(folder)?) } else { Ok(()) }
}

fn sync(file: &File) -> Result<()> {
    ignore_unsupported(file.sync_all())
}

/// Some file systems cannot wait for a disk, e.g. because they have none.
fn ignore_unsupported(result: Result<()>) -> Result<()> {
    match result {
        Err(error) if matches!(error.kind(), ErrorKind::InvalidInput | ErrorKind::Unsupported) => Ok(()),
        result => result,
    }
}

/// The file that a link names, if `path` is one.
fn linked(path: PathBuf) -> PathBuf {
    let is_link = path.symlink_metadata().is_ok_and(|metadata| metadata.is_symlink());
    // Of a link to nothing, the link itself is replaced.
    if is_link { path.canonicalize().unwrap_or(path) } else { path }
}

fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Beginning of the name of a temporary file for `path`, up to the random characters.
fn temporary_prefix(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let name: String = name.chars().take(NAME_CHARS).collect();
    format!("{PREFIX}{name}-")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;
    use std::io::ErrorKind;

    fn names(folder: &Path) -> Vec<String> {
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
    }

    #[test]
    fn an_uncommitted_file_leaves_the_old_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        write_atomically(&path, b"old").unwrap();
        let mut file = AtomicFile::create(&path).unwrap();
        file.write_all(&vec![7; 100_000]).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"old");
        drop(file);
        assert_eq!(names(folder.path()), ["a.txt"]);
        write_atomically(&path, b"new").unwrap();
        assert_eq!((fs::read(&path).unwrap(), names(folder.path()).len()), (b"new".to_vec(), 1));
    }

    #[test]
    fn a_new_file_replaces_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        let commit = |text: &[u8]| {
            let mut file = AtomicFile::create(&path).unwrap();
            file.write_all(text).unwrap();
            file.commit_new()
        };
        commit(b"first").unwrap();
        assert_eq!(commit(b"second").unwrap_err().kind(), ErrorKind::AlreadyExists);
        assert_eq!((fs::read(&path).unwrap(), names(folder.path()).len()), (b"first".to_vec(), 1));
    }

    #[test]
    fn a_file_that_was_cut_goes_on_behind_the_cut() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        let mut file = AtomicFile::create(&path).unwrap();
        file.write_all(b"whole").unwrap();
        assert!(file.truncate(5).is_err(), "not in the file yet");
        file.flush().unwrap();
        // Some of it is in the file, some in the buffer.
        file.write_all(&vec![7; 100_000]).unwrap();
        file.write_all(b"part").unwrap();
        file.truncate(5).unwrap();
        assert_eq!(remove_leftovers(&path), 0, "it is still locked");
        file.write_all(b", end").unwrap();
        file.commit().unwrap();
        assert_eq!((fs::read(&path).unwrap(), names(folder.path()).len()), (b"whole, end".to_vec(), 1));
    }

    #[test]
    fn a_folder_that_does_not_exist_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(AtomicFile::create(folder.path().join("b/a.txt")).unwrap_err().kind(), ErrorKind::NotFound);
    }

    #[cfg(unix)]
    #[test]
    fn files_are_as_readable_as_any_new_one() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let (ours, plain) = (folder.path().join("ours"), folder.path().join("plain"));
        write_atomically(&ours, b"").unwrap();
        fs::write(&plain, b"").unwrap();
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode();
        assert_eq!(mode(&ours), mode(&plain));
    }

    #[cfg(unix)]
    #[test]
    fn a_linked_file_is_replaced_where_it_is_and_keeps_its_permissions() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let folder = tempfile::tempdir().unwrap();
        let (real, link) = (folder.path().join("real/map.ply"), folder.path().join("map.ply"));
        fs::create_dir(folder.path().join("real")).unwrap();
        fs::write(&real, b"old").unwrap();
        fs::set_permissions(&real, PermissionsExt::from_mode(0o600)).unwrap();
        symlink("real/map.ply", &link).unwrap();
        write_atomically(&link, b"new").unwrap();
        assert_eq!(fs::read(&real).unwrap(), b"new");
        assert!(link.symlink_metadata().unwrap().is_symlink());
        assert_eq!(fs::metadata(&real).unwrap().permissions().mode() & 0o777, 0o600);
        assert_eq!(names(&folder.path().join("real")), ["map.ply"]);
        let left = folder.path().join("real/.writing-map.ply-aB3dE6");
        fs::write(&left, b"part").unwrap();
        assert_eq!(remove_leftovers(&link), 1);

        let nowhere = folder.path().join("nowhere");
        symlink("missing/file", &nowhere).unwrap();
        write_atomically(&nowhere, b"text").unwrap();
        assert!(fs::symlink_metadata(&nowhere).unwrap().is_file());
    }

    #[test]
    fn unsynced_files_replace_others_too_and_file_systems_can_be_synced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        write_atomically(&path, b"old").unwrap();
        write_unsynced(&path, b"new").unwrap();
        let again = AtomicFile::create(&path).unwrap().commit_new_unsynced();
        assert_eq!(again.unwrap_err().kind(), ErrorKind::AlreadyExists);
        assert_eq!((fs::read(&path).unwrap(), names(folder.path()).len()), (b"new".to_vec(), 1));
        sync_file_system(folder.path()).unwrap();
    }

    #[test]
    fn only_what_killed_programs_left_of_a_file_is_removed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("map.ply");
        let open = AtomicFile::create(&path).unwrap();
        for name in [".writing-map.ply-aB3dE6", ".writing-other.ply-aB3dE6", ".writing-map.ply-mine.txt", "map.ply"] {
            fs::write(folder.path().join(name), b"part").unwrap();
        }
        fs::create_dir(folder.path().join(".writing-map.ply-folder")).unwrap();
        assert_eq!(remove_leftovers(&path), 1);
        assert_eq!(remove_leftovers(&path), 0);
        let mut left = names(folder.path());
        left.sort_unstable();
        assert_eq!(left.len(), 5, "{left:?}");
        assert!(!left.contains(&".writing-map.ply-aB3dE6".to_owned()), "{left:?}");
        open.commit().unwrap();
        assert_eq!(names(folder.path()).len(), 4);
    }

    #[test]
    fn names_of_any_length_can_be_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("\u{e9}".repeat(127));
        write_atomically(&path, b"text").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"text");
        assert_eq!(remove_leftovers(Path::new("/does/not/exist/map.ply")), 0);
    }
}
