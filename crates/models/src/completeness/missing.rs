//! A tensor that is missing.

use std::fmt;

/// A tensor that a network needs but that is missing from a checkpoint or has the wrong shape there.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Missing {
    /// The tensor's name.
    pub name: String,
    /// The shape it should have.
    pub expected: Vec<usize>,
    /// The shape it has; `None` if it is missing.
    pub found: Option<Vec<usize>>,
}

impl fmt::Display for Missing {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.found {
            Some(found) => write!(formatter, "{}: shape {found:?}, expected {:?}", self.name, self.expected),
            None => write!(formatter, "{}: missing, expected shape {:?}", self.name, self.expected),
        }
    }
}
