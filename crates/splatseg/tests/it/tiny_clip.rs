//! A tiny network for images and words, which knows shapes and colours: it was trained with
//! `training/splatseg_training/words.py`.

use safetensors::SafeTensors;
use safetensors::tensor::{Dtype, TensorView, serialize_to_file};
use std::path::Path;

/// The shapes that it knows.
pub const SHAPES: [&str; 3] = ["ball", "box", "cone"];
/// The colours that it knows, sRGB.
pub const COLORS: [(&str, [u8; 3]); 6] = [
    ("red", [190, 30, 35]),
    ("yellow", [235, 210, 50]),
    ("green", [50, 140, 60]),
    ("blue", [40, 75, 180]),
    ("white", [235, 235, 235]),
    ("black", [30, 30, 30]),
];

/// Writes a vocabulary of all shapes but some in all colours.
pub fn write_vocabulary(path: &Path, without: &[&str]) {
    let shapes = SHAPES.iter().filter(|shape| !without.contains(shape));
    let labels = shapes.flat_map(|shape| COLORS.map(|(color, _)| format!("{color} {shape}\n")));
    std::fs::write(path, labels.collect::<String>()).unwrap();
}

/// Writes the network that knows shapes and colours.
pub fn write_network(path: &Path) {
    write_network_of("tiny_clip", path);
}

/// Writes a network of `tests/data` with all rows of its token embedding, of which the file has those that are used.
pub fn write_network_of(name: &str, path: &Path) {
    // Also from a crate beside this one.
    let file = format!("{}/../splatseg/tests/data/{name}.safetensors", env!("CARGO_MANIFEST_DIR"));
    let bytes = std::fs::read(file).unwrap();
    let (_, metadata) = SafeTensors::read_metadata(&bytes).unwrap();
    let tensors = SafeTensors::deserialize(&bytes).unwrap();
    let (rows, used) = (tensors.tensor("token_embedding.rows").unwrap(), tensors.tensor("token_rows").unwrap());
    let row_bytes = rows.data().len() / rows.shape()[0];
    let mut embedding = vec![0; 49408 * row_bytes];
    for (number, row) in used.data().as_chunks::<4>().0.iter().zip(rows.data().chunks_exact(row_bytes)) {
        embedding[u32::from_le_bytes(*number) as usize * row_bytes..][..row_bytes].copy_from_slice(row);
    }
    let whole = TensorView::new(Dtype::F16, vec![49408, rows.shape()[1]], &embedding).unwrap();
    let others = tensors.tensors().into_iter().filter(|(name, _)| !name.contains("_rows") && !name.ends_with(".rows"));
    let all = others.chain([("token_embedding.weight".to_owned(), whole)]);
    serialize_to_file(all, metadata.metadata().clone(), path).unwrap();
}
