//! Names and shapes of the published models' parameters.

use super::golden::shared;
use burn::tensor::Device;
use serde::Deserialize;
use splatseg_models::fastsam::{FastSamConfig, FastSamError, FastSamNetwork, Weights};
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::Path;

#[derive(Deserialize)]
struct Manifest {
    arch: String,
    tensors: Vec<(String, Vec<usize>)>,
}

/// Weights that are zero for every tensor of a manifest. Records the names read.
struct Zeros {
    shapes: BTreeMap<String, Vec<usize>>,
    read: RefCell<Vec<String>>,
}

impl Weights for Zeros {
    fn path(&self) -> &Path {
        Path::new("manifest")
    }

    fn shape(&self, name: &str) -> Option<Vec<usize>> {
        self.shapes.get(name).cloned()
    }

    fn read_f32(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, FastSamError> {
        assert_eq!(self.shapes.get(name).map(Vec::as_slice), Some(shape), "{name}");
        self.read.borrow_mut().push(name.to_owned());
        Ok(vec![0.0; shape.iter().product()])
    }
}

fn check(size: char, test: &str) {
    let Some(path) = shared(&format!("golden/fastsam/manifest_{size}.json"), test) else { return };
    let manifest: Manifest = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    let weights = Zeros { shapes: manifest.tensors.into_iter().collect(), read: RefCell::default() };
    let architecture = FastSamConfig::from_tensors(&weights).unwrap();
    assert_eq!(architecture.name(), manifest.arch);
    assert_eq!(FastSamConfig::published(size), Some(architecture));
    FastSamNetwork::load(&weights, architecture, &Device::flex()).unwrap();
    let mut read = weights.read.into_inner();
    read.sort();
    // Constants and counters of training steps are not parameters.
    let is_parameter = |name: &&String| !name.ends_with(".num_batches_tracked") && *name != "model.22.dfl.conv.weight";
    assert_eq!(read.iter().collect::<Vec<_>>(), weights.shapes.keys().filter(is_parameter).collect::<Vec<_>>());
}

#[test]
fn parameters_of_fastsam_s_are_read_one_to_one() {
    check('s', "parameters_of_fastsam_s_are_read_one_to_one");
}

#[test]
fn parameters_of_fastsam_x_are_read_one_to_one() {
    check('x', "parameters_of_fastsam_x_are_read_one_to_one");
}
