//! Files with false claims, and files that would make a naive reader run code, fill the memory or never terminate.

use super::files::{WEIGHT, Written, archive, module_pickle, network, refusal, safetensors_file, torch_file};
use super::pickler::*;
use serde_json::json;
use splatseg_models::checkpoint::Checkpoint;
use std::time::{Duration, Instant};

/// Returns the error for a pickle in an archive with storages of six halves, two floats and one integer. Checks that it
/// is returned quickly.
fn pickle_refusal(piece: &[u8]) -> String {
    let bytes = torch_file(&pickle(piece));
    let start = Instant::now();
    let message = refusal(&bytes);
    assert!(start.elapsed() < Duration::from_secs(5), "{message}: after {:?}", start.elapsed());
    message
}

fn floats(offset: i64, shape: &[i64], strides: &[i64]) -> Piece {
    tensor(storage("FloatStorage", "1", 2), offset, shape, strides)
}

#[track_caller]
fn assert_refused(message: &str, parts: &[&str]) {
    for part in parts {
        assert!(message.contains(part), "no {part:?} in: {message}");
    }
}

#[test]
fn nothing_is_executed() {
    let folder = tempfile::tempdir().unwrap();
    let mark = folder.path().join("executed");
    let command = || text(&format!("touch {}", mark.display()));
    let open = || call("__builtin__", "open", &[text(mark.to_str().unwrap()), text("w")]);
    let more = [("hook", call("os", "system", &[command()])), ("file", open())];
    let piece = dict(&[("callback", call("posix", "system", &[command()])), ("model", network(&more))]);
    let file = Written::new(&torch_file(&pickle(&piece)));
    // The rest is read as if there were no calls.
    assert_eq!(file.open().tensors().count(), 3);
    // Also in place of a tensor, or around one.
    let message = pickle_refusal(&dict(&[("w", call("os", "system", &[command()]))]));
    assert_refused(&message, &["tensor w", "an object made by os.system", "a tensor"]);
    let message = pickle_refusal(&dict(&[("w", parameter(call("os", "system", &[command()])))]));
    assert_refused(&message, &["tensor w", "a parameter without a tensor"]);
    assert!(!mark.exists());
}

#[test]
fn tensors_stay_within_their_storage() {
    let huge = 1i64 << 62;
    let cases: [(Piece, &str); 9] = [
        (floats(0, &[3], &[1]), "shape [3], strides [1], offset 0"),
        (floats(1, &[2], &[1]), "offset 1"),
        (floats(0, &[2], &[2]), "strides [2]"),
        (floats(0, &[huge, huge], &[1, 1]), "shape"),
        (floats(0, &[2, 2], &[huge, huge]), "strides"),
        (floats(i64::MAX, &[2], &[1]), "offset 9223372036854775807"),
        // A stride of 0 makes two numbers a gigabyte.
        (floats(0, &[1 << 28], &[0]), "all of it within the 2 elements"),
        (floats(0, &[2], &[1, 1]), "1 axes with 2 strides"),
        (floats(0, &[1; 17], &[1; 17]), "expected a shape"),
    ];
    for (piece, part) in cases {
        assert_refused(&pickle_refusal(&dict(&[("w", piece)])), &["tensor w", part]);
    }
    let negative = [floats(-1, &[2], &[1]), floats(0, &[-2], &[1]), floats(0, &[2], &[-1])];
    for piece in negative {
        assert_refused(&pickle_refusal(&dict(&[("w", piece)])), &["tensor w"]);
    }
}

#[test]
fn storages_are_as_large_as_they_say() {
    let cases = [
        (storage("FloatStorage", "1", 1 << 40), "1099511627776 elements of float32 in 8 bytes"),
        (storage("FloatStorage", "1", i64::MAX), "elements of float32 in 8 bytes"),
        (storage("FloatStorage", "1", -2), "a storage without key or size"),
        (storage("DoubleStorage", "1", 2), "2 elements of float64 in 8 bytes"),
        (storage("FloatStorage", "absent", 2), "no entry small/data/absent"),
        (storage("FloatStorage", "../data.pkl", 2), "no entry small/data/../data.pkl"),
        (storage("QInt8Storage", "1", 8), "elements of torch.QInt8Storage"),
        (none(), "None, expected a storage"),
    ];
    for (storage, part) in cases {
        let piece = dict(&[("w", tensor(storage, 0, &[2], &[1]))]);
        assert_refused(&pickle_refusal(&piece), &["tensor w", part]);
    }
    let sparse = call("torch._utils", "_rebuild_sparse_tensor", &[none(), none()]);
    assert_refused(&pickle_refusal(&dict(&[("w", sparse)])), &["tensor w", "_rebuild_sparse_tensor", "a dense tensor"]);
}

