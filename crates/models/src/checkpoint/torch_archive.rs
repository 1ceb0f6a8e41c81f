//! The zip archive written by `torch.save` since PyTorch 1.6: `<root>/data.pkl`, and one storage per
//! `<root>/data/<key>`.

use super::Contents;
use super::error::{Fault, printable};
use super::foreign_code::foreign_code;
use super::pickle;
use super::state_dict::{self, StateDict};
use super::storage::Storage;
use super::stored_tensor::StoredTensor;
use super::tensor::TensorInfo;
use std::collections::HashMap;
use std::fs::File;
use std::io::BufReader;
use zip::ZipArchive;

/// Maximum length of a pickle; the largest checkpoints have a few hundred kilobytes.
const MAX_PICKLE_BYTES: u64 = 8 << 20;
/// Maximum length of the byte order's name.
const MAX_BYTE_ORDER_BYTES: u64 = 16;

/// Reads everything except the tensors' values.
pub(super) fn open(file: &File, file_len: u64) -> Result<Contents, Fault> {
    let mut archive = Archive::open(file, file_len)?;
    let root = archive.root()?;
    if let Some(order) = archive.storage(&format!("{root}byteorder"))? {
        let order = read_entry(file, &format!("{root}byteorder"), order, MAX_BYTE_ORDER_BYTES)?;
        if order != b"little" {
            return Err(Fault::part("byteorder", String::from_utf8_lossy(&order), "little"));
        }
    }
    let name = format!("{root}data.pkl");
    let storage = archive.storage(&name)?.ok_or_else(|| Fault::part(&name, "no such entry", "a pickle"))?;
    let bytes = read_entry(file, &name, storage, MAX_PICKLE_BYTES)?;
    let graph = pickle::parse(&bytes)
        .map_err(|error| Fault::part(format!("{name}, byte {}", error.offset), error.found, error.expected))?;
    let mut contents = archive.contents(&root, state_dict::read(&graph)?)?;
    contents.foreign_code = foreign_code(&graph);
    Ok(contents)
}

/// Returns the names of the entries whose data do not match their checksums.
pub(super) fn damaged_entries(file: &File, file_len: u64) -> Result<Vec<String>, Fault> {
    let mut archive = Archive::open(file, file_len)?;
    let names: Vec<String> = archive.archive.file_names().filter_map(Result::ok).map(|name| name.to_string()).collect();
    let (mut damaged, mut bytes) = (Vec::new(), 0);
    for name in names {
        // Compressed or malformed entries are never read.
        let Ok(Some(storage)) = archive.storage(&name) else { continue };
        bytes += storage.len;
        archive.require_no_overlap(bytes)?;
        if !storage.is_intact(file).map_err(|error| Fault::part(&name, error.to_string(), "its data"))? {
            damaged.push(printable(&name));
        }
    }
    Ok(damaged)
}

struct Archive<'f> {
    archive: ZipArchive<BufReader<&'f File>>,
    file_len: u64,
}

impl<'f> Archive<'f> {
    fn open(file: &'f File, file_len: u64) -> Result<Self, Fault> {
        let archive = ZipArchive::new(BufReader::new(file))
            .map_err(|error| Fault::part("the zip archive", error.to_string(), "an intact archive"))?;
        Ok(Self { archive, file_len })
    }

    /// Root folder of the archive, with a trailing slash. It is named after the file that was saved.
    fn root(&self) -> Result<String, Fault> {
        let mut roots = self.archive.file_names().filter_map(Result::ok).filter_map(|name| {
            name.strip_suffix("data.pkl").filter(|root| root.is_empty() || root.ends_with('/')).map(str::to_owned)
        });
        let expected = "one entry data.pkl, as torch.save writes";
        let root = roots.next().ok_or_else(|| Fault::part("the zip archive", "none", expected))?;
        match roots.next() {
            Some(_) => Err(Fault::part("the zip archive", "several", expected)),
            None => Ok(root),
        }
    }

    /// Returns the byte range of an entry, if it exists. `torch.save` does not compress, so entries can be read lazily
    /// and zip bombs are impossible.
    fn storage(&mut self, name: &str) -> Result<Option<Storage>, Fault> {
        let Some(index) = self.archive.index_for_name(name) else { return Ok(None) };
        let entry = self
            .archive
            .by_index_raw(index)
            .map_err(|error| Fault::part(name, error.to_string(), "an intact entry"))?;
        if entry.encrypted() || entry.compression() != zip::CompressionMethod::Stored {
            return Err(Fault::part(name, "compressed data", "uncompressed data, as torch.save writes"));
        }
        let (offset, len) = (entry.data_start().unwrap_or(u64::MAX), entry.size());
        if len != entry.compressed_size() || offset.checked_add(len).is_none_or(|end| end > self.file_len) {
            let found = format!("{len} bytes at byte {offset}");
            return Err(Fault::part(name, found, format!("an entry within the file's {} bytes", self.file_len)));
        }
        Ok(Some(Storage { offset, len, crc32: Some(entry.crc32()) }))
    }

    /// Checks that entries of `bytes` bytes in total fit in the file without overlap; otherwise a small file could keep
    /// a reader busy for hours.
    fn require_no_overlap(&self, bytes: u64) -> Result<(), Fault> {
        if bytes <= self.file_len {
            return Ok(());
        }
        let expected = format!("at most the file's {} bytes", self.file_len);
        Err(Fault::part("the zip archive", format!("entries of {bytes} bytes"), expected))
    }

    fn contents(&mut self, root: &str, found: StateDict<'_>) -> Result<Contents, Fault> {
        let (mut storages, mut bytes) = (HashMap::new(), 0);
        let mut tensors = Vec::with_capacity(found.tensors.len());
        for tensor in found.tensors {
            let storage = match storages.get(tensor.key) {
                Some(storage) => *storage,
                None => {
                    let entry = format!("{root}data/{}", tensor.key);
                    let storage = self.storage(&entry)?;
                    let storage =
                        storage.ok_or_else(|| Fault::tensor(&tensor.name, format!("no entry {entry}"), "its data"))?;
                    storages.insert(tensor.key, storage);
                    bytes += storage.len;
                    self.require_no_overlap(bytes)?;
                    storage
                }
            };
            tensors.push(tensor_info(tensor, storage)?);
        }
        let (configuration, batch_norm_eps) = (found.configuration, found.batch_norm_eps);
        Ok(Contents { tensors, configuration, batch_norm_eps, class: found.class, foreign_code: Vec::new() })
    }
}

fn tensor_info(tensor: StoredTensor<'_>, storage: Storage) -> Result<TensorInfo, Fault> {
    let bytes = (tensor.storage_elements as u64).checked_mul(tensor.dtype.size() as u64);
    if bytes != Some(storage.len) {
        let found = format!("{} elements of {} in {} bytes", tensor.storage_elements, tensor.dtype, storage.len);
        return Err(Fault::tensor(&tensor.name, found, "a storage as large as its elements"));
    }
    TensorInfo::checked(tensor.name, tensor.dtype, tensor.shape, tensor.offset, &tensor.strides, storage)
}

fn read_entry(file: &File, name: &str, storage: Storage, limit: u64) -> Result<Vec<u8>, Fault> {
    if storage.len > limit {
        return Err(Fault::part(name, format!("{} bytes", storage.len), format!("at most {limit}")));
    }
    storage.read(file, 0..storage.len).map_err(|error| Fault::part(name, error.to_string(), "its data"))
}
