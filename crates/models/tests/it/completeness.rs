//! Finding tensors that checkpoints lack for their networks.

use crate::sam2_golden::own_or_shared;
use safetensors::SafeTensors;
use safetensors::tensor::TensorView;
use splatseg_models::checkpoint::Checkpoint;
use splatseg_models::completeness::{Missing, missing_tensors};
use std::path::Path;

fn open(path: &Path) -> Checkpoint {
    Checkpoint::open(path).unwrap()
}

#[test]
fn whole_checkpoints_lack_nothing() {
    for path in ["golden/fastsam/fastsam_mini.pt", "golden/fastsam/fastsam_mini_v80120.pt", "golden/sam2/sam2_mini.pt"]
    {
        let Some(path) = own_or_shared(path, "whole_checkpoints_lack_nothing") else { return };
        assert_eq!(missing_tensors(&open(&path)), Some(Vec::new()), "{}", path.display());
    }
}

/// A copy of a checkpoint without the tensor `absent`, and with `misshapen` reduced to one number.
fn crippled(file: &Path, absent: &str, misshapen: &str) -> tempfile::NamedTempFile {
    let checkpoint = open(file);
    let folder = tempfile::tempdir().unwrap();
    let whole = folder.path().join("whole.safetensors");
    checkpoint.convert(&whole).unwrap();
    let bytes = std::fs::read(&whole).unwrap();
    let tensors = SafeTensors::deserialize(&bytes).unwrap();
    let number = [0u8; 4];
    let kept = tensors.tensors().into_iter().filter(|(name, _)| name != absent).map(|(name, view)| {
        let one = || TensorView::new(safetensors::Dtype::F32, vec![1], &number).unwrap();
        let view = if name == misshapen { one() } else { view };
        (name, view)
    });
    let out = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(out.path(), safetensors::serialize(kept, None).unwrap()).unwrap();
    out
}

#[test]
fn missing_and_misshapen_tensors_are_all_named() {
    let cases = [
        ("golden/fastsam/fastsam_mini_statedict.safetensors", "model.9.cv1.bn.weight", "model.22.cv2.1.2.bias"),
        ("golden/sam2/sam2_mini.pt", "no_obj_embed_spatial", "memory_encoder.out_proj.bias"),
    ];
    for (file, absent, misshapen) in cases {
        let Some(path) = own_or_shared(file, "missing_and_misshapen_tensors_are_all_named") else { return };
        let expected = |name: &str| open(&path).info(name).unwrap().shape().to_vec();
        let mut missing = missing_tensors(&open(crippled(&path, absent, misshapen).path())).unwrap();
        missing.sort_by(|a, b| a.name.cmp(&b.name));
        let mut wanted = [
            Missing { name: absent.to_owned(), expected: expected(absent), found: None },
            Missing { name: misshapen.to_owned(), expected: expected(misshapen), found: Some(vec![1]) },
        ];
        wanted.sort_by(|a, b| a.name.cmp(&b.name));
        assert_eq!(missing, wanted, "{file}");
        assert!(missing.iter().any(|tensor| tensor.to_string().starts_with(&format!("{absent}: missing, expected"))));
    }
}
