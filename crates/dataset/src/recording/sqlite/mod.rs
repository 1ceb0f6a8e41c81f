//! Recordings of rosbag2 in SQLite: its tables `topics` and `messages`, read without a library for SQLite.
//!
//! A scan first lists all messages, then reads them in the order of their times. An image is read again by the place of
//! its row (`pages.rs`); `records.rs` parses rows. A recorder that was killed leaves its last pages in a log
//! (`write_ahead_log.rs`).

mod pages;
mod records;
mod write_ahead_log;

pub(super) use pages::Database;

use super::container::{Channel, FoundMessage, RecordSink, max_message_bytes};
use super::recorded_file::ScannedFile;
use crate::DatasetError;
use crate::files::{RandomAccessFile, open_file};
use crate::ros_topics::contents::MessagePlace;
use crate::ros_topics::frame_names::{listed, one_line};
use pages::{Cell, CellPlace, Fault, Pages, Visit, cells};
use records::{Value, columns, values};
use std::borrow::Cow;
use std::ops::Range;
use std::path::{Path, PathBuf};
use write_ahead_log::{FoundLog, WriteAheadLog};

/// First page of the list of tables.
const SCHEMA_PAGE: u32 = 1;
/// Maximum length of a statement that creates a table, and of a topic's name or type, bytes.
const MAX_TEXT_BYTES: u64 = 1 << 20;
/// Maximum number of tables looked at.
const MAX_TABLES: usize = 1000;

/// A table of the database.
#[derive(Clone, Debug)]
struct Table {
    name: String,
    root: u32,
    columns: Vec<String>,
    has_rowids: bool,
}

/// A message, as listed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct ListedMessage {
    timestamp: i64,
    rowid: i64,
    topic: i64,
    page: u32,
    cell: u16,
}

/// Reads all messages of a database into `sink`, in the order of their times. Skips damaged parts. `number` is that of
/// the file in its recording.
///
/// # Errors
/// If the file cannot be read, is not a database of rosbag2, or the sink fails.
pub(super) fn scan(
    file: &mut ScannedFile<'_>,
    number: usize,
    sink: &mut dyn RecordSink,
) -> Result<Database, DatasetError> {
    let mut database = Database::open(file.path, RandomAccessFile::new(file.reader()?), file.bytes)?;
    read_log(&mut database, &mut file.damage)?;
    warn_of_unread(&database, &mut file.damage);
    let mut scan = Scan { database: &database, pages: Pages::new(&database), damaged: None, read_bytes: 0 };
    let data_column = scan.read_all(file, number, sink)?;
    if let Some((count, first)) = scan.damaged {
        let path = file.path.display();
        file.damage.push(match count {
            1 => format!("{path}: a part of the database is damaged and left out: {first}"),
            _ => format!("{path}: {count} parts of the database are damaged and left out; the first: {first}"),
        });
    }
    database.data_column = data_column;
    Ok(database)
}

/// Adds lines about messages that are not in the file.
fn warn_of_unread(database: &Database, damage: &mut Vec<String>) {
    let path = database.path().display();
    if database.stated_pages > database.pages {
        damage.push(format!(
            "{path}: the recording is cut off: its header states {} pages, but the file has {}",
            database.stated_pages, database.pages
        ));
    }
    if let Some(journal) = beside(database, "-journal") {
        damage.push(format!(
            "{path}: the recording was not closed, and a change was not finished ({}): sqlite3 {path} 'PRAGMA integrity_check' \
             undoes it",
            name_of(&journal)
        ));
    }
}

/// Adds the pages of the write-ahead log that a recorder leaves if it is killed.
fn read_log(database: &mut Database, damage: &mut Vec<String>) -> Result<(), DatasetError> {
    let Some(log) = beside(database, "-wal") else { return Ok(()) };
    let found = WriteAheadLog::read(open_file(&log)?, database.page_bytes());
    match found.map_err(|source| DatasetError::Io { path: log.clone(), source })? {
        FoundLog::Log(log) => database.add_log(log),
        FoundLog::NoTransaction => {}
        FoundLog::Unreadable => damage.push(format!(
            "{}: the recording was not closed, and the log beside it with its last messages ({}) cannot be read",
            database.path().display(),
            name_of(&log)
        )),
    }
    Ok(())
}

