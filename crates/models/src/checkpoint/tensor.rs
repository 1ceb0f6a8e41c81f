//! Tensors of a checkpoint: type, shape and memory layout.

use super::error::Fault;
use super::storage::Storage;
use half::slice::HalfFloatSliceExt;
use half::{bf16, f16};
use std::fmt;

/// Maximum number of axes; more than any tensor of a checkpoint has.
pub(super) const MAX_AXES: usize = 16;

/// Type of a tensor's elements; little-endian in the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Dtype {
    /// 64-bit float.
    F64,
    /// 32-bit float.
    F32,
    /// 16-bit IEEE float.
    F16,
    /// 16-bit bfloat.
    Bf16,
    /// 64-bit signed integer.
    I64,
    /// 32-bit signed integer.
    I32,
    /// 16-bit signed integer.
    I16,
    /// 8-bit signed integer.
    I8,
    /// 8-bit unsigned integer.
    U8,
    /// Boolean in one byte.
    Bool,
}

impl Dtype {
    /// Bytes of one element.
    pub fn size(self) -> usize {
        match self {
            Self::F64 | Self::I64 => 8,
            Self::F32 | Self::I32 => 4,
            Self::F16 | Self::Bf16 | Self::I16 => 2,
            Self::I8 | Self::U8 | Self::Bool => 1,
        }
    }

    /// True if the elements are floating-point numbers.
    pub fn is_float(self) -> bool {
        matches!(self, Self::F64 | Self::F32 | Self::F16 | Self::Bf16)
    }

    /// Converts elements to `f32`; `None` if they are not floating-point numbers.
    pub(super) fn to_f32(self, bytes: &[u8]) -> Option<Vec<f32>> {
        match self {
            Self::F32 => Some(bytes.as_chunks().0.iter().map(|element| f32::from_le_bytes(*element)).collect()),
            Self::F64 => Some(bytes.as_chunks().0.iter().map(|element| f64::from_le_bytes(*element) as f32).collect()),
            Self::F16 => Some(halves(bytes, f16::from_le_bytes, |block, out| block.convert_to_f32_slice(out))),
            Self::Bf16 => Some(halves(bytes, bf16::from_le_bytes, |block, out| block.convert_to_f32_slice(out))),
            Self::I64 | Self::I32 | Self::I16 | Self::I8 | Self::U8 | Self::Bool => None,
        }
    }
}

/// Converts in blocks: `half` uses the processor's conversion instructions only for slices.
fn halves<T>(bytes: &[u8], read: fn([u8; 2]) -> T, convert: fn(&[T], &mut [f32])) -> Vec<f32> {
    let elements = bytes.as_chunks().0;
    let mut floats = vec![0.0; elements.len()];
    let mut block = Vec::with_capacity(4096);
    for (elements, floats) in elements.chunks(4096).zip(floats.chunks_mut(4096)) {
        block.clear();
        block.extend(elements.iter().map(|element| read(*element)));
        convert(&block, floats);
    }
    floats
}

impl fmt::Display for Dtype {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::F64 => "float64",
            Self::F32 => "float32",
            Self::F16 => "float16",
            Self::Bf16 => "bfloat16",
            Self::I64 => "int64",
            Self::I32 => "int32",
            Self::I16 => "int16",
            Self::I8 => "int8",
            Self::U8 => "uint8",
            Self::Bool => "bool",
        })
    }
}

/// A tensor of a checkpoint, without its values.
#[derive(Clone, Debug)]
pub struct TensorInfo {
    pub(super) name: String,
    pub(super) dtype: Dtype,
    pub(super) shape: Vec<usize>,
    pub(super) layout: Layout,
    pub(super) storage: Storage,
}

/// Layout of a tensor's elements in its storage.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Layout {
    /// Index of the first element.
    pub offset: usize,
    /// Stride of each axis, in elements; `None` for contiguous row-major order.
    pub strides: Option<Vec<usize>>,
    /// Number of elements from the first to the last, inclusive.
    pub span: usize,
}

impl TensorInfo {
    /// Name in the state dict, e.g. `model.0.conv.weight`.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Type of the elements.
    pub fn dtype(&self) -> Dtype {
        self.dtype
    }

    /// Length of each axis; empty for a scalar.
    pub fn shape(&self) -> &[usize] {
        &self.shape
    }

    /// Number of elements. It does not overflow, and the file contains that many.
    pub fn elements(&self) -> usize {
        self.shape.iter().product()
    }

    /// Creates a tensor from a file's description, if the description is consistent.
    pub(super) fn checked(
        name: String,
        dtype: Dtype,
        shape: Vec<usize>,
        offset: usize,
        strides: &[usize],
        storage: Storage,
    ) -> Result<Self, Fault> {
        let fault = |found: String, expected: String| Fault::tensor(&name, found, expected);
        if shape.len() > MAX_AXES || strides.len() != shape.len() {
            let found = format!("{} axes with {} strides", shape.len(), strides.len());
            return Err(fault(found, format!("as many strides as axes, at most {MAX_AXES}")));
        }
        let available = storage.len / dtype.size() as u64;
        let expected = || format!("all of it within the {available} elements of its storage");
        let claim = || format!("shape {shape:?}, strides {strides:?}, offset {offset}");
        let elements = shape.iter().try_fold(1usize, |product, &length| product.checked_mul(length));
        // `span` is the index of the last element, plus one.
        let last = shape.iter().zip(strides).try_fold(0usize, |sum, (&length, &stride)| {
            length.saturating_sub(1).checked_mul(stride).and_then(|step| sum.checked_add(step))
        });
        let (Some(elements), Some(span)) = (elements, last.and_then(|last| last.checked_add(1))) else {
            return Err(fault(claim(), expected()));
        };
        let span = if elements == 0 { 0 } else { span };
        let end = offset.checked_add(span).map(|end| end as u64);
        // A tensor that repeats elements (a stride of 0) can claim any size.
        if end.is_none_or(|end| end > available) || elements as u64 > available {
            return Err(fault(claim(), expected()));
        }
        let strides = (!is_row_major(&shape, strides)).then(|| strides.to_vec());
        let layout = Layout { offset, strides, span };
        Ok(Self { name, dtype, shape, layout, storage })
    }

    /// Copies the elements in `span` (the bytes from the first to the last element) in row-major order.
    pub(super) fn gather(&self, span: Vec<u8>) -> Vec<u8> {
        let Some(strides) = &self.layout.strides else { return span };
        let size = self.dtype.size();
        let mut bytes = Vec::with_capacity(self.elements() * size);
        let mut index = vec![0; self.shape.len()];
        let mut place = 0;
        for _ in 0..self.elements() {
            bytes.extend_from_slice(&span[place * size..][..size]);
            // The last axis advances fastest; at its end, an axis restarts and advances the axis before it.
            for axis in (0..index.len()).rev() {
                index[axis] += 1;
                place += strides[axis];
                if index[axis] < self.shape[axis] {
                    break;
                }
                place -= strides[axis] * index[axis];
                index[axis] = 0;
            }
        }
        bytes
    }
}

/// True if the elements are contiguous in row-major order. Strides of axes of length 1 are ignored.
fn is_row_major(shape: &[usize], strides: &[usize]) -> bool {
    let mut expected = 1;
    shape.iter().zip(strides).rev().all(|(&length, &stride)| {
        let fits = length <= 1 || stride == expected;
        // Lengths that would overflow belong to a tensor without elements.
        expected = expected.saturating_mul(length.max(1));
        fits
    })
}
