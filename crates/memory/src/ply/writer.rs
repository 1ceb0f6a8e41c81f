//! Writing of memories to files.

use super::checked_stream::Output;
use super::error::SplatFileError;
use super::layout::Sizes;
use super::{CHUNK_BYTES, CONTENT, SplatContentView, SplatFileView, header, record, trailer};
use splatseg_files::{AtomicFile, StateBlock, StateError};
use std::borrow::Cow;
use std::path::Path;

/// Writes the file under a temporary name and renames it.
pub fn save(view: &SplatFileView<'_>, path: &Path) -> Result<(), SplatFileError> {
    check_lengths(view, path)?;
    let saved_state = state_bytes(view, path)?;
    let sizes = Sizes::of(view, saved_state.len());
    let header = header::checked(view, &sizes, path)?;
    trailer::check_ids(view.ids, &sizes, path)?;
    let mut file = AtomicFile::create(path).map_err(SplatFileError::io(path, "create a temporary file beside it"))?;
    write_file(view, (&sizes, &header, &saved_state), path, &mut file)?;
    file.commit().map_err(SplatFileError::io(path, "rename the temporary file"))
}

/// The state besides the Gaussians as bytes; none for the default state.
fn state_bytes(view: &SplatFileView<'_>, path: &Path) -> Result<Vec<u8>, SplatFileError> {
    let mut state = Cow::Borrowed(view.saved_state);
    if let SplatContentView::Arrays { arrays } = &view.content {
        state.to_mut().put_block(CONTENT, StateBlock::clone(arrays));
    }
    if state.is_empty() {
        return Ok(Vec::new());
    }
    let failed = |error: StateError| SplatFileError::State { path: path.to_owned(), found: error.to_string() };
    state.to_bytes().map_err(failed)
}

/// Returns an error if the lengths of arrays contradict each other.
fn check_lengths(view: &SplatFileView<'_>, path: &Path) -> Result<(), SplatFileError> {
    let count = view.map.len();
    let content = match &view.content {
        SplatContentView::Evidence { votes } => ("votes", votes.len(), count),
        SplatContentView::Features { features, codebook } => {
            ("features", features.len(), count.saturating_mul(codebook.feature_dim()))
        }
        // Only their kind knows how long they are.
        SplatContentView::Arrays { .. } => ("arrays", 0, 0),
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
    (sizes, header, saved_state): (&Sizes, &str, &[u8]),
    path: &Path,
    file: &mut AtomicFile,
) -> Result<(), SplatFileError> {
    let mut output = Output::new(file, path);
    output.write(header.as_bytes())?;
    let mut chunk = Vec::with_capacity(CHUNK_BYTES + sizes.layout.record_bytes() as usize);
    for index in 0..view.map.len() {
        record::encode(view, index, path, &mut chunk)?;
        if chunk.len() >= CHUNK_BYTES {
            output.write(&chunk)?;
            chunk.clear();
        }
    }
    output.write(&chunk)?;
    trailer::write(view, sizes, saved_state, &mut output)?;
    output.finish()
}
