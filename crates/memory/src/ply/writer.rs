//! Memories to files.

use super::error::SplatFileError;
use super::layout::Sizes;
use super::{CHUNK_BYTES, SplatContentView, SplatFileView, header, record, trailer};
use crc32fast::Hasher;
use splatseg_atomic_file::AtomicFile;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// Writes under a temporary name and renames.
pub fn save(view: &SplatFileView<'_>, path: &Path) -> Result<(), SplatFileError> {
    let sizes = Sizes::of(view);
    check_lengths(view, path)?;
    sizes.check_segments(path)?;
    trailer::check_ids(view.ids, &sizes, path)?;
    let mut file = AtomicFile::create(path).map_err(SplatFileError::io(path, "create a file beside it"))?;
    write_file(view, &sizes, path, &mut file)?;
    file.commit().map_err(SplatFileError::io(path, "put the finished file there"))
}

/// Refuses arrays whose lengths contradict each other.
fn check_lengths(view: &SplatFileView<'_>, path: &Path) -> Result<(), SplatFileError> {
    let count = view.map.len();
    let content = match view.content {
        SplatContentView::Evidence { votes } => ("votes", votes.len(), count),
        SplatContentView::Features { features, codebook } => {
            ("features", features.len(), count.saturating_mul(codebook.feature_dim()))
        }
    };
    let lengths = [
        ("radii", view.map.balls.radii.len(), count),
        ("colors", view.map.colors.len(), count),
        ("last_seen", view.map.last_seen.len(), count),
        ("seen_through", view.map.seen_through.len(), count),
        content,
        ("segment_ids", view.segment_ids.len(), count),
        ("sightings", view.sightings.len(), view.ids.len()),
        ("carried", view.carried.len(), view.ids.len()),
    ];
    for (field, found, expected) in lengths {
        if found != expected {
            return Err(SplatFileError::Inconsistent { path: path.to_owned(), field, found, expected });
        }
    }
    Ok(())
}

fn write_file(
    view: &SplatFileView<'_>,
    sizes: &Sizes,
    path: &Path,
    file: &mut AtomicFile,
) -> Result<(), SplatFileError> {
    let mut output = Output { file: BufWriter::new(file), crc: Hasher::new(), path: path.to_owned() };
    output.write(header::format(sizes, view.origin).as_bytes())?;
    let mut chunk = Vec::with_capacity(CHUNK_BYTES + sizes.layout.record_bytes() as usize);
    for index in 0..view.map.len() {
        record::encode(view, index, path, &mut chunk)?;
        if chunk.len() >= CHUNK_BYTES {
            output.write(&chunk)?;
            chunk.clear();
        }
    }
    output.write(&chunk)?;
    trailer::write(view, sizes, &mut output)?;
    output.finish()
}

/// The file being written and the checksum of what is in it.
pub struct Output<W: Write> {
    file: BufWriter<W>,
    crc: Hasher,
    path: PathBuf,
}

impl<W: Write> Output<W> {
    /// Appends bytes.
    pub fn write(&mut self, bytes: &[u8]) -> Result<(), SplatFileError> {
        self.crc.update(bytes);
        self.file.write_all(bytes).map_err(SplatFileError::io(&self.path, "write"))
    }

    /// Appends numbers of four bytes.
    pub fn write_words(&mut self, words: impl Iterator<Item = [u8; 4]>) -> Result<(), SplatFileError> {
        let mut chunk = Vec::with_capacity(CHUNK_BYTES);
        for word in words {
            chunk.extend(word);
            if chunk.len() >= CHUNK_BYTES {
                self.write(&chunk)?;
                chunk.clear();
            }
        }
        self.write(&chunk)
    }

    fn finish(mut self) -> Result<(), SplatFileError> {
        let checksum = self.crc.clone().finalize();
        self.write(&checksum.to_le_bytes())?;
        self.file.flush().map_err(SplatFileError::io(&self.path, "write"))
    }
}
