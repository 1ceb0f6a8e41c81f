//! Checkpoint files: network weights as published by their authors, or as converted by splatseg.
//!
//! | file | contents |
//! | --- | --- |
//! | Ultralytics `.pt` | a zip archive with a pickled module: `ema` if present, else `model`; 8.0.x and later |
//! | state dict `.pt` | a zip archive with a pickled dict of tensors, alone or as `model` (Meta's SAM 2.1) |
//! | `.safetensors` | tensors by name; files written by [`Checkpoint::convert`] have the configuration in their metadata |
//!
//! Opening reads only names and shapes; values are read on demand. No code from a file is executed: a pickle is parsed
//! into inert data (`pickle`), and only the parts that describe tensors are used. Of the existing readers,
//! `pytorch-reader` (Burn's) comes closest. But it drops the module's configuration, its batch norms' ε and the order
//! of tensors, rejects checkpoints of Ultralytics 8.0.x because they contain a loss, and lets a file of a few bytes
//! claim tensors of 10 GB.
//!
//! Files need not be trusted: sizes are checked before memory is allocated, and opening any file takes at most about
//! 100 MB and a second.

mod architecture;
mod configuration;
mod error;
mod foreign_code;
mod pickle;
mod safetensors_file;
mod state_dict;
mod storage;
mod stored_tensor;
mod tensor;
mod torch_archive;

pub use architecture::Architecture;
pub use error::{CheckpointError, printable};
pub use tensor::{Dtype, TensorInfo};

use error::Fault;
use serde_json::Value;
use splatseg_files::{open_file, read_file};
use std::collections::{HashMap, HashSet};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Maximum size of a configuration beside a checkpoint.
const MAX_CONFIGURATION_BYTES: u64 = 1 << 20;

/// A checkpoint, open for reading.
#[derive(Debug)]
pub struct Checkpoint {
    path: PathBuf,
    /// Length of the file in bytes.
    len: u64,
    /// Locked while a tensor is read, because the file position is shared.
    file: Mutex<File>,
    /// Offsets of the storages whose checksums have been verified.
    verified: Mutex<HashSet<u64>>,
    format: Format,
    contents: Contents,
    index: HashMap<String, usize>,
}

/// Contents of a file, except the tensors' values.
#[derive(Debug)]
struct Contents {
    tensors: Vec<TensorInfo>,
    configuration: Option<Value>,
    batch_norm_eps: Option<f64>,
    class: Option<String>,
    /// See [`Checkpoint::foreign_code`].
    foreign_code: Vec<String>,
}

/// File format of a checkpoint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// A zip archive written by `torch.save`.
    Torch,
    /// A `.safetensors` file.
    Safetensors,
}

