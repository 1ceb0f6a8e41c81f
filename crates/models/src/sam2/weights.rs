//! Access to the network's weights, and the reader with which blocks load them.

use super::Sam2Error;
use crate::checkpoint::{Checkpoint, CheckpointError};
use crate::transfer::upload;
use burn::tensor::{Device, Tensor};
use std::cell::RefCell;
use std::collections::BTreeSet;

/// A set of named float32 tensors: a checkpoint, or another source of names, shapes and values.
pub trait Weights {
    /// All names.
    fn names(&self) -> Vec<String>;

    /// Shape of a tensor, outermost dimension first; `None` if there is no such tensor.
    fn shape(&self, name: &str) -> Option<Vec<usize>>;

    /// Reads the elements of a tensor, row-major.
    ///
    /// # Errors
    /// If there is no such tensor, it is not float32 of that `shape`, or it cannot be read.
    fn read(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, Sam2Error>;
}

/// A view of [`Weights`] below a prefix. It checks shapes, creates tensors and records the names read.
pub(super) struct WeightReader<'a> {
    source: &'a dyn Weights,
    read: &'a RefCell<BTreeSet<String>>,
    device: &'a Device,
    prefix: String,
}

impl<'a> WeightReader<'a> {
    /// Creates a reader of all tensors in `source`. The names it reads are added to `read`.
    pub fn new(source: &'a dyn Weights, read: &'a RefCell<BTreeSet<String>>, device: &'a Device) -> Self {
        Self { source, read, device, prefix: String::new() }
    }

    /// Creates a reader of the tensors whose names start with `self.prefix + name + "."`.
    pub fn child(&self, name: impl std::fmt::Display) -> Self {
        Self { prefix: format!("{}{name}.", self.prefix), ..*self }
    }

    /// The device on which tensors are created.
    pub fn device(&self) -> &Device {
        self.device
    }

    /// Length of a tensor's first axis.
    pub fn first_axis(&self, name: &str) -> Result<usize, Sam2Error> {
        first_axis(self.source, &format!("{}{name}", self.prefix))
    }

    /// Counts a tensor as read that the network does not need.
    pub fn ignore(&self, name: &str) {
        self.read.borrow_mut().insert(format!("{}{name}", self.prefix));
    }

    /// Reads the elements of a tensor, row-major.
    pub fn floats(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, Sam2Error> {
        let name = format!("{}{name}", self.prefix);
        let refusal = |error| match self.source.shape(&name) {
            None => Sam2Error::MissingTensor { name: name.clone() },
            Some(found) if found != shape => {
                Sam2Error::TensorShape { name: name.clone(), found, expected: shape.to_vec() }
            }
            Some(_) => error,
        };
        let values = self.source.read(&name, shape).map_err(refusal)?;
        self.read.borrow_mut().insert(name);
        Ok(values)
    }

    /// Reads a tensor as stored.
    pub fn tensor<const D: usize>(&self, name: &str, shape: [usize; D]) -> Result<Tensor<D>, Sam2Error> {
        let values = self.floats(name, &shape)?;
        Ok(upload(values, shape, self.device))
    }
}

/// Length of the first axis of a tensor.
pub(super) fn first_axis(weights: &dyn Weights, name: &str) -> Result<usize, Sam2Error> {
    let shape = weights.shape(name).ok_or_else(|| Sam2Error::MissingTensor { name: name.into() })?;
    Ok(shape.first().copied().unwrap_or(0))
}

/// Number of consecutive indices from 0 for which there is a tensor.
pub(super) fn count(name: impl Fn(usize) -> String, weights: &dyn Weights) -> usize {
    (0..).take_while(|index| weights.shape(&name(*index)).is_some()).count()
}

/// A checkpoint: Meta's `.pt` files, or their conversion to `.safetensors`.
impl Weights for Checkpoint {
    fn names(&self) -> Vec<String> {
        self.tensors().map(|tensor| tensor.name().to_owned()).collect()
    }

    fn shape(&self, name: &str) -> Option<Vec<usize>> {
        self.info(name).map(|tensor| tensor.shape().to_vec())
    }

    fn read(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, Sam2Error> {
        let reason =
            |error: CheckpointError| Sam2Error::UnreadableTensor { name: name.into(), reason: error.to_string() };
        self.read_f32(name, shape).map_err(reason)
    }
}
