//! The pages of a SQLite database, and the rows of its tables, read only.
//!
//! The format is specified at <https://www.sqlite.org/fileformat2.html>. A table is a B-tree: interior pages (section 1.6)
//! lead to leaf pages with one cell per row. What does not fit into a leaf lies in a chain of overflow pages. All numbers
//! are big endian. Nothing in a file is trusted: pages must exist, a page belongs to a tree once, and a row is not longer
//! than the file.

use super::records::varint;
use super::write_ahead_log::WriteAheadLog;
use crate::DatasetError;
use crate::files::RandomAccessFile;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// First bytes of every database.
const MAGIC: &[u8] = b"SQLite format 3\0";
/// Bytes before the first page's B-tree.
pub(super) const HEADER_BYTES: usize = 100;
/// Least usable bytes of a page.
const MIN_USABLE: usize = 480;
const LEAF: u8 = 13;
const INTERIOR: u8 = 5;
/// More levels than any tree has.
const MAX_DEPTH: usize = 40;
/// Pages are read in blocks of this many bytes, because those of a long row usually follow each other.
const BLOCK_BYTES: usize = 128 << 10;
/// Number of blocks kept.
const BLOCKS: usize = 4;

/// A database whose header has been read.
#[derive(Debug)]
pub(in crate::recording) struct Database {
    path: PathBuf,
    file: RandomAccessFile,
    page_bytes: usize,
    /// Bytes of a page without its reserved end.
    usable: usize,
    /// Number of complete pages in the file.
    stored_pages: u32,
    /// Number of complete pages in the file and its log.
    pub(super) pages: u32,
    /// Number of pages that the header states; 0 if it does not.
    pub(super) stated_pages: u32,
    log: Option<WriteAheadLog>,
    /// Number of the column with the data of messages.
    pub(super) data_column: usize,
}

/// Why a page or a row cannot be read.
#[derive(Debug)]
pub(super) enum Fault {
    Io(std::io::Error),
    /// Description of the damage.
    Damaged(String),
}

impl Fault {
    fn new(what: impl Into<String>) -> Self {
        Self::Damaged(what.into())
    }
}

/// A leaf page of a table, or the reason why one is left out.
#[derive(Clone, Debug)]
pub(super) enum Visit<'p> {
    /// A leaf page, with its number.
    Leaf(u32, &'p [u8]),
    /// Description of a page that is left out.
    Damaged(String),
}

/// Place of a row: its leaf page, and the number of its cell there.
#[derive(Clone, Copy, Debug)]
pub(super) struct CellPlace {
    pub(super) page: u32,
    pub(super) cell: u16,
}

/// A row of a table.
#[derive(Clone, Debug)]
pub(super) struct Cell {
    pub(super) rowid: i64,
    /// Length of the whole record.
    pub(super) bytes: u64,
    /// The part of the record that is in the leaf, as a range of the page.
    pub(super) local: Range<usize>,
    /// First overflow page; 0 if there is none.
    overflow: u32,
}

impl Database {
    /// Reads the header of a database.
    ///
    /// # Errors
    /// If the file is not a database, or of a kind that is not read.
    pub(super) fn open(path: &Path, file: RandomAccessFile, bytes: u64) -> Result<Self, DatasetError> {
        let field = |field: &str, found: String, expected: &str| DatasetError::Field {
            path: path.to_owned(),
            field: field.to_owned(),
            found,
            expected: expected.to_owned(),
        };
        let header = file.read(0, bytes.min(HEADER_BYTES as u64));
        let header = header.map_err(|source| DatasetError::Io { path: path.to_owned(), source })?;
        if !header.starts_with(MAGIC) || header.len() < HEADER_BYTES {
            let start = header.get(..MAGIC.len()).unwrap_or(&header);
            let found = match start {
                [] => "an empty file".to_owned(),
                start => format!("{:?}", start.escape_ascii().to_string()),
            };
            let expected = "\"SQLite format 3\\\\x00\" and a header of 100 bytes, the start of every SQLite file";
            return Err(field("first bytes", found, expected));
        }
        let page_bytes = match number(&header, 16, 2) {
            1 => 1 << 16,
            bytes => bytes,
        };
        let usable = page_bytes.saturating_sub(number(&header, 20, 1));
        if !page_bytes.is_power_of_two() || page_bytes < 512 || usable < MIN_USABLE {
            let expected = "a power of two from 512 to 65536";
            return Err(field("page size", format!("{page_bytes}, {usable} of it usable"), expected));
        }
        if number(&header, 56, 4) > 1 {
            return Err(field("text encoding", format!("{}", number(&header, 56, 4)), "1 (UTF-8)"));
        }
        let pages = u32::try_from(bytes / page_bytes as u64).unwrap_or(u32::MAX);
        // Old versions of SQLite do not keep the number of pages up to date.
        let is_stated = header.get(24..28) == header.get(92..96);
        let stated_pages = if is_stated { number(&header, 28, 4) as u32 } else { 0 };
        let path = path.to_owned();
        Ok(Self { path, file, page_bytes, usable, stored_pages: pages, pages, stated_pages, log: None, data_column: 0 })
    }

