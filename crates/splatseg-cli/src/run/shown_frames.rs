//! Results of the frames of a run when they were processed, for the final pass: a line of text for each frame, in a file
//! that is removed with the run's other temporary files.
//!
//! The final pass also needs the regions of the segmenter, which are in no result. If a power cut ends it while it replaces
//! the id images, and it starts again, it needs what they showed before.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::read::DeflateDecoder;
use flate2::write::DeflateEncoder;
use splatseg_geometry::SegmentMap;
use splatseg_tracking::ShownFrame;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};

/// Name of the file, without its extension.
pub const SHOWN: &str = "shown";

/// The file of a run whose state is not saved.
#[derive(Debug)]
pub struct ShownFile {
    path: PathBuf,
    file: File,
}

impl ShownFile {
    /// Creates the file in a folder, with these lines of frames.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn create(folder: &Path, lines: Vec<String>) -> io::Result<Self> {
        let path = folder.join(format!("{SHOWN}.jsonl"));
        let mut shown = Self { file: File::create(&path)?, path };
        lines.into_iter().try_for_each(|line| shown.add(line.into_bytes()))?;
        Ok(shown)
    }

    /// Appends a frame.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn add(&mut self, mut line: Vec<u8>) -> io::Result<()> {
        line.push(b'\n');
        self.file.write_all(&line)
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

/// The line of a frame: a JSON string with the ids, and the regions if there are any, as runs of equal pixels.
///
/// # Errors
/// Never in memory.
pub fn line(segments: &SegmentMap, regions: Option<&SegmentMap>) -> io::Result<Vec<u8>> {
    let mut numbers: Vec<u8> = Vec::new();
    for image in std::iter::once(segments).chain(regions) {
        let runs: Vec<&[u32]> = image.pixels().chunk_by(|one, next| one == next).collect();
        let head = [image.width() as u32, image.height() as u32, runs.len() as u32];
        numbers.extend(head.into_iter().flat_map(u32::to_le_bytes));
        numbers.extend(runs.iter().flat_map(|run| [run[0], run.len() as u32]).flat_map(u32::to_le_bytes));
    }
    // In one piece: each call clears the encoder's whole buffer.
    let mut encoder = DeflateEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(&numbers)?;
    Ok(format!("\"{}\"", STANDARD.encode(encoder.finish()?)).into_bytes())
}

/// Reads the lines of a file in their order, one for each frame; see [`parsed`].
///
/// # Errors
/// If the file cannot be opened.
pub fn read(path: &Path) -> io::Result<impl Iterator<Item = io::Result<String>> + use<>> {
    Ok(BufReader::new(File::open(path)?).lines())
}

/// Parses a line. `size` is the size of the frame (width, height). Regions may have a lower resolution.
///
/// # Errors
/// If it is damaged, or an image has more pixels.
pub fn parsed(line: &str, size: (usize, usize)) -> io::Result<ShownFrame> {
    let bytes = STANDARD.decode(line.trim_matches('"')).map_err(|error| wrong(&error.to_string()))?;
    // Each of two images has at most one run for each pixel.
    let most = 2 * (12 + 8 * (size.0 * size.1) as u64);
    let mut numbers = Vec::new();
    DeflateDecoder::new(bytes.as_slice()).take(most).read_to_end(&mut numbers)?;
    let mut numbers = numbers.as_chunks::<4>().0.iter().map(|bytes| u32::from_le_bytes(*bytes));
    let segments = image(&mut numbers, size)?.ok_or_else(|| wrong("no ids"))?;
    Ok(ShownFrame { segments, regions: image(&mut numbers, size)? })
}

/// The next image; `None` at the end.
fn image(numbers: &mut impl Iterator<Item = u32>, size: (usize, usize)) -> io::Result<Option<SegmentMap>> {
    let Some(width) = numbers.next() else { return Ok(None) };
    let mut next = || numbers.next().ok_or_else(|| wrong("too short"));
    let found = (width as usize, next()? as usize);
    if found.0 > size.0 || found.1 > size.1 {
        return Err(wrong(&format!("{}x{} pixels, expected {}x{} at most", found.0, found.1, size.0, size.1)));
    }
    let size = found;
    let mut pixels = Vec::with_capacity(size.0 * size.1);
    for _ in 0..next()? {
        let (id, length) = (next()?, next()? as usize);
        if pixels.len() + length > size.0 * size.1 {
            return Err(wrong("too many pixels"));
        }
        pixels.resize(pixels.len() + length, id);
    }
    SegmentMap::from_pixels(size.0, size.1, pixels).map(Some).map_err(|error| wrong(&error.to_string()))
}

fn wrong(what: &str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, what)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(regions: bool) -> ShownFrame {
        let segments = SegmentMap::from_fn(7, 5, |column, row| if row < 2 { 70_000 } else { (column / 3) as u32 });
        let regions = regions.then(|| SegmentMap::from_fn(7, 5, |column, row| (7 * row + column) as u32));
        ShownFrame { segments, regions }
    }

    #[test]
    fn frames_come_back_as_they_were() {
        let folder = tempfile::tempdir().unwrap();
        let mut file = ShownFile::create(folder.path(), vec!["\"earlier\"".to_owned()]).unwrap();
        let frames = [frame(true), frame(false)];
        for frame in &frames {
            file.add(line(&frame.segments, frame.regions.as_ref()).unwrap()).unwrap();
        }
        let mut lines = read(file.path()).unwrap();
        assert_eq!(lines.next().unwrap().unwrap(), "\"earlier\"");
        let found: Vec<ShownFrame> = lines.map(|line| parsed(&line.unwrap(), (7, 5)).unwrap()).collect();
        assert_eq!(found, frames);
    }

    #[test]
    fn damaged_lines_are_refused() {
        let frame = frame(true);
        let text = String::from_utf8(line(&frame.segments, frame.regions.as_ref()).unwrap()).unwrap();
        assert!(parsed(&text, (6, 6)).unwrap_err().to_string().contains("7x5 pixels, expected 6x6 at most"));
        for length in 0..text.len() {
            let cut = parsed(&text[..length], (7, 5));
            assert!(cut.is_err() || cut.is_ok_and(|found| found == frame), "{length}");
        }
        assert!(parsed("\"####\"", (7, 5)).is_err());
    }
}
