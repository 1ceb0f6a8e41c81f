//! Tensor descriptions in a pickle.
//!
//! PyTorch writes a tensor as the call `torch._utils._rebuild_tensor_v2(storage, offset, shape, strides, …)`, and a
//! parameter as `_rebuild_parameter(tensor, …)`. The storage is a persistent id, `('storage', torch.HalfStorage, key,
//! location, elements)`, whose bytes are another entry of the archive. Source: PyTorch's `torch/_utils.py` and
//! `torch/serialization.py`.

use super::error::Fault;
use super::pickle::{Graph, Id, Value};
use super::tensor::{Dtype, MAX_AXES};

/// A tensor as described by the pickle, not yet checked.
#[derive(Debug)]
pub(super) struct StoredTensor<'a> {
    pub name: String,
    pub dtype: Dtype,
    pub shape: Vec<usize>,
    /// In elements.
    pub strides: Vec<usize>,
    /// First element in the storage.
    pub offset: usize,
    /// Name of the storage.
    pub key: &'a str,
    /// Number of elements in the storage.
    pub storage_elements: usize,
}

/// Reads the call that creates a tensor or a parameter.
pub(super) fn read<'a>(graph: &Graph<'a>, name: String, value: Id) -> Result<StoredTensor<'a>, Fault> {
    let fault = |found: String, expected: &str| Fault::tensor(&name, found, expected);
    let (mut function, mut arguments) = call(graph, value).ok_or_else(|| fault(graph.describe(value), "a tensor"))?;
    if matches!(function, "_rebuild_parameter" | "_rebuild_parameter_with_state") {
        let inner = arguments.first().and_then(|&tensor| call(graph, tensor));
        (function, arguments) = inner.ok_or_else(|| fault("a parameter without a tensor".to_owned(), "a tensor"))?;
    }
    if !matches!(function, "_rebuild_tensor" | "_rebuild_tensor_v2") {
        return Err(fault(format!("a tensor made by {function}"), "a dense tensor"));
    }
    let &[storage, offset, shape, strides, ..] = arguments else {
        return Err(fault(format!("{} arguments to {function}", arguments.len()), "storage, offset, shape, strides"));
    };
    let (dtype, key, storage_elements) =
        read_storage(graph, storage).map_err(|(found, expected)| fault(found, expected))?;
    let offset = graph.size(offset).ok_or_else(|| fault(graph.describe(offset), "an offset"))?;
    let shape = sizes(graph, shape).ok_or_else(|| fault(graph.describe(shape), "a shape"))?;
    let strides = sizes(graph, strides).ok_or_else(|| fault(graph.describe(strides), "strides"))?;
    Ok(StoredTensor { name, dtype, shape, strides, offset, key, storage_elements })
}

/// Name and arguments of a call to a function of `torch._utils`.
fn call<'g, 'a>(graph: &'g Graph<'a>, value: Id) -> Option<(&'a str, &'g [Id])> {
    let object = graph.object(value)?;
    match graph.callable(object)? {
        ("torch._utils", function) => Some((function, graph.tuple(object.arguments)?)),
        _ => None,
    }
}

/// Type, key and number of elements of a storage, or an error as (found, expected).
fn read_storage<'a>(graph: &Graph<'a>, storage: Id) -> Result<(Dtype, &'a str, usize), (String, &'static str)> {
    let Value::Persistent(reference) = graph.value(storage) else {
        return Err((graph.describe(storage), "a storage"));
    };
    let Some(&[kind, class, key, _location, elements, ..]) = graph.tuple(*reference) else {
        return Err((graph.describe(*reference), "the description of a storage"));
    };
    let (Some("storage"), Some(key), Some(elements)) = (graph.text(kind), graph.text(key), graph.size(elements)) else {
        return Err(("a storage without key or size".to_owned(), "a key and a size"));
    };
    let Value::Global { module: "torch", name } = graph.value(class) else {
        return Err((graph.describe(class), "a storage class of torch"));
    };
    let dtype = match *name {
        "DoubleStorage" => Dtype::F64,
        "FloatStorage" => Dtype::F32,
        "HalfStorage" => Dtype::F16,
        "BFloat16Storage" => Dtype::Bf16,
        "LongStorage" => Dtype::I64,
        "IntStorage" => Dtype::I32,
        "ShortStorage" => Dtype::I16,
        "CharStorage" => Dtype::I8,
        "ByteStorage" => Dtype::U8,
        "BoolStorage" => Dtype::Bool,
        other => return Err((format!("elements of torch.{other}"), "real numbers of 8 to 64 bits")),
    };
    Ok((dtype, key, elements))
}

/// Reads a tuple of sizes, or a `torch.Size` of such a tuple.
fn sizes(graph: &Graph<'_>, value: Id) -> Option<Vec<usize>> {
    let value = match graph.object(value) {
        Some(object) if graph.callable(object) == Some(("torch", "Size")) => *graph.tuple(object.arguments)?.first()?,
        _ => value,
    };
    let items = graph.tuple(value)?;
    // Checked before the shape is copied: a pickle may refer to the same tuple many times.
    if items.len() > MAX_AXES {
        return None;
    }
    items.iter().map(|&item| graph.size(item)).collect()
}