impl Checkpoint {
    /// Opens a file. The format is recognised by the contents, not by the name.
    ///
    /// # Errors
    /// [`CheckpointError`] if the file cannot be read, has another format, is damaged, or describes tensors that do not
    /// fit in it.
    pub fn open(path: &Path) -> Result<Self, CheckpointError> {
        let io = |action| CheckpointError::io(path, action);
        let file = open_file(path).map_err(io("open"))?;
        let metadata = file.metadata().map_err(io("read"))?;
        let mut start = Vec::new();
        (&file).take(16).read_to_end(&mut start).map_err(io("read"))?;
        let len = metadata.len();
        let (format, contents) = if start.starts_with(b"PK\x03\x04") {
            (Format::Torch, torch_archive::open(&file, len))
        } else if safetensors_file::recognises(&start, len) {
            (Format::Safetensors, safetensors_file::open(&file, len))
        } else {
            return Err(CheckpointError::NotACheckpoint { path: path.to_owned(), found: describe_start(&start) });
        };
        let contents = contents.map_err(|fault| fault.at(path))?;
        let index = contents.tensors.iter().enumerate().map(|(index, tensor)| (tensor.name.clone(), index)).collect();
        let (file, verified) = (Mutex::new(file), Mutex::default());
        Ok(Self { path: path.to_owned(), len, file, verified, format, contents, index })
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Format of the file.
    pub fn format(&self) -> Format {
        self.format
    }

    /// All tensors, in file order, which is the state dict's order except in `.safetensors`.
    pub fn tensors(&self) -> impl Iterator<Item = &TensorInfo> {
        self.contents.tensors.iter()
    }

    /// Finds a tensor by its name in the state dict, e.g. `model.0.conv.weight`.
    pub fn info(&self, name: &str) -> Option<&TensorInfo> {
        self.index.get(name).map(|&index| &self.contents.tensors[index])
    }

    /// Recognises the network by the names and shapes of its tensors.
    pub fn architecture(&self) -> Architecture {
        Architecture::from_checkpoint(self)
    }

    /// The dict from which Ultralytics built the module (its attribute `yaml`: `nc`, `scale`, `backbone`, `head`, …),
    /// if the file contains a module or was converted from one. It is unvalidated file content.
    pub fn configuration(&self) -> Option<&Value> {
        self.contents.configuration.as_ref()
    }

    /// The first names of the tensors, for a message about a network that is not recognised.
    pub(crate) fn first_names(&self) -> String {
        let names: Vec<String> = self.tensors().take(2).map(|tensor| printable(tensor.name())).collect();
        if names.is_empty() { "no tensors".to_owned() } else { format!("with {}, …", names.join(", ")) }
    }

    /// The JSON configuration beside the file: `NAME.json` for `NAME.safetensors`, so that several checkpoints can lie in a
    /// folder, else the first of `names` that exists; with its path. It is unvalidated file content.
    ///
    /// # Errors
    /// [`CheckpointError::Part`] if it cannot be read, is larger than 1 MiB, or is not JSON.
    pub(crate) fn configuration_beside(&self, names: &[&str]) -> Result<Option<(PathBuf, Value)>, CheckpointError> {
        let folder = self.path.parent().unwrap_or(Path::new("."));
        let own = self.path.with_extension("json");
        let beside = std::iter::once(own).chain(names.iter().map(|name| folder.join(name)));
        let Some(path) = beside.into_iter().find(|path| path.is_file()) else { return Ok(None) };
        let wrong = |found: String| Fault::part("configuration", found, "JSON of at most 1 MiB").at(&path);
        let bytes = read_file(&path, MAX_CONFIGURATION_BYTES).map_err(|error| wrong(error.to_string()))?;
        let json = serde_json::from_slice(&bytes).map_err(|error| wrong(error.to_string()))?;
        Ok(Some((path, json)))
    }

    /// Number of bytes in which the file states its tensors, and that of the file. Tensors of PyTorch's files may share data, so
    /// that the first can be far larger.
    pub(crate) fn stated_and_stored_bytes(&self) -> (u128, u64) {
        let bytes = self.tensors().map(|tensor| (tensor.elements() * tensor.dtype.size()) as u128);
        (bytes.sum(), self.len)
    }

    /// The ε of the batch norms, if the file contains a module or was converted from one. Ultralytics' networks have
    /// 1e-3, not PyTorch's 1e-5.
    pub fn batch_norm_eps(&self) -> Option<f64> {
        self.contents.batch_norm_eps
    }

    /// Class of the pickled module, e.g. `SegmentationModel`, if the file contains a module or was converted from one.
    pub fn class(&self) -> Option<&str> {
        self.contents.class.as_deref()
    }

    /// Imports and calls that Python would execute when loading the file and that ordinary checkpoints do not contain,
    /// e.g. `call posix.system`. Nothing is executed here, but a file with such names should not be loaded elsewhere.
    pub fn foreign_code(&self) -> &[String] {
        &self.contents.foreign_code
    }

    /// Returns the names of the entries whose data do not match their checksums. Reads all data, at some GB per second.
    /// `.safetensors` files have no checksums.
    ///
    /// # Errors
    /// [`CheckpointError`] if the file cannot be read, or if its entries overlap.
    pub fn damaged_entries(&self) -> Result<Vec<String>, CheckpointError> {
        match self.format {
            Format::Torch => {
                torch_archive::damaged_entries(&self.file(), self.len).map_err(|fault| fault.at(&self.path))
            }
            Format::Safetensors => Ok(Vec::new()),
        }
    }

    /// Number of learned parameters: the elements of all tensors except batch-norm statistics and fixed random
    /// matrices, which a state dict distinguishes only by name. FastSAM's number includes the constant of the box
    /// distribution, as in Ultralytics.
    pub fn parameters(&self) -> usize {
        let buffers = ["running_mean", "running_var", "num_batches_tracked", "positional_encoding_gaussian_matrix"];
        let is_buffer = |name: &str| buffers.contains(&name.rsplit('.').next().unwrap_or_default());
        self.tensors().filter(|tensor| !is_buffer(tensor.name())).map(TensorInfo::elements).sum()
    }

    /// Writes the checkpoint to a `.safetensors` file whose metadata (`splatseg`, JSON) contain the configuration and
    /// the batch norms' ε. Types and names are unchanged. The file is first written under another name in the same
    /// folder.
    ///
    /// # Errors
    /// [`CheckpointError`] if `out` exists (it is left unchanged), a tensor cannot be read, the tensors share so much
    /// data that they would take more than twice the size of the file, or the new file cannot be written.
    pub fn convert(&self, out: &Path) -> Result<(), CheckpointError> {
        if out.exists() {
            return Err(CheckpointError::Exists { path: out.to_owned() });
        }
        // Tensors may share data, which a converted file repeats: a small file could produce a huge one.
        let (bytes, len) = self.stated_and_stored_bytes();
        let limit = 2 * u128::from(len);
        if bytes > limit {
            let found = format!("{bytes} bytes that share data");
            return Err(Fault::part("the tensors", found, format!("at most {limit}, twice the file")).at(&self.path));
        }
        safetensors_file::write(self, out)
    }

    /// Reads a tensor of any floating-point type as `f32`, in row-major order.
    ///
    /// # Errors
    /// [`CheckpointError`] if there is no such tensor, it has another shape or type, or its values cannot be read.
    pub fn read_f32(&self, name: &str, expected_shape: &[usize]) -> Result<Vec<f32>, CheckpointError> {
        let fault = |found: String, expected: String| Fault::tensor(name, found, expected).at(&self.path);
        let tensor = self.info(name);
        let tensor = tensor.ok_or_else(|| fault("no such tensor".to_owned(), format!("shape {expected_shape:?}")))?;
        if tensor.shape != expected_shape {
            return Err(fault(format!("shape {:?}", tensor.shape), format!("{expected_shape:?}")));
        }
        if !tensor.dtype.is_float() {
            return Err(fault(tensor.dtype.to_string(), "floating-point numbers".to_owned()));
        }
        let bytes = self.read_bytes(tensor)?;
        tensor.dtype.to_f32(&bytes).ok_or_else(|| fault(tensor.dtype.to_string(), "floating-point numbers".to_owned()))
    }

    /// Reads a tensor's elements in their file type, little-endian, in row-major order.
    fn read_bytes(&self, tensor: &TensorInfo) -> Result<Vec<u8>, CheckpointError> {
        let size = tensor.dtype.size() as u64;
        let start = tensor.layout.offset as u64 * size;
        let end = start + tensor.layout.span as u64 * size;
        let fault = |error: std::io::Error| Fault::tensor(&tensor.name, error.to_string(), "its data").at(&self.path);
        // The checksum covers the whole storage, so before a part is used the whole is read once.
        if end - start < tensor.storage.len {
            let mut verified = self.verified.lock().unwrap_or_else(PoisonError::into_inner);
            if !verified.contains(&tensor.storage.offset) {
                tensor.storage.verify(&self.file()).map_err(fault)?;
                verified.insert(tensor.storage.offset);
            }
        }
        let span = tensor.storage.read(&self.file(), start..end).map_err(fault)?;
        Ok(tensor.gather(span))
    }

    /// Locks the file. A poisoned lock is harmless: every reader seeks first.
    fn file(&self) -> MutexGuard<'_, File> {
        self.file.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Describes a file that is not a checkpoint by its first bytes.
fn describe_start(start: &[u8]) -> String {
    match start {
        [] => "an empty file".to_owned(),
        [b'p', b'l', b'y', b'\n', ..] => "a PLY file".to_owned(),
        // Pickles of protocol 2 and later.
        [0x80, 2..=5, ..] => {
            "a bare pickle (from PyTorch before 1.6; load and save it again with a later version)".to_owned()
        }
        _ => format!("a file that begins with {:?}", printable(&String::from_utf8_lossy(start))),
    }
}