#[test]
fn names_are_unique_short_and_printable() {
    let twice = dict(&[("w", floats(0, &[2], &[1])), ("w", floats(0, &[1], &[1]))]);
    assert_refused(&pickle_refusal(&twice), &["tensor w", "twice"]);
    let long = "x".repeat(1 << 20);
    assert_refused(&pickle_refusal(&dict(&[(&long, floats(0, &[2], &[1]))])), &["a name of 1048577 bytes"]);
    let lines = dict(&[("a\nb\u{1b}[31m", floats(9, &[2], &[1]))]);
    assert_refused(&pickle_refusal(&lines), &[r"a\nb\u{1b}[31m"]);
}

#[test]
fn depth_costs_nothing() {
    let depth = 200_000;
    // Nested lists, tuples, calls and objects, none of them a checkpoint.
    let lists = [vec![b']'; depth], vec![b'a'; depth - 1]].concat();
    let tuples = [b")".to_vec(), vec![0x85; depth]].concat();
    let calls = [global("a", "b"), b")R".repeat(depth)].concat();
    let states = [global("a", "b"), b")\x81".to_vec(), b"cc\nd\n)\x81".repeat(50_000), vec![b'b'; 50_000]].concat();
    for piece in [lists, tuples, calls, states] {
        assert_refused(&pickle_refusal(&piece), &["a module or a state dict"]);
    }
    // The same, as the configuration of a valid module.
    let lists = [vec![b']'; 10_000], vec![b'a'; 9_999]].concat();
    let piece = network(&[("yaml", dict(&[("backbone", lists)]))]);
    assert_refused(&pickle_refusal(&piece), &["the module's yaml", "more than any configuration has"]);
    // Nested modules.
    let mut piece = module("Inner", &[], &[], &[], &[]);
    for _ in 0..100 {
        piece = module("Outer", &[], &[], &[("m", piece)], &[]);
    }
    assert_refused(&pickle_refusal(&piece), &["modules nested", "at most 64"]);
}

#[test]
fn shared_values_do_not_explode() {
    // Each list contains the previous one twice: 2⁶⁰ leaves.
    let mut bomb = memoized(list(&[none()]), 0);
    for slot in 1..60 {
        bomb = [bomb, b"0".to_vec(), memoized(list(&[recalled(slot - 1), recalled(slot - 1)]), slot)].concat();
    }
    let piece = [bomb.clone(), b"0".to_vec(), network(&[("yaml", dict(&[("backbone", recalled(25))]))])].concat();
    assert_refused(&pickle_refusal(&piece), &["the module's yaml"]);
    assert_refused(&pickle_refusal(&[bomb, b"0".to_vec(), recalled(59)].concat()), &["found a list"]);
    // The same with modules, with and without tensors in them.
    for weights in [vec![], vec![("w", floats(0, &[2], &[1]))]] {
        let mut bomb = memoized(module("M", &weights, &[], &[], &[]), 0);
        for slot in 1..60 {
            let children = [("a", recalled(slot - 1)), ("b", recalled(slot - 1))];
            bomb = [bomb, b"0".to_vec(), memoized(module("M", &[], &[], &children, &[]), slot)].concat();
        }
        assert_refused(&pickle_refusal(&bomb), &["than any network has"]);
    }
    // One table of many entries, read again and again.
    let entries: Vec<u8> = (0..100_000).flat_map(|_| b"NN".to_vec()).collect();
    let table = memoized([b"}(".to_vec(), entries, b"u".to_vec()].concat(), 200);
    let children: Vec<(String, Piece)> =
        (0..1000).map(|index| (index.to_string(), object("a", "b", recalled(200)))).collect();
    let children: Vec<(&str, Piece)> = children.iter().map(|(name, piece)| (name.as_str(), piece.clone())).collect();
    let piece = [table, b"0".to_vec(), module("M", &[], &[], &children, &[])].concat();
    pickle_refusal(&piece);
}