    /// Puts pages of a log in place of those of the file.
    pub(super) fn add_log(&mut self, log: WriteAheadLog) {
        self.pages = log.pages(self.stored_pages);
        self.stated_pages = 0;
        self.log = Some(log);
    }

    pub(super) fn page_bytes(&self) -> usize {
        self.page_bytes
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Returns its size with that of its log, bytes.
    pub(super) fn bytes(&self) -> u64 {
        u64::from(self.pages) * self.page_bytes as u64
    }

    /// Reads a page, and the pages behind it in the file, at most `ahead` bytes. Pages of the log are read alone.
    fn read_pages(&self, first: u32, ahead: usize) -> Result<Vec<u8>, Fault> {
        let logged = self.log.as_ref().map(|log| log.page(first, self.page_bytes)).transpose().map_err(Fault::Io)?;
        if let Some(page) = logged.flatten() {
            return Ok(page);
        }
        let next_logged = self.log.as_ref().and_then(|log| log.next_page(first)).unwrap_or(u32::MAX);
        let end = next_logged.min(self.stored_pages.saturating_add(1));
        let Some(count) = end.checked_sub(first).filter(|count| *count > 0) else {
            return Err(Fault::new(format!("page {first} is in neither the file nor its log")));
        };
        let offset = u64::from(first - 1) * self.page_bytes as u64;
        let wanted = (ahead / self.page_bytes).clamp(1, count as usize) * self.page_bytes;
        self.file.read(offset, wanted as u64).map_err(Fault::Io)
    }
}

/// Reader of a database's pages.
#[derive(Debug)]
pub(super) struct Pages<'a> {
    database: &'a Database,
    /// Blocks of pages, each with the number of its first page; the last used one last.
    blocks: Vec<(u32, Vec<u8>)>,
}

impl<'a> Pages<'a> {
    pub(super) fn new(database: &'a Database) -> Self {
        Self { database, blocks: Vec::new() }
    }

    /// Returns a page. With the block that begins there it reads `ahead` bytes.
    pub(super) fn page(&mut self, number: u32, ahead: usize) -> Result<&[u8], Fault> {
        let Database { page_bytes, pages, .. } = *self.database;
        if number == 0 || number > pages {
            return Err(Fault::new(format!("there is no page {number}, the file has {pages}")));
        }
        let offset_in = |start: u32| number.checked_sub(start).map(|pages| pages as usize * page_bytes);
        let holds = |(start, block): &(u32, Vec<u8>)| offset_in(*start).is_some_and(|offset| offset < block.len());
        if let Some(at) = self.blocks.iter().position(holds) {
            let block = self.blocks.remove(at);
            self.blocks.push(block);
        } else {
            let block = self.database.read_pages(number, ahead)?;
            if self.blocks.len() >= BLOCKS {
                self.blocks.remove(0);
            }
            self.blocks.push((number, block));
        }
        let found = self.blocks.last().and_then(|(start, block)| {
            let offset = offset_in(*start)?;
            block.get(offset..offset + page_bytes)
        });
        found.ok_or_else(|| Fault::new(format!("page {number} is incomplete")))
    }

