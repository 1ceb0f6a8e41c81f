//! `.safetensors` files, and the metadata that [`Checkpoint::convert`](super::Checkpoint::convert) adds to them.

use super::Checkpoint;
use super::Contents;
use super::error::{CheckpointError, Fault};
use super::storage::Storage;
use super::tensor::{Dtype, Layout, MAX_AXES, TensorInfo};
use safetensors::tensor::{Dtype as FileDtype, Metadata, TensorInfo as FileTensorInfo};
use serde::{Deserialize, Serialize};
use serde_json::Value as Json;
use splatseg_files::AtomicFile;
use std::collections::HashMap;
use std::fs::File;
use std::io::Write as _;
use std::path::Path;

/// Size of the header's length field, before the header.
const LENGTH_BYTES: u64 = 8;
/// Maximum length of the header; the largest checkpoints have about 100 KB. Parsing uses up to 20 times as much memory.
const MAX_HEADER_BYTES: u64 = 2 << 20;
/// Key in the file's `__metadata__` for [`Converted`], as JSON. A single key, because several would be written in
/// random order.
const METADATA_KEY: &str = "splatseg";

/// Metadata of a converted file.
#[derive(Debug, Serialize, Deserialize)]
struct Converted {
    /// Human-readable name of the network.
    architecture: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    class: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    batch_norm_eps: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    configuration: Option<Json>,
}

/// True if a file of `file_len` bytes with these first nine bytes can be a safetensors file.
pub(super) fn recognises(start: &[u8], file_len: u64) -> bool {
    let Some((&len, rest)) = start.split_first_chunk() else { return false };
    rest.first() == Some(&b'{') && u64::from_le_bytes(len) <= file_len.saturating_sub(LENGTH_BYTES)
}

/// Reads everything except the tensors' values.
pub(super) fn open(file: &File, file_len: u64) -> Result<Contents, Fault> {
    let fault = |found: String, expected: String| Fault::part("the header", found, expected);
    let read = |offset, len| {
        let part = Storage { offset, len, crc32: None };
        part.read(file, 0..len).map_err(|error| fault(error.to_string(), "a safetensors header".to_owned()))
    };
    let mut len = [0; LENGTH_BYTES as usize];
    len.copy_from_slice(&read(0, LENGTH_BYTES)?);
    let len = u64::from_le_bytes(len);
    let limit = MAX_HEADER_BYTES.min(file_len - LENGTH_BYTES);
    if len > limit {
        return Err(fault(format!("{len} bytes"), format!("at most {limit}")));
    }
    let header = read(LENGTH_BYTES, len)?;
    // Parsing checks that the tensors fill the data without gaps, and that each length matches the shape.
    let metadata: Metadata = serde_json::from_slice(&header)
        .map_err(|error| fault(error.to_string(), "the JSON object of a safetensors file".to_owned()))?;
    let (begin, data_len) = (LENGTH_BYTES + len, metadata.data_len() as u64);
    if begin + data_len != file_len {
        let expected = format!("{} after a header of {begin}", file_len - begin);
        return Err(Fault::part("the data", format!("{data_len} bytes in the header"), expected));
    }
    let names = metadata.offset_keys();
    let tensors: Result<Vec<_>, _> = names
        .into_iter()
        .filter_map(|name| Some((metadata.info(&name)?, name)))
        .map(|(info, name)| tensor_info(name, info, begin))
        .collect();
    let converted = metadata.metadata().as_ref().and_then(|metadata| metadata.get(METADATA_KEY));
    let converted: Option<Converted> =
        converted.map(|json| serde_json::from_str(json)).transpose().map_err(|error| {
            Fault::part(
                format!("{METADATA_KEY} in the header"),
                error.to_string(),
                "metadata written by splatseg inspect --convert",
            )
        })?;
    let (configuration, batch_norm_eps, class) = match converted {
        Some(converted) => (converted.configuration, converted.batch_norm_eps, converted.class),
        None => (None, None, None),
    };
    Ok(Contents { tensors: tensors?, configuration, batch_norm_eps, class, foreign_code: Vec::new() })
}