#[test]
fn shared_data_do_not_explode_when_converted() {
    let names: Vec<String> = (0..2000).map(|index| format!("w{index}")).collect();
    let entries: Vec<(&str, Piece)> = names.iter().map(|name| (name.as_str(), recalled(1))).collect();
    let numbers = tensor(storage("FloatStorage", "n", 1 << 16), 0, &[1 << 16], &[1]);
    let piece = [memoized(numbers, 1), b"0".to_vec(), dict(&entries)].concat();
    let file = Written::new(&archive(&[("r/data.pkl", &pickle(&piece)), ("r/data/n", &vec![0; 1 << 18])]));
    let message = file.open().convert(&file.folder().join("out")).unwrap_err().to_string();
    assert_refused(&message, &["the tensors", "524288000 bytes that share data", "twice the file"]);
}

#[test]
fn values_that_contain_themselves_are_no_trap() {
    // A module that is its own child; a configuration that is its own entry; a parameter of itself.
    let head = [global("some.nn", "M"), memoized(b")\x81".to_vec(), 0)].concat();
    let state = dict(&[("_parameters", dict(&[])), ("_buffers", dict(&[])), ("_modules", dict(&[("m", recalled(0))]))]);
    assert_refused(&pickle_refusal(&[head, state, b"b".to_vec()].concat()), &["modules nested"]);
    let yaml = [memoized(b"}".to_vec(), 1), text("self"), recalled(1), b"s".to_vec()].concat();
    assert_refused(&pickle_refusal(&network(&[("yaml", yaml)])), &["the module's yaml"]);
    let list = [memoized(b"]".to_vec(), 1), recalled(1), b"a".to_vec()].concat();
    assert_refused(&pickle_refusal(&dict(&[("w", parameter(list))])), &["tensor w"]);
}

#[test]
fn floods_are_stopped() {
    let millions = 3 << 20;
    let cases: [(Piece, &str); 5] = [
        (vec![b'N'; millions], "more values than any checkpoint has"),
        (vec![b'('; millions], "more marks"),
        ([none(), vec![b'2'; millions]].concat(), "more stack slots"),
        ([none(), vec![0x94; millions]].concat(), "more memo entries"),
        (b")0".repeat(millions / 2), "more values"),
    ];
    for (piece, part) in cases {
        assert_refused(&pickle_refusal(&piece), &["data.pkl, byte", part]);
    }
    assert_refused(&pickle_refusal(&vec![b'N'; 9 << 20]), &["data.pkl", "at most 8388608"]);
}

#[test]
fn broken_pickles_are_refused_at_the_byte() {
    let cases: [(&[u8], &str); 12] = [
        (b"", "an empty stack"),
        (b"h\x05", "empty memo slot 5"),
        (b"a", "an empty stack"),
        (b"t", "no mark"),
        (b"(NNNu", "a key without a value"),
        (b"N(0a", "an empty stack"),
        (b"NNa", "items appended to a value of another type"),
        (b"NNNs", "entries set on a value of another type"),
        (b"X\xff\xff\xff\xffabc", "bytes left instead of 4294967295"),
        (b"\x8d\xff\xff\xff\xff\xff\xff\xff\xff", "bytes left instead of"),
        (b"X\x01\x00\x00\x00\xff", "not UTF-8"),
        (b"\x80\x09", "pickle protocol 9"),
    ];
    for (piece, part) in cases {
        assert_refused(&pickle_refusal(piece), &["small/data.pkl, byte ", part]);
    }
    assert_refused(&pickle_refusal(b"i"), &["the opcode 0x69", "one that checkpoints use"]);
    assert_refused(&pickle_refusal(b"(\x93"), &["an empty stack"]);
}

#[test]
fn cut_files_are_refused() {
    let bytes = torch_file(&module_pickle());
    for len in (0..bytes.len()).step_by(11) {
        refusal(&bytes[..len]);
    }
    let pickle = module_pickle();
    for len in (0..pickle.len()).step_by(3) {
        assert_refused(&refusal(&torch_file(&pickle[..len])), &["data.pkl"]);
    }
}

#[test]
fn archives_are_as_torch_writes_them() {
    let pickle = module_pickle();
    let mut compressed = torch_file(&pickle);
    // The compression method in the directory's first record, that of data.pkl.
    let record = compressed.windows(4).position(|window| window == b"PK\x01\x02").unwrap();
    compressed[record + 10] = 8;
    assert_refused(&refusal(&compressed), &["small/data.pkl", "compressed data"]);

    assert_refused(&refusal(&archive(&[("readme.txt", b"hello")])), &["the zip archive", "found none", "data.pkl"]);
    let two: [(&str, &[u8]); 2] = [("a/data.pkl", &pickle), ("b/data.pkl", &pickle)];
    assert_refused(&refusal(&archive(&two)), &["found several", "one entry data.pkl"]);
    let big: [(&str, &[u8]); 2] = [("a/data.pkl", &pickle), ("a/byteorder", b"big")];
    assert_refused(&refusal(&archive(&big)), &["byteorder", "found big, expected little"]);
}

