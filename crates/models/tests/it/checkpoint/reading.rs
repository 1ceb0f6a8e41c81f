//! Reading valid files.

use super::files::{MEAN, WEIGHT, Written, archive, module_pickle, network, torch_file};
use super::pickler::*;
use safetensors::SafeTensors;
use splatseg_models::checkpoint::{Checkpoint, Dtype};

#[test]
fn a_module_is_read_as_its_state_dict() {
    let file = Written::new(&torch_file(&module_pickle()));
    let checkpoint = file.open();
    let found: Vec<_> = checkpoint.tensors().map(|tensor| (tensor.name(), tensor.dtype(), tensor.shape())).collect();
    let expected: [(&str, Dtype, &[usize]); 3] = [
        ("model.0.conv.weight", Dtype::F16, &[2, 3, 1, 1]),
        ("model.0.bn.running_mean", Dtype::F32, &[2]),
        ("model.0.bn.num_batches_tracked", Dtype::I64, &[]),
    ];
    assert_eq!(found, expected);
    assert_eq!(checkpoint.read_f32("model.0.conv.weight", &[2, 3, 1, 1]).unwrap(), WEIGHT);
    assert_eq!(checkpoint.read_f32("model.0.bn.running_mean", &[2]).unwrap(), MEAN);
    assert_eq!(checkpoint.batch_norm_eps(), Some(1e-3));
    assert_eq!(checkpoint.class(), Some("SegmentationModel"));
    assert_eq!(checkpoint.configuration(), Some(&serde_json::json!({"nc": 1, "backbone": [[-1, "Conv"], null]})));
    assert_eq!(checkpoint.parameters(), 6);
}

#[test]
fn ema_comes_before_model() {
    let other = dict(&[("w", tensor(storage("FloatStorage", "1", 2), 0, &[2], &[1]))]);
    let file = Written::new(&torch_file(&pickle(&dict(&[("model", other), ("ema", network(&[]))]))));
    assert!(file.open().info("model.0.conv.weight").is_some());
}

#[test]
fn state_dicts_are_read_bare_and_as_model() {
    let weight = tensor(storage("FloatStorage", "1", 2), 0, &[2], &[1]);
    let entries = [("w", weight), ("note", text("hello")), ("step", int(3))];
    for piece in [dict(&entries), ordered_dict(&entries), dict(&[("model", ordered_dict(&entries))])] {
        let file = Written::new(&torch_file(&pickle(&piece)));
        let checkpoint = file.open();
        assert_eq!(checkpoint.tensors().count(), 1);
        assert_eq!(checkpoint.read_f32("w", &[2]).unwrap(), MEAN);
    }
}

#[test]
fn strides_and_offsets_are_followed() {
    // 0 to 11 in one storage, with several views.
    let numbers: Vec<u8> = (0..12).flat_map(|value| (value as f32).to_le_bytes()).collect();
    let view =
        |offset, shape: &[i64], strides: &[i64]| tensor(storage("FloatStorage", "n", 12), offset, shape, strides);
    let entries = [
        ("all", view(0, &[3, 4], &[4, 1])),
        ("transposed", view(0, &[4, 3], &[1, 4])),
        ("part", view(5, &[2, 2], &[4, 1])),
        ("row", view(4, &[1, 4], &[99, 1])),
        ("number", view(11, &[], &[])),
        ("empty", view(3, &[0, 5], &[5, 1])),
        ("repeated", view(7, &[2, 3], &[0, 1])),
    ];
    let file = Written::new(&archive(&[("r/data.pkl", &pickle(&dict(&entries))), ("r/data/n", &numbers)]));
    let checkpoint = file.open();
    let read = |name: &str, shape: &[usize]| checkpoint.read_f32(name, shape).unwrap();
    assert_eq!(read("all", &[3, 4]), (0..12).map(|value| value as f32).collect::<Vec<_>>());
    assert_eq!(read("transposed", &[4, 3]), [0., 4., 8., 1., 5., 9., 2., 6., 10., 3., 7., 11.]);
    assert_eq!(read("part", &[2, 2]), [5., 6., 9., 10.]);
    assert_eq!(read("row", &[1, 4]), [4., 5., 6., 7.]);
    assert_eq!(read("number", &[]), [11.]);
    assert_eq!(read("empty", &[0, 5]), [0.0; 0]);
    assert_eq!(read("repeated", &[2, 3]), [7., 8., 9., 7., 8., 9.]);
}

