//! What a checkpoint lacks for a model.

use super::Checkpoint;
use std::fmt;

/// A tensor that a model needs and a checkpoint does not hold as it should.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Missing {
    /// The tensor's name.
    pub name: String,
    /// The shape it should have.
    pub expected: Vec<usize>,
    /// The shape it has; `None` if it is not there.
    pub found: Option<Vec<usize>>,
}

impl Checkpoint {
    /// The tensors of a model, names and shapes, that are missing here or have another shape; in the model's order.
    pub fn missing(&self, expected: &[(String, Vec<usize>)]) -> Vec<Missing> {
        let found = |name: &str| self.info(name).map(|tensor| tensor.shape().to_vec());
        let missing = |(name, shape): &(String, Vec<usize>)| {
            let found = found(name);
            (found.as_ref() != Some(shape)).then(|| Missing { name: name.clone(), expected: shape.clone(), found })
        };
        expected.iter().filter_map(missing).collect()
    }
}

impl fmt::Display for Missing {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.found {
            Some(found) => write!(formatter, "{}: shape {found:?}, expected {:?}", self.name, self.expected),
            None => write!(formatter, "{}: missing, expected shape {:?}", self.name, self.expected),
        }
    }
}
