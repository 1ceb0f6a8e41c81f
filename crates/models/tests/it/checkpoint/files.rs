//! Creates small files, so that tests need no others.

use super::pickler::*;
use splatseg_models::checkpoint::Checkpoint;
use std::io::{Cursor, Write};
use std::path::{Path, PathBuf};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

/// Values of the convolution in [`module_pickle`], `[2, 3, 1, 1]`.
pub const WEIGHT: [f32; 6] = [0.5, -1.0, 2.0, 0.25, 1024.0, -0.125];
/// Values of the batch norm's statistic, `[2]`.
pub const MEAN: [f32; 2] = [0.1, -3.5];

/// A zip archive with uncompressed entries, as `torch.save` writes.
pub fn archive(entries: &[(&str, &[u8])]) -> Vec<u8> {
    let mut writer = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    for (name, bytes) in entries {
        writer.start_file(*name, options).unwrap();
        writer.write_all(bytes).unwrap();
    }
    writer.finish().unwrap().into_inner()
}

/// The archive of a pickle whose storages are `0` (six halves), `1` (two floats) and `2` (one 64-bit integer).
pub fn torch_file(pickle: &[u8]) -> Vec<u8> {
    let halves: Vec<u8> = WEIGHT.iter().flat_map(|value| half::f16::from_f32(*value).to_le_bytes()).collect();
    let floats: Vec<u8> = MEAN.iter().flat_map(|value| value.to_le_bytes()).collect();
    archive(&[
        ("small/data.pkl", pickle),
        ("small/byteorder", b"little"),
        ("small/data/0", &halves),
        ("small/data/1", &floats),
        ("small/data/2", &7i64.to_le_bytes()),
    ])
}

/// A parameter of six halves, a buffer of two floats, a transient buffer, an integer, a configuration.
pub fn module_pickle() -> Vec<u8> {
    pickle(&dict(&[("epoch", int(-1)), ("ema", none()), ("model", network(&[]))]))
}

/// The module in [`module_pickle`], with more attributes at the top.
pub fn network(more: &[(&str, Piece)]) -> Piece {
    let weight = parameter(tensor(storage("HalfStorage", "0", 6), 0, &[2, 3, 1, 1], &[3, 1, 1, 1]));
    let mean = tensor(storage("FloatStorage", "1", 2), 0, &[2], &[1]);
    let tracked = tensor(storage("LongStorage", "2", 1), 0, &[], &[]);
    let transient = call("__builtin__", "set", &[list(&[text("anchors")])]);
    let conv = module("Conv2d", &[("weight", weight), ("bias", none())], &[], &[], &[]);
    let buffers = [("running_mean", mean.clone()), ("anchors", mean), ("num_batches_tracked", tracked)];
    let norm_more = [("_non_persistent_buffers_set", transient), ("eps", float(1e-3))];
    let norm = module("BatchNorm2d", &[], &buffers, &[], &norm_more);
    let block = module("Conv", &[], &[], &[("conv", conv), ("bn", norm)], &[]);
    let layers = module("Sequential", &[], &[], &[("0", block)], &[]);
    let yaml = dict(&[("nc", int(1)), ("backbone", list(&[tuple(&[int(-1), text("Conv")]), none()]))]);
    module("SegmentationModel", &[], &[], &[("model", layers)], &[&[("yaml", yaml)], more].concat())
}

/// Bytes of a `.safetensors` file with this header.
pub fn safetensors_file(header: &str, data: &[u8]) -> Vec<u8> {
    [&(header.len() as u64).to_le_bytes(), header.as_bytes(), data].concat()
}

/// A folder with one file.
pub struct Written {
    folder: tempfile::TempDir,
    pub path: PathBuf,
}

impl Written {
    pub fn new(bytes: &[u8]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file.pt");
        std::fs::write(&path, bytes).unwrap();
        Self { folder, path }
    }

    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    pub fn open(&self) -> Checkpoint {
        Checkpoint::open(&self.path).unwrap_or_else(|error| panic!("{error}"))
    }
}

/// Returns the error from opening these bytes: one line that contains the path.
pub fn refusal(bytes: &[u8]) -> String {
    let file = Written::new(bytes);
    let message = Checkpoint::open(&file.path).map(|_| ()).expect_err("it was opened").to_string();
    assert!(message.starts_with(file.path.to_str().unwrap()), "{message}");
    assert!(message.lines().count() == 1 && message.len() < 600, "{message}");
    message
}
