//! Definitions of message types as text: fields, one per line, and the definitions of the types used in them.

use std::collections::BTreeMap;

/// Separates the definitions of types, with a line that names the next one.
const SEPARATOR: &str = "====";
/// Maximum number of types and of fields in all of them.
const MAX_TYPES: usize = 256;
const MAX_FIELDS: usize = 4096;

/// A built-in type of a fixed size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Primitive {
    /// A whole number or truth value of this many bytes.
    Integer(usize),
    /// A number with a fraction of this many bytes.
    Float(usize),
}

impl Primitive {
    pub(super) fn bytes(self) -> usize {
        match self {
            Self::Integer(bytes) | Self::Float(bytes) => bytes,
        }
    }
}

/// The type of a field, or of an element of one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Primitive(Primitive),
    Text,
    /// A time or duration of ROS 1: two numbers of four bytes.
    Time,
    /// A message, by name.
    Message(String),
}

/// How many elements a field has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Length {
    One,
    Fixed(u64),
    /// A number before the elements.
    Stated,
}

/// A field of a message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Field {
    pub(super) name: String,
    pub(super) kind: Kind,
    pub(super) length: Length,
}

/// Types by name, e.g. `std_msgs/Header`.
#[derive(Clone, Debug, Default)]
pub(super) struct Definitions(BTreeMap<String, Vec<Field>>);

impl Definitions {
    /// Parses the definition of the type `name` (`package/Type`), followed by those that it uses.
    ///
    /// # Errors
    /// Description of what cannot be parsed.
    pub(super) fn parse(name: &str, text: &str) -> Result<Self, String> {
        let mut types: BTreeMap<String, Vec<Field>> = BTreeMap::new();
        let (mut current, mut fields) = (name.to_owned(), 0usize);
        types.insert(current.clone(), Vec::new());
        for line in text.lines() {
            if line.starts_with(SEPARATOR) {
                continue;
            }
            if let Some(next) = line.strip_prefix("MSG:") {
                next.trim().clone_into(&mut current);
                types.insert(current.clone(), Vec::new());
            } else if let Some(field) = field(line, &current)? {
                fields += 1;
                types.entry(current.clone()).or_default().push(field);
            }
            if types.len() > MAX_TYPES || fields > MAX_FIELDS {
                return Err(format!("the definition of {name} has too many types or fields"));
            }
        }
        Ok(Self(types))
    }

    /// Returns the fields of a type.
    ///
    /// # Errors
    /// If it is not defined.
    pub(super) fn fields(&self, name: &str) -> Result<&[Field], String> {
        self.0.get(name).map(Vec::as_slice).ok_or_else(|| format!("the type {name:?} is not defined"))
    }
}

/// Parses a line of the definition of a type; `None` for comments, constants and empty lines.
fn field(line: &str, owner: &str) -> Result<Option<Field>, String> {
    let line = line.split('#').next().unwrap_or_default().trim();
    let mut words = line.split_whitespace();
    let (Some(type_text), Some(name)) = (words.next(), words.next()) else {
        return if line.is_empty() { Ok(None) } else { Err(format!("{line:?} is not a field")) };
    };
    if name.contains('=') || words.next().is_some_and(|word| word.starts_with('=')) {
        return Ok(None);
    }
    let (element, length) = match type_text.split_once('[') {
        None => (type_text, Length::One),
        Some((element, count)) => match count.trim_end_matches(']') {
            "" => (element, Length::Stated),
            count => (element, Length::Fixed(count.parse().map_err(|_| format!("{type_text:?} is not a type"))?)),
        },
    };
    Ok(Some(Field { name: name.to_owned(), kind: kind(element, owner), length }))
}

/// Returns the type with a name that stands in the definition of `owner`.
fn kind(name: &str, owner: &str) -> Kind {
    match name {
        "bool" | "int8" | "uint8" | "byte" | "char" => Kind::Primitive(Primitive::Integer(1)),
        "int16" | "uint16" => Kind::Primitive(Primitive::Integer(2)),
        "int32" | "uint32" => Kind::Primitive(Primitive::Integer(4)),
        "int64" | "uint64" => Kind::Primitive(Primitive::Integer(8)),
        "float32" => Kind::Primitive(Primitive::Float(4)),
        "float64" => Kind::Primitive(Primitive::Float(8)),
        "string" => Kind::Text,
        "time" | "duration" => Kind::Time,
        "Header" => Kind::Message("std_msgs/Header".to_owned()),
        name if name.contains('/') => Kind::Message(name.to_owned()),
        // A type of the same package.
        name => Kind::Message(format!("{}/{name}", owner.split('/').next().unwrap_or_default())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn definitions_are_parsed() {
        let text = "# A comment\nuint8 OK=0\nint32 BAD = -1\nHeader header\n\nfloat64[9]  K # row-major\nPoint[] points\n\
                    string text\n================\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n\
                    ====\nMSG: my/Point\nfloat64 x\n";
        let definitions = Definitions::parse("my/Cloud", text).unwrap();
        let field = |name: &str, kind, length| Field { name: name.to_owned(), kind, length };
        let message = |name: &str| Kind::Message(name.to_owned());
        assert_eq!(
            definitions.fields("my/Cloud").unwrap(),
            [
                field("header", message("std_msgs/Header"), Length::One),
                field("K", Kind::Primitive(Primitive::Float(8)), Length::Fixed(9)),
                field("points", message("my/Point"), Length::Stated),
                field("text", Kind::Text, Length::One),
            ]
        );
        assert_eq!(definitions.fields("std_msgs/Header").unwrap()[1].kind, Kind::Time);
        assert_eq!(definitions.fields("my/Line").unwrap_err(), "the type \"my/Line\" is not defined");
        assert_eq!(Definitions::parse("a/B", "float64").unwrap_err(), "\"float64\" is not a field");
        assert_eq!(Definitions::parse("a/B", "int8[x] y").unwrap_err(), "\"int8[x]\" is not a type");
        assert!(Definitions::parse("a/B", &"int8 x\n".repeat(5000)).unwrap_err().contains("too many"));
    }
}
