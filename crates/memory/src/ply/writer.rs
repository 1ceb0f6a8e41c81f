//! Memories to files.

use super::crc32::Crc32;
use super::error::SplatFileError;
use super::{CHUNK_BYTES, SplatFileView, TRAILER_MAGIC, VERSION, header, record};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// Writes under a temporary name and renames.
pub fn save(view: &SplatFileView<'_>, path: &Path) -> Result<(), SplatFileError> {
    check(view, path)?;
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let mut temporary = create_temporary(folder).map_err(SplatFileError::io(path, "create a file beside it"))?;
    write_file(view, path, &mut temporary)?;
    temporary.persist(path).map_err(|error| SplatFileError::io(path, "put the finished file there")(error.error))?;
    Ok(())
}

/// Array lengths and ids that contradict each other.
fn check(view: &SplatFileView<'_>, path: &Path) -> Result<(), SplatFileError> {
    let count = view.gaussians.len();
    let lengths = [
        ("quats", view.gaussians.quats.len(), count),
        ("scales", view.gaussians.scales.len(), count),
        ("opacities", view.gaussians.opacities.len(), count),
        ("colors", view.colors.len(), count),
        ("features", view.features.len(), count.saturating_mul(view.codebook.feature_dim())),
        ("segment_ids", view.segment_ids.len(), count),
    ];
    for (field, found, expected) in lengths {
        if found != expected {
            return Err(SplatFileError::Inconsistent { path: path.to_owned(), field, found, expected });
        }
    }
    if view.used_codes > view.codebook.len() {
        let (found, codes) = (view.used_codes as u64, view.codebook.len());
        return Err(SplatFileError::UsedCodes { path: path.to_owned(), found, codes });
    }
    Ok(())
}

fn create_temporary(folder: &Path) -> std::io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".splatseg-").suffix(".tmp");
    #[cfg(unix)]
    {
        // What any new file gets, less the umask; a temporary file's default is for its owner alone.
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(folder)
}

fn write_file(view: &SplatFileView<'_>, path: &Path, file: &mut NamedTempFile) -> Result<(), SplatFileError> {
    let mut output = Output { file: BufWriter::new(file), crc: Crc32::new(), path: path.to_owned() };
    output.write(header::format(view).as_bytes())?;
    let mut chunk = Vec::with_capacity(CHUNK_BYTES + record::record_bytes(view.codebook.feature_dim()));
    for index in 0..view.gaussians.len() {
        record::encode(view, index, path, &mut chunk)?;
        output.write_full_chunk(&mut chunk)?;
    }
    chunk.extend(TRAILER_MAGIC);
    chunk.extend(VERSION.to_le_bytes());
    chunk.extend((view.codebook.feature_dim() as u32).to_le_bytes());
    chunk.extend((view.codebook.len() as u64).to_le_bytes());
    chunk.extend((view.used_codes as u64).to_le_bytes());
    chunk.extend(view.codebook.seed().to_le_bytes());
    chunk.extend(view.codebook.blocks().to_le_bytes());
    for value in view.codebook.vectors() {
        chunk.extend(value.to_le_bytes());
        output.write_full_chunk(&mut chunk)?;
    }
    output.write(&chunk)?;
    output.finish()
}

/// The file being written and the checksum of what is in it.
struct Output<W: Write> {
    file: BufWriter<W>,
    crc: Crc32,
    path: PathBuf,
}

impl<W: Write> Output<W> {
    fn write(&mut self, bytes: &[u8]) -> Result<(), SplatFileError> {
        self.crc.update(bytes);
        self.file.write_all(bytes).map_err(SplatFileError::io(&self.path, "write"))
    }

    /// Writes and empties `chunk` once it is large enough to be worth it.
    fn write_full_chunk(&mut self, chunk: &mut Vec<u8>) -> Result<(), SplatFileError> {
        if chunk.len() >= CHUNK_BYTES {
            self.write(chunk)?;
            chunk.clear();
        }
        Ok(())
    }

    fn finish(mut self) -> Result<(), SplatFileError> {
        let checksum = self.crc.value();
        self.write(&checksum.to_le_bytes())?;
        self.file.flush().map_err(SplatFileError::io(&self.path, "write"))
    }
}