#[test]
fn directories_that_claim_much_take_no_memory() {
    // The number of entries, and the directory's size and offset, of a zip64 archive.
    let mut bytes = torch_file(&module_pickle());
    let end = bytes.windows(4).rposition(|window| window == b"PK\x05\x06").unwrap();
    let mut zip64 = Vec::new();
    zip64.extend(b"PK\x06\x06");
    zip64.extend(44u64.to_le_bytes());
    zip64.extend([45, 0, 45, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
    for value in [1u64 << 40, 1 << 40, 46 << 40, 1 << 41] {
        zip64.extend(value.to_le_bytes());
    }
    zip64.extend(b"PK\x06\x07\0\0\0\0");
    zip64.extend((end as u64).to_le_bytes());
    zip64.extend(1u32.to_le_bytes());
    bytes[end + 8..end + 20].fill(0xff);
    bytes.splice(end..end, zip64);
    assert_refused(&refusal(&bytes), &["the zip archive"]);
}

#[test]
fn damaged_numbers_are_noticed() {
    let mut bytes = torch_file(&module_pickle());
    let place = bytes.windows(2).position(|window| window == half::f16::from_f32(1024.0).to_le_bytes()).unwrap();
    bytes[place] ^= 4;
    let file = Written::new(&bytes);
    let checkpoint = file.open();
    let message = checkpoint.read_f32("model.0.conv.weight", &[2, 3, 1, 1]).unwrap_err().to_string();
    assert_refused(&message, &["file.pt: tensor model.0.conv.weight: found damaged data"]);
    // A file that shrinks after it is opened.
    std::fs::write(&file.path, &bytes[..40]).unwrap();
    let message = checkpoint.read_f32("model.0.bn.running_mean", &[2]).unwrap_err().to_string();
    assert_refused(&message, &["file.pt: tensor model.0.bn.running_mean"]);
}

#[test]
fn damage_beside_the_tensor_that_is_read_is_noticed() {
    // A tensor of the first two of the storage's six halves; the damage is in the others.
    let part = parameter(tensor(storage("HalfStorage", "0", 6), 0, &[2], &[1]));
    let mut bytes = torch_file(&pickle(&dict(&[("part", part)])));
    let intact = Written::new(&bytes);
    assert_eq!(intact.open().read_f32("part", &[2]).unwrap(), WEIGHT[..2]);
    assert!(intact.open().damaged_entries().unwrap().is_empty());
    let place = bytes.windows(2).position(|window| window == half::f16::from_f32(1024.0).to_le_bytes()).unwrap();
    bytes[place] ^= 4;
    let file = Written::new(&bytes);
    let message = file.open().read_f32("part", &[2]).unwrap_err().to_string();
    assert_refused(&message, &["file.pt: tensor part: found damaged data"]);
    assert_eq!(file.open().damaged_entries().unwrap(), ["small/data/0"]);
}

#[test]
fn code_that_python_would_run_is_listed() {
    let system = call("posix", "system", &[text("true")]);
    let imported = global("some.module", "function");
    let state = dict(&[("model", network(&[])), ("optimizer", system), ("callback", imported), ("date", text("now"))]);
    let file = Written::new(&torch_file(&pickle(&state)));
    let found = file.open().foreign_code().to_vec();
    let strange = ["call posix.system", "call some.nn.BatchNorm2d", "import some.module.function"];
    assert!(strange.iter().all(|name| found.iter().any(|found| found == name)), "{found:?}");
    assert!(!found.iter().any(|name| name.contains("torch") || name.contains("OrderedDict")), "{found:?}");
    // A call whose result is discarded is still a call.
    let discarded =
        [call("posix", "system", &[text("true")]), b"0".to_vec(), dict(&[("model", network(&[]))])].concat();
    let file = Written::new(&torch_file(&pickle(&discarded)));
    assert!(file.open().foreign_code().contains(&"call posix.system".to_owned()));
    let nested = [call("builtins", "getattr", &[text("a"), text("b")]), tuple(&[]), b"R".to_vec()].concat();
    let file = Written::new(&torch_file(&pickle(&dict(&[("model", network(&[])), ("x", nested)]))));
    assert!(file.open().foreign_code().contains(&"call a computed function".to_owned()));
}

#[cfg(unix)]
#[test]
fn devices_and_fifos_are_refused_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let fifo = folder.path().join("fifo.pt");
    assert!(std::process::Command::new("mkfifo").arg(&fifo).status().unwrap().success());
    for (path, kind) in [(fifo.as_path(), "a FIFO"), (std::path::Path::new("/dev/zero"), "a device")] {
        let message = Checkpoint::open(path).unwrap_err().to_string();
        assert!(message.ends_with(&format!("cannot open: it is {kind}, expected a regular file")), "{message}");
    }
}

#[test]
fn modules_have_their_tables() {
    let tables = |parameters: Piece| {
        let state = [("_parameters", parameters), ("_buffers", dict(&[])), ("_modules", dict(&[]))];
        object("some.nn", "M", dict(&state))
    };
    assert_refused(&pickle_refusal(&tables(int(3))), &["module \"\"", "an integer", "a dict _parameters"]);
    assert_refused(&pickle_refusal(&tables(dict(&[("w", int(3))]))), &["tensor w", "an integer", "a tensor"]);
    assert_refused(&pickle_refusal(&tables(dict(&[]))), &["no tensor"]);
    let child = module("M", &[], &[], &[("inner", text("no module"))], &[]);
    assert_refused(&pickle_refusal(&child), &["module \"inner\"", "a string"]);
    let norm = |eps| module("BatchNorm2d", &[], &[], &[], &[("eps", float(eps))]);
    let norms = module("M", &[], &[], &[("a", norm(1e-3)), ("b", norm(1e-5))], &[]);
    assert_refused(&pickle_refusal(&norms), &["module \"b\"", "eps 0.00001", "0.001"]);
}

#[test]
fn safetensors_files_do_not_lie() {
    let tensor = |shape: serde_json::Value, start: u64, end: u64| {
        json!({"w": {"dtype": "F32", "shape": shape, "data_offsets": [start, end]}}).to_string()
    };
    let deep = format!("{{\"w\": {}1{}}}", "[".repeat(100_000), "]".repeat(100_000));
    let cases: [(String, &[u8], &str); 8] = [
        (tensor(json!([2]), 0, 8), &[0; 4], "the data"),
        (tensor(json!([2]), 0, 8), &[0; 12], "the data"),
        (tensor(json!([3]), 0, 8), &[0; 8], "the header"),
        (tensor(json!([2]), 4, 12), &[0; 12], "the header"),
        (tensor(json!([1u64 << 63, 4]), 0, 8), &[0; 8], "the header"),
        (tensor(json!([2]), 8, 0), &[0; 8], "the header"),
        (tensor(json!([2]), 0, 8).replace("F32", "Q4"), &[0; 8], "the header"),
        (deep, &[0; 8], "the header"),
    ];
    for (header, data, part) in cases {
        assert_refused(&refusal(&safetensors_file(&header, data)), &[part]);
    }
    // A header longer than the file, and one longer than any header.
    let long = [&(1u64 << 40).to_le_bytes()[..], b"{\"w\": 1}"].concat();
    assert_refused(&refusal(&long), &["expected a checkpoint"]);
    let long = [&(9u64 << 20).to_le_bytes()[..], &vec![b'{'; 10 << 20]].concat();
    assert_refused(&refusal(&long), &["the header", "at most 2097152"]);
    let axes = tensor(json!(vec![0; 17]), 0, 0);
    assert_refused(&refusal(&safetensors_file(&axes, &[])), &["tensor w", "17 axes"]);
    let strange = json!({"__metadata__": {"splatseg": "[]"}}).to_string();
    assert_refused(&refusal(&safetensors_file(&strange, &[])), &["splatseg in the header"]);
}

#[test]
fn other_files_are_told_apart() {
    for (bytes, part) in [
        (&b""[..], "an empty file"),
        (b"ply\nformat", "a PLY file"),
        (b"\x80\x02\x8a\x0al\xfc\x9cF\xf9 j\xa8P\x19.", "PyTorch before 1.6"),
        (b"\x89PNG\r\n\x1a\n and more", "a file that begins with"),
    ] {
        assert_refused(&refusal(bytes), &[part, "expected a checkpoint"]);
    }
    let folder = tempfile::tempdir().unwrap();
    let message = Checkpoint::open(folder.path()).unwrap_err().to_string();
    assert!(message.contains(folder.path().to_str().unwrap()), "{message}");
}