    /// Visits the leaf pages of a table in order, and leaves out damaged ones.
    ///
    /// # Errors
    /// If the file cannot be read, or `visit` fails.
    pub(super) fn leaves(
        &mut self,
        root: u32,
        visit: &mut dyn FnMut(Visit<'_>) -> Result<(), DatasetError>,
    ) -> Result<(), DatasetError> {
        let database = self.database;
        let mut visited = vec![0u64; database.pages as usize / 64 + 1];
        let mut waiting: Vec<std::vec::IntoIter<u32>> = vec![vec![root].into_iter()];
        while let Some(level) = waiting.last_mut() {
            let Some(number) = level.next() else {
                waiting.pop();
                continue;
            };
            let page = match self.page(number, 0) {
                Ok(page) => page,
                Err(Fault::Io(source)) => return Err(DatasetError::Io { path: database.path.clone(), source }),
                Err(Fault::Damaged(what)) => {
                    visit(Visit::Damaged(what))?;
                    continue;
                }
            };
            if let Some(bits) = visited.get_mut(number as usize / 64) {
                if *bits >> (number % 64) & 1 == 1 {
                    visit(Visit::Damaged(format!("page {number} is in the table twice")))?;
                    continue;
                }
                *bits |= 1 << (number % 64);
            }
            match page.get(tree_start(number)) {
                Some(&LEAF) => visit(Visit::Leaf(number, page))?,
                Some(&INTERIOR) if waiting.len() < MAX_DEPTH => {
                    waiting.push(children(page, tree_start(number)).into_iter());
                }
                kind => {
                    let kind = kind.copied().unwrap_or_default();
                    visit(Visit::Damaged(format!("page {number} is of kind {kind}, not of a table's tree")))?;
                }
            }
        }
        Ok(())
    }

    /// Returns a part of a row's record.
    pub(super) fn read(&mut self, place: CellPlace, cell: &Cell, part: Range<u64>) -> Result<Vec<u8>, Fault> {
        let length = part.end.saturating_sub(part.start);
        if length > self.database.bytes() || part.end > cell.bytes {
            return Err(Fault::new(format!("a value of {length} bytes in a record of {}", cell.bytes)));
        }
        let mut bytes = Vec::with_capacity(length as usize);
        let local = cell.local.len() as u64;
        let page = self.page(place.page, 0)?;
        let record = page.get(cell.local.clone()).unwrap_or_default();
        bytes.extend_from_slice(overlap(record, 0, &part));
        let (mut next, mut position) = (cell.overflow, local);
        while position < part.end {
            let usable = self.database.usable;
            let left = usize::try_from(cell.bytes - position).unwrap_or(usize::MAX);
            let page = self.page(next, left.min(BLOCK_BYTES))?;
            let content = page.get(4..usable).unwrap_or_default();
            bytes.extend_from_slice(overlap(content, position, &part));
            position += content.len() as u64;
            next = number(page, 0, 4) as u32;
        }
        Ok(bytes)
    }
}

/// Returns the bytes of `content`, which begins at `position`, that are in `part`.
fn overlap<'c>(content: &'c [u8], position: u64, part: &Range<u64>) -> &'c [u8] {
    let place = |at: u64| usize::try_from(at.saturating_sub(position)).unwrap_or(usize::MAX).min(content.len());
    content.get(place(part.start)..place(part.end)).unwrap_or_default()
}

/// Returns the offset of a page's B-tree.
fn tree_start(page: u32) -> usize {
    if page == 1 { HEADER_BYTES } else { 0 }
}

/// Returns a number of `bytes` bytes, big endian; 0 beyond the end.
fn number(page: &[u8], at: usize, bytes: usize) -> usize {
    let digits = page.get(at..at + bytes).unwrap_or_default();
    digits.iter().fold(0, |number, digit| number << 8 | usize::from(*digit))
}

/// Returns the pages below an interior page, in order.
fn children(page: &[u8], start: usize) -> Vec<u32> {
    let cells = number(page, start + 3, 2).min(page.len() / 2);
    let pointers = (0..cells).map(|cell| number(page, start + 12 + 2 * cell, 2));
    let mut children: Vec<u32> = pointers.map(|pointer| number(page, pointer, 4) as u32).collect();
    children.push(number(page, start + 8, 4) as u32);
    children
}

/// Returns the number of rows of a leaf page.
pub(super) fn cells(page_number: u32, page: &[u8]) -> u16 {
    // A row takes at least four bytes: its pointer, its length and its number.
    number(page, tree_start(page_number) + 3, 2).min(page.len() / 4) as u16
}

impl Database {
    /// Returns a row of a leaf page; `None` if it is damaged.
    pub(super) fn cell(&self, place: CellPlace, page: &[u8]) -> Option<Cell> {
        let pointer = tree_start(place.page) + 8 + 2 * usize::from(place.cell);
        let start = number(page.get(..pointer + 2)?, pointer, 2);
        let rest = page.get(start..self.usable)?;
        let (bytes, after_length) = varint(rest)?;
        let (rowid, record) = varint(after_length)?;
        let bytes = u64::try_from(bytes).ok().filter(|bytes| *bytes <= self.bytes())?;
        let local = usize::try_from(bytes).ok().filter(|bytes| *bytes <= self.usable - 35);
        let local_bytes = local.unwrap_or_else(|| {
            let least = (self.usable - 12) * 32 / 255 - 23;
            let fitting = least + ((bytes - least as u64) % (self.usable as u64 - 4)) as usize;
            if fitting <= self.usable - 35 { fitting } else { least }
        });
        let record_start = self.usable - record.len();
        let after = record.get(local_bytes..)?;
        let overflow = if local.is_some() { 0 } else { number(after.get(..4)?, 0, 4) as u32 };
        Some(Cell { rowid, bytes, local: record_start..record_start + local_bytes, overflow })
    }
}