fn tensor_info(name: String, info: &FileTensorInfo, begin: u64) -> Result<TensorInfo, Fault> {
    let dtype = match info.dtype {
        FileDtype::F64 => Dtype::F64,
        FileDtype::F32 => Dtype::F32,
        FileDtype::F16 => Dtype::F16,
        FileDtype::BF16 => Dtype::Bf16,
        FileDtype::I64 => Dtype::I64,
        FileDtype::I32 => Dtype::I32,
        FileDtype::I16 => Dtype::I16,
        FileDtype::I8 => Dtype::I8,
        FileDtype::U8 => Dtype::U8,
        FileDtype::BOOL => Dtype::Bool,
        other => return Err(Fault::tensor(&name, format!("elements of {other:?}"), "real numbers of 8 to 64 bits")),
    };
    if info.shape.len() > MAX_AXES {
        return Err(Fault::tensor(&name, format!("{} axes", info.shape.len()), format!("at most {MAX_AXES}")));
    }
    let (start, end) = info.data_offsets;
    let storage = Storage { offset: begin + start as u64, len: (end - start) as u64, crc32: None };
    let layout = Layout { offset: 0, strides: None, span: (end - start) / dtype.size() };
    Ok(TensorInfo { name, dtype, shape: info.shape.clone(), layout, storage })
}

/// Writes a converted file: see [`Checkpoint::convert`].
pub(super) fn write(checkpoint: &Checkpoint, out: &Path) -> Result<(), CheckpointError> {
    // Widest elements first, as in other safetensors files, so that all tensors are aligned.
    let mut tensors: Vec<&TensorInfo> = checkpoint.tensors().collect();
    tensors.sort_by_key(|tensor| std::cmp::Reverse(tensor.dtype.size()));
    let header = header(checkpoint, &tensors).map_err(|error| {
        Fault::part("the header to be written", error, "tensors of a checkpoint").at(checkpoint.path())
    })?;
    let io_error = |error| CheckpointError::io(out, "write")(error);
    let mut file = AtomicFile::create(out).map_err(io_error)?;
    file.write_all(&(header.len() as u64).to_le_bytes()).map_err(io_error)?;
    file.write_all(&header).map_err(io_error)?;
    for tensor in tensors {
        file.write_all(&checkpoint.read_bytes(tensor)?).map_err(io_error)?;
    }
    file.commit_new().map_err(|error| match error.kind() {
        std::io::ErrorKind::AlreadyExists => CheckpointError::Exists { path: out.to_owned() },
        _ => io_error(error),
    })
}

/// The header of a converted file, padded so that the tensors are aligned.
fn header(checkpoint: &Checkpoint, tensors: &[&TensorInfo]) -> Result<Vec<u8>, String> {
    let converted = Converted {
        architecture: checkpoint.architecture().to_string(),
        class: checkpoint.class().map(str::to_owned),
        batch_norm_eps: checkpoint.batch_norm_eps(),
        configuration: checkpoint.configuration().cloned(),
    };
    let converted = serde_json::to_string(&converted).map_err(|error| error.to_string())?;
    let mut end = 0;
    let tensors = tensors.iter().map(|tensor| {
        let start = end;
        end += tensor.elements() * tensor.dtype.size();
        let (dtype, shape) = (file_dtype(tensor.dtype), tensor.shape.clone());
        (tensor.name.clone(), FileTensorInfo { dtype, shape, data_offsets: (start, end) })
    });
    let metadata = HashMap::from([(METADATA_KEY.to_owned(), converted)]);
    let metadata = Metadata::new(Some(metadata), tensors.collect()).map_err(|error| error.to_string())?;
    let mut header = serde_json::to_vec(&metadata).map_err(|error| error.to_string())?;
    header.resize(header.len().next_multiple_of(8), b' ');
    Ok(header)
}

fn file_dtype(dtype: Dtype) -> FileDtype {
    match dtype {
        Dtype::F64 => FileDtype::F64,
        Dtype::F32 => FileDtype::F32,
        Dtype::F16 => FileDtype::F16,
        Dtype::Bf16 => FileDtype::BF16,
        Dtype::I64 => FileDtype::I64,
        Dtype::I32 => FileDtype::I32,
        Dtype::I16 => FileDtype::I16,
        Dtype::I8 => FileDtype::I8,
        Dtype::U8 => FileDtype::U8,
        Dtype::Bool => FileDtype::BOOL,
    }
}
