//! Records of SQLite: the values of a row (section 2.1 of the file format), and the names of a table's columns.

use std::ops::Range;

/// More columns than any table of a recording has.
const MAX_COLUMNS: usize = 256;

/// A value of a record.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Value {
    Null,
    Integer(i64),
    /// A text or a blob: its place in the record.
    Bytes(Range<u64>),
    /// A number with a fraction, which no recording has.
    Real,
}

/// Parses a number of variable length. Returns it and the bytes after it.
pub(super) fn varint(bytes: &[u8]) -> Option<(i64, &[u8])> {
    let mut value = 0u64;
    for (index, byte) in bytes.iter().enumerate().take(9) {
        if index == 8 {
            value = value << 8 | u64::from(*byte);
        } else {
            value = value << 7 | u64::from(byte & 0x7F);
        }
        if byte & 0x80 == 0 || index == 8 {
            return Some((value as i64, bytes.get(index + 1..)?));
        }
    }
    None
}

/// Parses the values of a record, of which `local` is the part at hand; `None` if it is damaged. Integers beyond that part
/// are too.
pub(super) fn values(local: &[u8], bytes: u64) -> Option<Vec<Value>> {
    let (header_bytes, after) = varint(local)?;
    let header_bytes = usize::try_from(header_bytes).ok()?;
    let mut kinds = local.get(local.len() - after.len()..header_bytes)?;
    let mut position = header_bytes as u64;
    let mut values = Vec::new();
    while !kinds.is_empty() && values.len() < MAX_COLUMNS {
        let (kind, rest) = varint(kinds)?;
        kinds = rest;
        let length: u64 = match kind {
            0 | 8 | 9 => 0,
            1..=4 => kind as u64,
            5 => 6,
            6 | 7 => 8,
            12.. => (kind as u64 - 12) / 2,
            _ => return None,
        };
        let end = position.checked_add(length).filter(|end| *end <= bytes)?;
        values.push(match kind {
            0 => Value::Null,
            7 => Value::Real,
            8 | 9 => Value::Integer(kind - 8),
            1..=6 => Value::Integer(integer(local.get(position as usize..end as usize)?)?),
            _ => Value::Bytes(position..end),
        });
        position = end;
    }
    Some(values)
}

/// Parses an integer of one to eight bytes, big endian with a sign.
fn integer(bytes: &[u8]) -> Option<i64> {
    let start = if bytes.first()? & 0x80 == 0 { 0 } else { -1 };
    Some(bytes.iter().fold(start, |number, byte| number << 8 | i64::from(*byte)))
}

/// Parses the names of a table's columns from the statement that created it, in lower case and in order.
pub(super) fn columns(statement: &str) -> Vec<String> {
    let Some((_, inside)) = statement.split_once('(') else { return Vec::new() };
    let mut definitions = vec![String::new()];
    let (mut depth, mut quote) = (0usize, None);
    for letter in inside.chars() {
        match (quote, letter) {
            (Some(open), _) if letter == open => quote = None,
            (None, '"' | '\'' | '`') => quote = Some(letter),
            (None, '[') => quote = Some(']'),
            (None, '(') => depth += 1,
            (None, ')') if depth == 0 => break,
            (None, ')') => depth -= 1,
            (None, ',') if depth == 0 => {
                definitions.push(String::new());
                continue;
            }
            _ => {}
        }
        if let Some(last) = definitions.last_mut() {
            last.push(letter);
        }
    }
    let is_constraint =
        |name: &String| ["constraint", "primary", "unique", "check", "foreign"].contains(&name.as_str());
    definitions.iter().map(|definition| name_of(definition)).filter(|name| !is_constraint(name)).collect()
}

/// Returns the first name of a definition, without quotation marks.
fn name_of(definition: &str) -> String {
    let definition = definition.trim_start();
    let quoted = |open: char, close: char| definition.strip_prefix(open)?.split(close).next();
    let name =
        quoted('"', '"').or_else(|| quoted('`', '`')).or_else(|| quoted('[', ']')).or_else(|| quoted('\'', '\''));
    let bare = || definition.split(|letter: char| letter.is_whitespace() || letter == '(').next().unwrap_or_default();
    name.unwrap_or_else(bare).to_ascii_lowercase()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_variable_length_are_parsed() {
        for (bytes, expected) in [
            (&[0x7F][..], 127),
            (&[0x81, 0x00], 128),
            (&[0x82, 0x23], 291),
            (&[0xFF; 9], -1),
            (&[0x81, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x00], 1 << 57),
        ] {
            assert_eq!(varint(bytes), Some((expected, &[][..])), "{bytes:x?}");
            assert_eq!(varint(&bytes[..bytes.len() - 1]), None);
        }
        assert_eq!(varint(&[5, 6]), Some((5, &[6][..])));
    }

    #[test]
    fn a_record_has_its_values() {
        // NULL, 1 byte, 2 bytes, the constants 0 and 1, a text, a blob that begins here and ends elsewhere.
        let record = [8, 0, 1, 2, 8, 9, 17, 28, 0xFE, 0x01, 0x02, b'o', b'k', 9, 9];
        let expected = [
            Value::Null,
            Value::Integer(-2),
            Value::Integer(258),
            Value::Integer(0),
            Value::Integer(1),
            Value::Bytes(11..13),
            Value::Bytes(13..21),
        ];
        assert_eq!(values(&record, 21).unwrap(), expected);
        assert_eq!(values(&record, 20), None, "a value ends after the record");
        assert_eq!(values(&record[..10], 21), None, "an integer is cut off");
        assert_eq!(values(&[2, 10], 2), None, "reserved kind");
        assert_eq!(values(&[9, 1], 2), None, "the header is longer than the record");
    }

    #[test]
    fn columns_are_named_in_order() {
        let rosbag2 = "CREATE TABLE messages(id INTEGER PRIMARY KEY,topic_id INTEGER NOT NULL,timestamp INTEGER NOT NULL, \
                       data BLOB NOT NULL)";
        assert_eq!(columns(rosbag2), ["id", "topic_id", "timestamp", "data"]);
        let quoted = "CREATE TABLE \"a\" (\"Data\" BLOB DEFAULT ('a,b)'),\n [topic id] INT CHECK (x IN (1, 2)), `t` INT, \
                      CONSTRAINT c UNIQUE (t), PRIMARY KEY(t)) WITHOUT ROWID";
        assert_eq!(columns(quoted), ["data", "topic id", "t"]);
        assert_eq!(columns("CREATE"), [""; 0]);
        assert_eq!(columns("CREATE TABLE a(b"), ["b"]);
    }
}