/// Returns the path of a file beside a database that is not empty.
fn beside(database: &Database, ending: &str) -> Option<PathBuf> {
    let mut name = database.path().as_os_str().to_owned();
    name.push(ending);
    let path = PathBuf::from(name);
    std::fs::metadata(&path).is_ok_and(|metadata| metadata.is_file() && metadata.len() > 0).then_some(path)
}

fn name_of(path: &Path) -> std::path::Display<'_> {
    Path::new(path.file_name().unwrap_or_default()).display()
}

/// State while reading a database.
struct Scan<'a> {
    database: &'a Database,
    pages: Pages<'a>,
    /// Number of damaged pages and rows, and a description of the first.
    damaged: Option<(u64, String)>,
    /// Size of all records read. In a valid database it is less than that of the file.
    read_bytes: u64,
}

impl Scan<'_> {
    fn report(&mut self, what: impl FnOnce() -> String) {
        report(&mut self.damaged, what);
    }

    fn io_error(&self, source: std::io::Error) -> DatasetError {
        DatasetError::Io { path: self.database.path().to_owned(), source }
    }

    /// Reads all tables. Returns the number of the column with the messages' data.
    fn read_all(
        &mut self,
        file: &mut ScannedFile<'_>,
        number: usize,
        sink: &mut dyn RecordSink,
    ) -> Result<usize, DatasetError> {
        let tables = self.tables()?;
        let topics = self.table(&tables, "topics", &["id", "name", "type", "serialization_format"])?;
        let messages = self.table(&tables, "messages", &["topic_id", "timestamp", "data"])?;
        self.read_topics(&topics, sink)?;
        let list = self.list(&messages, sink)?;
        let data = messages.columns.iter().position(|name| name == "data").unwrap_or_default();
        for message in list {
            self.pass_on(message, data, (file, number), sink)?;
        }
        Ok(data)
    }

    /// Calls `row` with each row of a table.
    fn rows(
        &mut self,
        root: u32,
        row: &mut dyn FnMut(Row<'_>) -> Result<(), DatasetError>,
    ) -> Result<(), DatasetError> {
        let (database, damaged) = (self.database, &mut self.damaged);
        self.pages.leaves(root, &mut |visit| {
            let (number, page) = match visit {
                Visit::Leaf(number, page) => (number, page),
                Visit::Damaged(what) => {
                    report(damaged, || what);
                    return Ok(());
                }
            };
            for cell_number in 0..cells(number, page) {
                let place = CellPlace { page: number, cell: cell_number };
                let parsed = database.cell(place, page).and_then(|cell| {
                    let found = values(page.get(cell.local.clone())?, cell.bytes)?;
                    Some((cell, found))
                });
                match parsed {
                    Some((cell, found)) => row(Row { place, cell: &cell, values: &found })?,
                    None => report(damaged, || format!("row {cell_number} of page {number} cannot be read")),
                }
            }
            Ok(())
        })
    }

    /// Returns the text of a value of a row; `None` if it is none, too long or damaged.
    fn text(&mut self, place: CellPlace, cell: &Cell, value: Option<&Value>) -> Option<String> {
        let Some(Value::Bytes(part)) = value else { return None };
        if part.end - part.start > MAX_TEXT_BYTES {
            return None;
        }
        let bytes = self.pages.read(place, cell, part.clone()).ok()?;
        String::from_utf8(bytes).ok()
    }

    /// Returns all rows of a small table, with their values.
    fn all_rows(&mut self, root: u32, limit: usize) -> Result<Vec<(CellPlace, Cell, Vec<Value>)>, DatasetError> {
        let mut rows = Vec::new();
        self.rows(root, &mut |row| {
            if rows.len() < limit {
                rows.push((row.place, row.cell.clone(), row.values.to_vec()));
            }
            Ok(())
        })?;
        Ok(rows)
    }

    /// Returns the tables.
    fn tables(&mut self) -> Result<Vec<Table>, DatasetError> {
        let mut tables = Vec::new();
        for (place, cell, found) in self.all_rows(SCHEMA_PAGE, MAX_TABLES)? {
            // Columns: type, name, tbl_name, rootpage, sql.
            let is_table = self.text(place, &cell, found.first()).is_some_and(|kind| kind == "table");
            let name = self.text(place, &cell, found.get(1));
            let statement = self.text(place, &cell, found.get(4));
            if let (true, Some(name), Some(Value::Integer(root)), Some(statement)) =
                (is_table, name, found.get(3), statement)
            {
                tables.push(Table {
                    name: name.to_ascii_lowercase(),
                    root: u32::try_from(*root).unwrap_or_default(),
                    columns: columns(&statement),
                    has_rowids: !statement.to_ascii_lowercase().contains("without rowid"),
                });
            }
        }
        Ok(tables)
    }

    /// Returns the table with a name, which must have some columns.
    fn table(&self, tables: &[Table], name: &str, wanted: &[&str]) -> Result<Table, DatasetError> {
        let error = |field: String, found: String| DatasetError::Field {
            path: self.database.path().to_owned(),
            field,
            found,
            expected: format!("{}, as rosbag2 writes it", wanted.join(", ")),
        };
        let Some(table) = tables.iter().find(|table| table.name == name) else {
            let names = tables.iter().map(|table| one_line(&table.name)).collect();
            return Err(DatasetError::Field {
                path: self.database.path().to_owned(),
                field: "tables".to_owned(),
                found: listed(names),
                expected: "topics and messages, as rosbag2 writes them".to_owned(),
            });
        };
        if wanted.iter().any(|column| !table.columns.iter().any(|known| known == column)) {
            let names = table.columns.iter().map(|column| one_line(column)).collect();
            return Err(error(format!("columns of the table {name}"), listed(names)));
        }
        if !table.has_rowids {
            return Err(error(format!("table {name}"), "no row numbers (WITHOUT ROWID)".to_owned()));
        }
        Ok(table.clone())
    }

    /// Passes the topics on to `sink`.
    fn read_topics(&mut self, table: &Table, sink: &mut dyn RecordSink) -> Result<(), DatasetError> {
        let mut rows = Vec::new();
        self.rows(table.root, &mut |row| {
            sink.hold((size_of::<(CellPlace, Cell)>() + size_of_val(row.values)) as u64)?;
            rows.push((row.place, row.cell.clone(), row.values.to_vec()));
            Ok(())
        })?;
        for (place, cell, found) in rows {
            let id = integer(table, "id", &found, cell.rowid);
            let mut text = |name: &str| {
                let index = table.columns.iter().position(|column| column == name)?;
                self.text(place, &cell, found.get(index))
            };
            let (name, type_name, encoding) = (text("name"), text("type"), text("serialization_format"));
            let (Some(id), Some(name)) = (id, name) else {
                self.report(|| format!("topic {} cannot be read", cell.rowid));
                continue;
            };
            sink.channel(&Channel {
                id: id as u64,
                topic: &name,
                type_name: &type_name.unwrap_or_default(),
                encoding: &encoding.unwrap_or_default(),
            })?;
        }
        Ok(())
    }

    /// Lists the messages in the order of their times.
    fn list(&mut self, table: &Table, sink: &mut dyn RecordSink) -> Result<Vec<ListedMessage>, DatasetError> {
        let mut list = Vec::new();
        let mut incomplete = 0u64;
        self.rows(table.root, &mut |Row { place, cell, values }| {
            let number = |name: &str| integer(table, name, values, cell.rowid);
            let (Some(timestamp), Some(topic)) = (number("timestamp"), number("topic_id")) else {
                incomplete += 1;
                return Ok(());
            };
            // A vector grows to twice what it holds.
            sink.hold(2 * size_of::<ListedMessage>() as u64)?;
            let CellPlace { page, cell: number } = place;
            list.push(ListedMessage { timestamp, rowid: cell.rowid, topic, page, cell: number });
            Ok(())
        })?;
        if incomplete > 0 {
            self.report(|| format!("{incomplete} messages have no topic or time"));
        }
        if !list.is_sorted() {
            list.sort_unstable();
        }
        Ok(list)
    }

    /// Passes a message on to `sink`. `column` is the number of that with its data.
    fn pass_on(
        &mut self,
        message: ListedMessage,
        column: usize,
        (file, number): (&mut ScannedFile<'_>, usize),
        sink: &mut dyn RecordSink,
    ) -> Result<(), DatasetError> {
        let place = CellPlace { page: message.page, cell: message.cell };
        let data = match read_value(self.database, &mut self.pages, place, column) {
            Ok(data) => data,
            Err(Fault::Io(error)) => return Err(self.io_error(error)),
            Err(Fault::Damaged(what)) => {
                self.report(|| format!("message {}: {what}", message.rowid));
                return Ok(());
            }
        };
        self.read_bytes = self.read_bytes.saturating_add(data.len() as u64);
        if self.read_bytes > self.database.bytes() {
            return Err(DatasetError::Field {
                path: self.database.path().to_owned(),
                field: "messages".to_owned(),
                found: "more bytes than the file has".to_owned(),
                expected: "messages that do not share their bytes".to_owned(),
            });
        }
        let place = MessagePlace {
            chunk: u32::try_from(number).ok(),
            offset: u64::from(message.page) << 16 | u64::from(message.cell),
            len: data.len() as u64,
        };
        let log_time = u64::try_from(message.timestamp).unwrap_or_default();
        let Some(data) = file.unpacking.message(Cow::Owned(data))? else { return Ok(()) };
        sink.message(&FoundMessage { channel: message.topic as u64, log_time, place, data: Ok(&data) })
    }
}

/// A row of a table.
#[derive(Clone, Copy, Debug)]
struct Row<'r> {
    place: CellPlace,
    cell: &'r Cell,
    values: &'r [Value],
}