#[test]
fn every_floating_type_becomes_f32() {
    let values = [1.5f64, -0.0, 65504.0, 1e-5];
    let bytes = |element: fn(f64) -> Vec<u8>| values.iter().flat_map(|value| element(*value)).collect::<Vec<u8>>();
    let cases: [(&str, Vec<u8>, f64); 4] = [
        ("DoubleStorage", bytes(|value| value.to_le_bytes().to_vec()), 1e-7),
        ("FloatStorage", bytes(|value| (value as f32).to_le_bytes().to_vec()), 1e-7),
        ("HalfStorage", bytes(|value| half::f16::from_f64(value).to_le_bytes().to_vec()), 1e-2),
        ("BFloat16Storage", bytes(|value| half::bf16::from_f64(value).to_le_bytes().to_vec()), 1e-2),
    ];
    for (class, data, tolerance) in cases {
        let piece = dict(&[("w", tensor(storage(class, "0", 4), 0, &[4], &[1]))]);
        let file = Written::new(&archive(&[("r/data.pkl", &pickle(&piece)), ("r/data/0", &data)]));
        for (found, expected) in file.open().read_f32("w", &[4]).unwrap().iter().zip(values) {
            assert!((f64::from(*found) - expected).abs() <= tolerance * expected.abs(), "{class}: {found} {expected}");
        }
    }
}

#[test]
fn missing_and_misshapen_tensors_are_named() {
    let file = Written::new(&torch_file(&module_pickle()));
    let checkpoint = file.open();
    let error = |name: &str, shape: &[usize]| {
        let message = checkpoint.read_f32(name, shape).unwrap_err().to_string();
        message.strip_prefix(&format!("{}: ", file.path.display())).unwrap().to_owned()
    };
    assert_eq!(
        error("model.0.conv.weight", &[3, 2, 1, 1]),
        "tensor model.0.conv.weight: found shape [2, 3, 1, 1], expected [3, 2, 1, 1]"
    );
    assert_eq!(error("nothing", &[1]), "tensor nothing: found no such tensor, expected shape [1]");
    assert_eq!(
        error("model.0.bn.num_batches_tracked", &[]),
        "tensor model.0.bn.num_batches_tracked: found int64, expected floating-point numbers"
    );
}

#[test]
fn a_converted_file_holds_the_same() {
    let file = Written::new(&torch_file(&module_pickle()));
    let checkpoint = file.open();
    let (first, second) = (file.folder().join("first.safetensors"), file.folder().join("second.safetensors"));
    checkpoint.convert(&first).unwrap();
    checkpoint.convert(&second).unwrap();
    let bytes = std::fs::read(&first).unwrap();
    assert_eq!(bytes, std::fs::read(&second).unwrap());

    let converted = Checkpoint::open(&first).unwrap();
    assert_eq!(converted.tensors().count(), 3);
    for tensor in checkpoint.tensors() {
        let other = converted.info(tensor.name()).unwrap();
        assert_eq!((other.dtype(), other.shape()), (tensor.dtype(), tensor.shape()));
    }
    assert_eq!(converted.read_f32("model.0.conv.weight", &[2, 3, 1, 1]).unwrap(), WEIGHT);
    assert_eq!(converted.read_f32("model.0.bn.running_mean", &[2]).unwrap(), MEAN);
    assert_eq!(converted.configuration(), checkpoint.configuration());
    assert_eq!(converted.batch_norm_eps(), Some(1e-3));
    assert_eq!(converted.class(), Some("SegmentationModel"));
    // Other programs can read it too.
    let others = SafeTensors::deserialize(&bytes).unwrap();
    assert_eq!(others.tensor("model.0.bn.num_batches_tracked").unwrap().data(), 7i64.to_le_bytes());

    let error = checkpoint.convert(&first).unwrap_err().to_string();
    assert!(error.contains("first.safetensors: already exists"), "{error}");
    let error = checkpoint.convert(&file.folder().join("absent/out.safetensors")).unwrap_err().to_string();
    assert!(error.contains("out.safetensors: cannot write"), "{error}");
}

#[test]
fn a_failed_conversion_leaves_nothing() {
    let mut bytes = torch_file(&module_pickle());
    let place = bytes.windows(4).rposition(|window| window == MEAN[0].to_le_bytes()).unwrap();
    bytes[place] ^= 1;
    let file = Written::new(&bytes);
    let error = file.open().convert(&file.folder().join("out.safetensors")).unwrap_err().to_string();
    assert!(error.contains("tensor model.0.bn.running_mean: found damaged data"), "{error}");
    assert_eq!(std::fs::read_dir(file.folder()).unwrap().count(), 1);
}
