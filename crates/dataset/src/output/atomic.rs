//! Files that are there whole or not at all.

use super::OutputError;
use std::io::Write;
use std::path::Path;

/// Writes `bytes` to `path`, replacing what is there: to a temporary file in the same folder, which is then renamed. A
/// reader sees the old file or the new one, never a part; on any error (no such folder, disk full) the temporary file
/// is removed and the old one stays. The folder must exist.
///
/// # Errors
/// [`OutputError::Io`] names the path.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), OutputError> {
    let io_error = |source| OutputError::Io { path: path.to_owned(), source };
    let folder = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut builder = tempfile::Builder::new();
    builder.prefix(".writing-");
    // Temporary files are private by default, but the result should be readable like any other file (less the umask).
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let mut file = builder.tempfile_in(folder).map_err(io_error)?;
    file.write_all(bytes).map_err(io_error)?;
    file.persist(path).map_err(|error| io_error(error.error))?;
    Ok(())
}
