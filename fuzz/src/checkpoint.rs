//! Reading everything of a checkpoint.

use splatseg_models::checkpoint::Checkpoint;
use splatseg_models::clip::ClipNetwork;
use splatseg_models::completeness::missing_tensors;
use splatseg_models::fastsam::FastSamConfig;
use std::path::Path;

/// Reads everything in a checkpoint of `bytes` bytes. Every defect must be returned as an error.
pub fn read_checkpoint(path: &Path, bytes: usize) {
    let Ok(checkpoint) = Checkpoint::open(path) else { return };
    for tensor in checkpoint.tensors() {
        if let Ok(numbers) = checkpoint.read_f32(tensor.name(), tensor.shape()) {
            assert_eq!(numbers.len(), tensor.elements());
            assert!(tensor.elements() * tensor.dtype().size() <= bytes, "more numbers than the file holds");
        }
    }
    let _ = checkpoint.architecture().to_string();
    let _ = missing_tensors(&checkpoint);
    let _ = FastSamConfig::from_checkpoint(&checkpoint);
    let _ = ClipNetwork::load(&checkpoint);
}
