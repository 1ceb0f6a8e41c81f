//! JSON values reduced to the parts that annotations consist of, so that unrelated content takes no memory.

use serde::de::{Deserialize, Deserializer, IgnoredAny, MapAccess, SeqAccess, Visitor};
use std::borrow::Cow;
use std::fmt;

/// A JSON value. `Display` describes it briefly for an error message.
#[derive(Debug, PartialEq)]
pub enum Part {
    Null,
    Bool(bool),
    Number(f64),
    Text(String),
    /// A list of `u32` numbers, such as run lengths.
    Counts(Vec<u32>),
    /// Any other list: its length and a description of its first element that is not a `u32`.
    OtherList(usize, String),
    Object(Box<Fields>),
}

/// The entries of a JSON object that annotations use.
#[derive(Debug, Default, PartialEq)]
pub struct Fields {
    pub segmentation: Option<Part>,
    pub score: Option<Part>,
    pub size: Option<Part>,
    pub counts: Option<Part>,
}

impl Part {
    /// Returns the two numbers of a list of length 2.
    pub fn pair(&self) -> Option<(usize, usize)> {
        match self {
            Self::Counts(counts) => match **counts {
                [first, second] => Some((first as usize, second as usize)),
                _ => None,
            },
            _ => None,
        }
    }

    /// Returns the number if it is a `u32`.
    fn count(&self) -> Option<u32> {
        match *self {
            Self::Number(number) if number.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&number) => {
                Some(number as u32)
            }
            _ => None,
        }
    }
}

impl fmt::Display for Part {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Null => formatter.write_str("null"),
            Self::Bool(value) => write!(formatter, "{value}"),
            Self::Number(value) => write!(formatter, "{value}"),
            Self::Text(_) => formatter.write_str("a string"),
            Self::Counts(counts) => write!(formatter, "a list of {}", counts.len()),
            Self::OtherList(length, other) => write!(formatter, "a list of {length} with {other} in it"),
            Self::Object(_) => formatter.write_str("an object"),
        }
    }
}

impl<'de> Deserialize<'de> for Part {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(PartVisitor)
    }
}

struct PartVisitor;

impl<'de> Visitor<'de> for PartVisitor {
    type Value = Part;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("any JSON value")
    }

    fn visit_unit<E>(self) -> Result<Part, E> {
        Ok(Part::Null)
    }

    fn visit_bool<E>(self, value: bool) -> Result<Part, E> {
        Ok(Part::Bool(value))
    }

    fn visit_i64<E>(self, value: i64) -> Result<Part, E> {
        Ok(Part::Number(value as f64))
    }

    fn visit_u64<E>(self, value: u64) -> Result<Part, E> {
        Ok(Part::Number(value as f64))
    }

    fn visit_f64<E>(self, value: f64) -> Result<Part, E> {
        Ok(Part::Number(value))
    }

    fn visit_str<E>(self, value: &str) -> Result<Part, E> {
        Ok(Part::Text(value.to_owned()))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Part, A::Error> {
        let mut counts = Vec::new();
        while let Some(item) = items.next_element::<Part>()? {
            match item.count() {
                Some(count) => counts.push(count),
                None => {
                    let mut length = counts.len() + 1;
                    while items.next_element::<IgnoredAny>()?.is_some() {
                        length += 1;
                    }
                    return Ok(Part::OtherList(length, item.to_string()));
                }
            }
        }
        Ok(Part::Counts(counts))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut entries: A) -> Result<Part, A::Error> {
        let mut fields = Fields::default();
        while let Some(key) = entries.next_key::<Cow<'de, str>>()? {
            let field = match &*key {
                "segmentation" => &mut fields.segmentation,
                "score" => &mut fields.score,
                "size" => &mut fields.size,
                "counts" => &mut fields.counts,
                _ => {
                    entries.next_value::<IgnoredAny>()?;
                    continue;
                }
            };
            *field = Some(entries.next_value()?);
        }
        Ok(Part::Object(Box::new(fields)))
    }
}