/// Counts something damaged, and describes the first.
fn report(damaged: &mut Option<(u64, String)>, what: impl FnOnce() -> String) {
    let (count, _) = damaged.get_or_insert_with(|| (0, what()));
    *count += 1;
}

/// Returns an integer of a row. A column that is the number of the row is not stored.
fn integer(table: &Table, column: &str, values: &[Value], rowid: i64) -> Option<i64> {
    match values.get(table.columns.iter().position(|name| name == column)?)? {
        Value::Integer(number) => Some(*number),
        Value::Null if column == "id" => Some(rowid),
        _ => None,
    }
}

/// Reads a text or blob of a row.
fn read_value(database: &Database, pages: &mut Pages<'_>, place: CellPlace, column: usize) -> Result<Vec<u8>, Fault> {
    let damaged = |what: &str| Fault::Damaged(what.to_owned());
    let page = pages.page(place.page, 0)?;
    if place.cell >= cells(place.page, page) {
        return Err(damaged("there is no such row"));
    }
    let cell = database.cell(place, page).ok_or_else(|| damaged("the row cannot be read"))?;
    let local = page.get(cell.local.clone()).unwrap_or_default();
    let found = values(local, cell.bytes).ok_or_else(|| damaged("its values cannot be read"))?;
    let Some(Value::Bytes(part)) = found.get(column) else { return Err(damaged("it has no data")) };
    let part: Range<u64> = part.clone();
    if part.end - part.start > max_message_bytes() {
        return Err(damaged("it is too long to be read"));
    }
    pages.read(place, &cell, part)
}

impl Database {
    /// Reads the stored data of a message again.
    ///
    /// # Errors
    /// If the file cannot be read, or has changed since it was opened.
    pub(super) fn read(&self, place: MessagePlace) -> Result<Vec<u8>, DatasetError> {
        let cell = CellPlace { page: (place.offset >> 16) as u32, cell: place.offset as u16 };
        read_value(self, &mut Pages::new(self), cell, self.data_column).map_err(|fault| match fault {
            Fault::Io(source) => DatasetError::Io { path: self.path().to_owned(), source },
            Fault::Damaged(found) => DatasetError::Field {
                path: self.path().to_owned(),
                field: "message".to_owned(),
                found,
                expected: "the same content as when the recording was opened".to_owned(),
            },
        })
    }
}
