//! Finds code that a pickle would run in Python.
//!
//! Here a pickle is only data. Python's `pickle`, and therefore `torch.load(…, weights_only=False)`, imports and calls
//! anything that a file names. Dangerous names cannot be listed exhaustively, so this module lists harmless ones: the
//! classes and functions in checkpoints of PyTorch and Ultralytics.

use super::error::printable;
use super::pickle::{Graph, Value};
use std::collections::BTreeSet;

/// Maximum number of names listed; a pickle could contain hundreds of thousands.
const MAX_LISTED: usize = 64;

/// Harmless names by module.
const HARMLESS: [(&str, &[&str]); 17] = [
    ("__builtin__", BUILTINS),
    ("builtins", BUILTINS),
    ("_codecs", &["encode"]),
    ("argparse", &["Namespace"]),
    ("collections", &["Counter", "OrderedDict", "defaultdict", "deque"]),
    ("copy_reg", &["_reconstructor"]),
    ("copyreg", &["_reconstructor"]),
    ("datetime", &["date", "datetime", "timedelta"]),
    ("numpy", &["dtype", "ndarray"]),
    ("numpy._core.multiarray", &["_reconstruct", "scalar"]),
    ("numpy.core.multiarray", &["_reconstruct", "scalar"]),
    ("pathlib", &["Path", "PosixPath", "PurePosixPath", "PureWindowsPath", "WindowsPath"]),
    ("torch", &["Size", "Tensor", "device", "dtype"]),
    ("torch.nn.parameter", &["Buffer", "Parameter"]),
    ("torch.storage", &["TypedStorage", "UntypedStorage"]),
    ("torch.torch_version", &["TorchVersion"]),
    ("types", &["SimpleNamespace"]),
];

const BUILTINS: &[&str] = &[
    "bool",
    "bytearray",
    "bytes",
    "complex",
    "dict",
    "float",
    "frozenset",
    "int",
    "list",
    "object",
    "range",
    "set",
    "slice",
    "str",
    "tuple",
];

/// Modules whose classes are all harmless.
const HARMLESS_CLASSES: [&str; 5] =
    ["torch.nn.modules.", "torch.optim.", "ultralytics.nn.", "ultralytics.utils.", "ultralytics.yolo."];

/// Returns the imports and calls of a pickle that are not known to be harmless, e.g. `call posix.system`.
pub(super) fn foreign_code(graph: &Graph<'_>) -> Vec<String> {
    let mut called = BTreeSet::new();
    let mut named = BTreeSet::new();
    for value in graph.values() {
        match value {
            Value::Object(object) => match graph.callable(object) {
                Some(name) => drop(called.insert(name)),
                // The callable is the result of another call, or not callable at all.
                None => drop(called.insert(("", "a computed function"))),
            },
            Value::Global { module, name } => drop(named.insert((*module, *name))),
            _ => {}
        }
    }
    let imported = named.difference(&called).map(|name| ("import", *name));
    let all = called.iter().map(|name| ("call", *name)).chain(imported);
    let foreign = all.filter(|(_, (module, name))| !is_harmless(module, name));
    let text = |(verb, (module, name)): (&str, (&str, &str))| match module {
        "" => format!("{verb} {}", printable(name)),
        _ => format!("{verb} {}", printable(&format!("{module}.{name}"))),
    };
    foreign.take(MAX_LISTED).map(text).collect()
}

fn is_harmless(module: &str, name: &str) -> bool {
    // A dotted name follows attributes, which can lead out of the module.
    if name.contains('.') {
        return false;
    }
    let is_listed = HARMLESS.iter().any(|(known, names)| *known == module && names.contains(&name));
    // Functions have lower-case names by convention.
    let is_class = name.contains(|letter: char| letter.is_ascii_uppercase());
    is_listed
        || (module == "torch" && (name.ends_with("Storage") || is_dtype(name)))
        || (module == "torch._utils" && name.starts_with("_rebuild_"))
        || (is_class
            && HARMLESS_CLASSES
                .iter()
                .any(|prefix| module.starts_with(prefix) || module == &prefix[..prefix.len() - 1]))
}

fn is_dtype(name: &str) -> bool {
    let digits = name.trim_start_matches(|letter: char| letter.is_ascii_lowercase());
    let kind = &name[..name.len() - digits.len()];
    matches!(kind, "float" | "bfloat" | "int" | "uint" | "bool") && digits.bytes().all(|digit| digit.is_ascii_digit())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_of_checkpoints_are_harmless_and_functions_are_not() {
        for (module, name) in [
            ("torch", "HalfStorage"),
            ("torch", "bfloat16"),
            ("torch._utils", "_rebuild_tensor_v2"),
            ("ultralytics.nn.tasks", "SegmentationModel"),
            ("ultralytics.yolo.utils.loss", "v8SegmentationLoss"),
            ("ultralytics.utils", "IterableSimpleNamespace"),
            ("torch.nn.modules.conv", "Conv2d"),
        ] {
            assert!(is_harmless(module, name), "{module}.{name}");
        }
        for (module, name) in [
            ("posix", "system"),
            ("builtins", "eval"),
            ("__builtin__", "getattr"),
            ("torch", "load"),
            ("torch.hub", "load"),
            ("torch.storage", "_load_from_bytes"),
            ("torch", "serialization.FloatStorage"),
            ("ultralytics.utils.checks", "check_requirements"),
            ("ultralytics.nnevil", "Model"),
            ("numpy.testing._private.utils", "runstring"),
        ] {
            assert!(!is_harmless(module, name), "{module}.{name}");
        }
    }
}
