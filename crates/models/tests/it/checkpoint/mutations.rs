//! Valid files with bytes changed at random: the reader must return quickly and without a panic, with any result.
//!
//! `PROPTEST_CASES=20000` tries that many files of each kind.

use super::files::{Written, module_pickle, safetensors_file, torch_file};
use proptest::prelude::*;
use proptest::sample::Index;
use splatseg_models::checkpoint::Checkpoint;
use std::time::{Duration, Instant};

/// Opens the file and reads everything; checks that no more is read than the file contains.
fn exercise(bytes: &[u8]) -> Result<(), TestCaseError> {
    let file = Written::new(bytes);
    let start = Instant::now();
    match Checkpoint::open(&file.path) {
        Ok(checkpoint) => {
            for tensor in checkpoint.tensors() {
                prop_assert!(tensor.elements() * tensor.dtype().size() <= bytes.len());
                if let Ok(numbers) = checkpoint.read_f32(tensor.name(), tensor.shape()) {
                    prop_assert_eq!(numbers.len(), tensor.elements());
                }
            }
            let _ = checkpoint.architecture().to_string();
        }
        Err(error) => prop_assert_eq!(error.to_string().lines().count(), 1),
    }
    prop_assert!(start.elapsed() < Duration::from_secs(5));
    Ok(())
}

/// Changes: a position, its new value, and the number of bytes then removed from that position on.
fn changes() -> impl Strategy<Value = Vec<(Index, u8, usize)>> {
    prop::collection::vec((any::<Index>(), any::<u8>(), prop_oneof![4 => Just(0usize), 1 => 1..9usize]), 1..6)
}

fn changed(bytes: &[u8], changes: &[(Index, u8, usize)]) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    for (index, value, gone) in changes {
        if !bytes.is_empty() {
            let place = index.index(bytes.len());
            bytes[place] = *value;
            let end = (place + gone).min(bytes.len());
            bytes.drain(place..end);
        }
    }
    bytes
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn changed_pickles(changes in changes()) {
        exercise(&torch_file(&changed(&module_pickle(), &changes)))?;
    }

    #[test]
    fn changed_archives(changes in changes()) {
        exercise(&changed(&torch_file(&module_pickle()), &changes))?;
    }

    #[test]
    fn changed_safetensors(changes in changes()) {
        let header = r#"{"__metadata__":{"splatseg":"{\"architecture\":\"unknown\"}"},
            "a.weight":{"dtype":"F32","shape":[2,1],"data_offsets":[0,8]},
            "b":{"dtype":"BF16","shape":[3],"data_offsets":[8,14]}}"#;
        exercise(&changed(&safetensors_file(header, &[1; 14]), &changes))?;
    }

    #[test]
    fn random_programs(program in prop::collection::vec(opcode(), 0..200)) {
        exercise(&torch_file(&super::pickler::pickle(&program.concat())))?;
    }
}

/// An opcode with a plausible argument.
fn opcode() -> impl Strategy<Value = Vec<u8>> {
    let names = ["model", "ema", "_modules", "_parameters", "_buffers", "weight", "yaml", "eps", "storage", "0"];
    prop_oneof![
        4 => prop::sample::select(b"(t)}]ludsaeRbQN0\x81\x85\x86\x87\x88\x90\x93\x94".to_vec()).prop_map(|code| vec![code]),
        1 => (0..8u8).prop_map(|slot| vec![b'h', slot]),
        1 => (0..8u8).prop_map(|slot| vec![b'q', slot]),
        1 => any::<u8>().prop_map(|value| vec![b'K', value]),
        2 => prop::sample::select(names.to_vec()).prop_map(super::pickler::text),
        1 => Just(super::pickler::global("torch._utils", "_rebuild_tensor_v2")),
        1 => Just(super::pickler::global("collections", "OrderedDict")),
        1 => Just(super::pickler::global("torch", "FloatStorage")),
    ]
}
