//! `splatseg inspect`: its output and its errors.

use crate::support::{
    Ended, FASTSAM_WEIGHTS, RECOGNISED_AS_EDGETAM, file_names, finish, numbered_scene, splatseg, write_zeros,
};
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};

fn inspect(file: &Path, more: &[&str]) -> Ended {
    finish(splatseg().arg("inspect").arg(file).args(more))
}

/// Writes a state dict with two tensors of 6 and 2 numbers. The second is a statistic.
fn small_file(folder: &Path) -> PathBuf {
    let header = json!({
        "linear.weight": {"dtype": "F32", "shape": [2, 3], "data_offsets": [0, 24]},
        "norm.running_mean": {"dtype": "F16", "shape": [2], "data_offsets": [24, 28]},
    })
    .to_string();
    let mut bytes = (header.len() as u64).to_le_bytes().to_vec();
    bytes.extend(header.bytes().chain([0; 28]));
    let path = folder.join("small.safetensors");
    fs::write(&path, bytes).unwrap();
    path
}

#[test]
fn shows_the_contents_of_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let ended = inspect(&small_file(folder.path()), &["--tensors"]);
    assert_eq!((ended.code, ended.err.as_str()), (0, ""));
    for line in [
        "kind           safetensors, state dict",
        "architecture   unknown",
        "tensors        2 (1 float32, 1 float16)",
        "parameters     6",
        "missing        unknown: splatseg runs FastSAM, SAM 2.1, EdgeTAM, EfficientTAM, CLIP, Perception Encoder and Depth Anything V2 only",
        "  linear.weight float32 [2, 3]",
    ] {
        assert!(ended.out.lines().any(|found| found == line), "{line}\n{}", ended.out);
    }
}

#[test]
fn shows_the_contents_of_an_ultralytics_checkpoint() {
    let test = "shows_the_contents_of_an_ultralytics_checkpoint";
    let Some(path) = splatseg_test_scenes::shared("models/fastsam-rooms-n.pt", test) else { return };
    let folder = tempfile::tempdir().unwrap();
    let converted = folder.path().join("rooms.safetensors");
    let ended = inspect(&path, &["--convert", converted.to_str().unwrap()]);
    assert_eq!((ended.code, ended.err.as_str()), (0, ""));
    let first = ended.out.lines().find(|line| line.starts_with("architecture")).unwrap();
    assert_eq!(first, "architecture   FastSAM-n (YOLOv8n-seg with 1 class)");
    assert!(ended.out.lines().any(|line| line == "missing        nothing"), "{}", ended.out);
    let again = inspect(&converted, &[]);
    // All lines except file, kind and the one about the conversion.
    let facts = |ended: &Ended| ended.out.lines().skip(2).take(4).map(str::to_owned).collect::<Vec<_>>();
    assert_eq!(facts(&again), facts(&ended));
    assert!(again.out.contains("batch-norm eps 0.001"), "{}", again.out);
}

/// Creates a PyTorch archive with the zip crate's own writer: a state dict with one tensor of two floats, called `name`,
/// and a call of `posix.system`, whose result is discarded.
fn archive_that_calls(name: &str) -> Vec<u8> {
    let text = |text: &str| [b"X", &(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat();
    let mut pickle = b"\x80\x02cposix\nsystem\n(".to_vec();
    pickle.extend(text("true"));
    pickle.extend(b"tR0}");
    pickle.extend(text(name));
    pickle.extend(b"ctorch._utils\n_rebuild_tensor_v2\n((");
    pickle.extend(text("storage"));
    pickle.extend(b"ctorch\nFloatStorage\n");
    pickle.extend([text("0"), text("cpu")].concat());
    pickle.extend(b"K\x02tQK\x00K\x02\x85K\x01\x85\x89ccollections\nOrderedDict\n)RtRs.");
    let mut writer = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    let options = zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
    let numbers = [0.5f32, -7.25].map(f32::to_le_bytes).concat();
    for (entry, bytes) in
        [("small/data.pkl", &pickle), ("small/byteorder", &b"little".to_vec()), ("small/data/0", &numbers)]
    {
        writer.start_file(entry, options).unwrap();
        std::io::Write::write_all(&mut writer, bytes).unwrap();
    }
    writer.finish().unwrap().into_inner()
}

#[test]
fn unsafe_and_damaged_checkpoints_are_reported_and_fail() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("small.pt");
    let mut bytes = archive_that_calls("weight");
    fs::write(&path, &bytes).unwrap();
    let ended = inspect(&path, &[]);
    let call = "would call posix.system: never executed here, but do not load it elsewhere";
    assert_eq!(ended.code, 2);
    assert!(ended.out.contains(&format!("unsafe         {call}\n")), "{}", ended.out);
    assert!(ended.err.contains(call) && ended.err.lines().count() == 1, "{}", ended.err);
    assert!(!ended.out.contains("CRC"), "{}", ended.out);

    let place = bytes.windows(4).position(|window| window == (-7.25f32).to_le_bytes()).unwrap();
    bytes[place] ^= 1;
    fs::write(&path, &bytes).unwrap();
    let ended = inspect(&path, &[]);
    assert_eq!(ended.code, 2);
    assert!(ended.out.contains("damaged        CRC of small/data/0 is wrong\n"), "{}", ended.out);
    assert!(ended.out.contains(call) && ended.err.contains("CRC of small/data/0 is wrong"), "{}", ended.err);
}

#[test]
fn names_from_a_file_cannot_control_the_terminal() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("small.pt");
    let name = format!("a\u{1b}[31m\nmissing        nothing\u{202e}b{}", "x".repeat(300));
    fs::write(&path, archive_that_calls(&name)).unwrap();
    let ended = inspect(&path, &["--tensors"]);
    let line = ended.out.lines().find(|line| line.starts_with("  a")).unwrap();
    assert!(line.starts_with(r"  a\u{1b}[31m\nmissing        nothing\u{202e}bxxx"), "{line}");
    assert!(line.contains("…") && line.chars().count() < 130, "{line}");
    assert!(!ended.out.contains('\u{1b}') && !ended.out.contains('\u{202e}'), "{}", ended.out);
}

#[test]
fn never_overwrites() {
    let folder = tempfile::tempdir().unwrap();
    let file = small_file(folder.path());
    let out = folder.path().join("out.safetensors");
    fs::write(&out, "precious").unwrap();
    let ended = inspect(&file, &["--convert", out.to_str().unwrap()]);
    assert_eq!(ended.code, 2);
    assert!(ended.err.contains("out.safetensors: already exists"), "{}", ended.err);
    assert_eq!(fs::read_to_string(&out).unwrap(), "precious");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
}

/// Trackers are recognised by some of their tensors; the others may be missing, and the file may be another network's.
#[test]
fn damaged_and_foreign_trackers_are_one_line_errors() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    write_zeros(&path("incomplete.safetensors"), &RECOGNISED_AS_EDGETAM);
    let stem = ("image_encoder.trunk.body.stem.conv1.c.weight", &[24, 3, 3, 3][..]);
    write_zeros(&path("empty-stages.safetensors"), &[&RECOGNISED_AS_EDGETAM[..], &[stem]].concat());
    let whole = fs::read(path("incomplete.safetensors")).unwrap();
    fs::write(path("cut.safetensors"), &whole[..whole.len() / 2]).unwrap();
    fs::copy(FASTSAM_WEIGHTS, path("fastsam.safetensors")).unwrap();
    let scene = "synthetic:frames=1,width=64,height=48";
    for (name, message) in [
        ("incomplete.safetensors", "not a checkpoint of SAM 2.1, EdgeTAM or EfficientTAM"),
        ("empty-stages.safetensors", "tensor `spatial_perceiver.latents_2d` is missing"),
        ("cut.safetensors", ""),
        ("fastsam.safetensors", "not a checkpoint of SAM 2.1, EdgeTAM or EfficientTAM"),
    ] {
        let mut run = splatseg();
        run.args(["run", scene, "--method", "sam2-splat", "--segmenter", "oracle", "--tracker-weights"])
            .arg(path(name));
        let ended = finish(run.arg("--out").arg(path("out")));
        assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{}", ended.err);
        assert!(ended.err.contains(name) && ended.err.contains(message), "{}", ended.err);
    }
    let ended = inspect(&path("incomplete.safetensors"), &[]);
    for line in ["architecture   EdgeTAM", "missing        unknown: the tensors from which"] {
        assert!(ended.out.lines().any(|found| found.starts_with(line)), "{line}\n{}", ended.out);
    }
}

#[test]
fn bad_files_are_one_line_errors() {
    let folder = tempfile::tempdir().unwrap();
    let cases: [(&str, &[u8], &str); 3] = [
        ("empty.pt", b"", "an empty file, expected a checkpoint"),
        ("text.pt", b"hello world, no weights here", "a file that begins with \"hello world"),
        ("cut.pt", b"PK\x03\x04 and then nothing", "the zip archive"),
    ];
    for (name, bytes, message) in cases {
        let path = folder.path().join(name);
        fs::write(&path, bytes).unwrap();
        let ended = inspect(&path, &[]);
        assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{}", ended.err);
        assert!(ended.err.contains(name) && ended.err.contains(message), "{}", ended.err);
        assert_eq!(ended.out, "");
    }
    let ended = inspect(&folder.path().join("absent.pt"), &[]);
    assert_eq!((ended.code, ended.err.lines().count()), (2, 1));
    assert!(ended.err.contains("absent.pt: cannot open"), "{}", ended.err);
}

#[test]
fn shows_what_a_run_reads_from_a_folder() {
    let folder = tempfile::tempdir().unwrap();
    let scene = numbered_scene(folder.path(), 3);
    let ended = inspect(&scene, &[]);
    assert_eq!((ended.code, ended.err.as_str()), (0, ""));
    for start in [
        "kind           scene, format scannet",
        "frames         3",
        "camera         fx ",
        "depth          ",
        "times          none",
    ] {
        assert!(ended.out.lines().any(|line| line.starts_with(start)), "{start}\n{}", ended.out);
    }
    assert!(ended.out.contains("poses          recorded\n"), "{}", ended.out);
    let refused = inspect(&scene, &["--tensors"]);
    assert_eq!((refused.code, refused.err.lines().count()), (2, 1), "{}", refused.err);

    fs::write(scene.join("color").join(&file_names(&scene.join("color"))[0]), "no image").unwrap();
    let damaged = inspect(&scene, &[]);
    assert_eq!(damaged.code, 0, "{}", damaged.err);
    assert!(damaged.out.contains("damaged        frame 0 (0) cannot be used: "), "{}", damaged.out);

    fs::remove_dir_all(scene.join("depth")).unwrap();
    let missing = inspect(&scene, &[]);
    assert_eq!((missing.code, missing.err.lines().count()), (2, 1), "{}", missing.err);
    assert!(missing.err.contains("depth"), "{}", missing.err);
}

#[test]
fn a_folder_of_recordings_is_listed() {
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| folder.path().join(name);
    fs::copy(Path::new(env!("CARGO_MANIFEST_DIR")).join("../dataset/tests/data/mcap/room.mcap"), place("a.mcap"))
        .unwrap();
    fs::write(place("b.mcap"), "no recording").unwrap();
    fs::rename(numbered_scene(folder.path(), 3), place("kitchen")).unwrap();
    fs::create_dir(place("notes")).unwrap();
    fs::write(place("notes/todo.txt"), "nothing").unwrap();
    let ended = inspect(folder.path(), &[]);
    assert_eq!((ended.code, ended.err.as_str()), (0, ""), "{}", ended.out);
    let lines: Vec<&str> = ended.out.lines().collect();
    assert_eq!(lines[1], "kind           folder of 3 recordings");
    assert!(lines[2].starts_with("  a.mcap   mcap") && lines[2].contains(" frames, "), "{}", ended.out);
    assert!(lines[3].starts_with("  b.mcap   ") && lines[3].contains("b.mcap: "), "{}", ended.out);
    assert!(lines[4].starts_with("  kitchen  scannet     3 frames, poses"), "{}", ended.out);
    assert_eq!(lines.len(), 5, "{}", ended.out);
    let json: serde_json::Value = serde_json::from_str(&inspect(folder.path(), &["--json"]).out).unwrap();
    assert_eq!((&json[2]["frames"], &json[0]["error"]), (&json!(3), &json!(null)));
    let refused = inspect(folder.path(), &["--tensors"]);
    assert_eq!((refused.code, refused.err.lines().count()), (2, 1), "{}", refused.err);
}

#[test]
fn the_results_of_a_run_are_described_and_are_no_scene() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let map = out.join("map.ply");
    let scene = "synthetic:frames=2,width=96,height=72";
    let options = ["run", scene, "--out", out.to_str().unwrap(), "--quiet", "--no-overlay"];
    let ended = finish(splatseg().args(options).args(["--save-memory", map.to_str().unwrap()]));
    assert_eq!(ended.code, 0, "{}", ended.err);
    let described = inspect(&out, &[]).out;
    for line in ["kind           results of a run", &format!("scene          {scene}"), "frames         2"] {
        assert!(described.lines().any(|found| found == line), "{line}: {described}");
    }
    assert!(described.contains("index.html") && described.contains("map.ply"), "{described}");
    let json: serde_json::Value = serde_json::from_str(&inspect(&out, &["--json"]).out).unwrap();
    assert_eq!((&json["kind"], &json["frames"], &json["interrupted"]), (&json!("results"), &json!(2), &json!(false)));
    assert_eq!(json["maps"].as_array().unwrap().len(), 1);
    let refused = finish(splatseg().args(["run", out.to_str().unwrap()]));
    assert_eq!((refused.code, refused.err.lines().count()), (2, 1), "{}", refused.err);
    assert!(refused.err.contains(&format!("the results of a run of {scene}")), "{}", refused.err);
}

#[test]
fn contents_are_printed_as_json() {
    let folder = tempfile::tempdir().unwrap();
    let printed = |file: &Path, more: &[&str]| {
        let ended = inspect(file, &[&["--json"], more].concat());
        assert_eq!(ended.code, 0, "{}", ended.err);
        serde_json::from_str::<serde_json::Value>(&ended.out).unwrap()
    };
    let checkpoint = printed(&small_file(folder.path()), &["--tensors"]);
    assert_eq!((&checkpoint["kind"], &checkpoint["parameters"]), (&json!("checkpoint"), &json!(6)));
    assert_eq!(checkpoint["tensor_list"][0], json!({"name": "linear.weight", "type": "float32", "shape": [2, 3]}));
    let scene = printed(&numbered_scene(folder.path(), 3), &[]);
    assert_eq!((&scene["format"], &scene["frames"], &scene["has_poses"]), (&json!("scannet"), &json!(3), &json!(true)));
    let room = printed(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../dataset/tests/data/mcap/room.mcap"), &[]);
    assert_eq!((&room["kind"], &room["error"]), (&json!("recording"), &json!(null)));
    assert!(room["frames"].as_u64() > Some(0) && room["topics"].as_array().unwrap().len() > 2, "{room}");
}

#[test]
fn a_map_shows_its_objects() {
    let folder = tempfile::tempdir().unwrap();
    let (out, map) = (folder.path().join("out"), folder.path().join("map.ply"));
    let mut run = splatseg();
    run.args(["run", "synthetic:frames=8,width=96,height=72,objects=4", "--segmenter", "oracle", "--out"]).arg(&out);
    assert_eq!(finish(run.arg("--save-memory").arg(&map)).code, 0);
    let ended = inspect(&map, &[]);
    assert_eq!((ended.code, ended.err.as_str()), (0, ""));
    let objects = ended.out.lines().find_map(|line| line.strip_prefix("objects        ")).unwrap();
    let count: usize = objects.split(' ').next().unwrap().parse().unwrap();
    assert_eq!(ended.out.lines().filter(|line| line.starts_with("  ")).count(), count, "{}", ended.out);
    let other = folder.path().join("other.ply");
    fs::write(&other, "ply\nformat binary_little_endian 1.0\n").unwrap();
    let damaged = inspect(&other, &[]);
    assert_eq!((damaged.code, damaged.out.as_str(), damaged.err.lines().count()), (2, "", 1), "{}", damaged.err);
    assert!(damaged.err.contains("other.ply"), "{}", damaged.err);
}

#[test]
fn whatever_is_no_recording_is_told_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let files: [(&str, &[u8], &str); 16] = [
        ("empty", b"", "a file that begins with nothing, expected a recording: .mcap"),
        ("paper.pdf", b"%PDF-1.7\n", "a file that begins with \"%PDF-1.7\\n\", expected a recording: .mcap"),
        ("notes.txt", "größer\u{7}".as_bytes(), "expected a recording: .mcap"),
        ("a.zip", b"PK\x03\x04\x14\0\0\0", "a zip file, expected the folder that it unpacks to"),
        ("a.r3d", b"", "expected a recording"),
        ("data.h5", b"\x89HDF\r\n\x1a\n", "an HDF5 file, expected its images as a folder"),
        ("zed.svo2", b"SVO", "a recording of a ZED camera, expected an MCAP recording"),
        ("talk.mp4", b"\0\0\0\x18ftypmp42\0\0\0\0", "talk.mp4"),
        ("film.mkv", b"\x1A\x45\xDF\xA3\x80", "film.mkv"),
        ("bag.txt", b"#ROSBAG V2.0\n", "a bag of ROS 1 with another name, expected a file whose name ends with .bag"),
        ("mcap.dat", b"\x89MCAP0\r\n", "an MCAP recording with another name"),
        ("log.sqlite", b"SQLite format 3\0", "an SQLite file with another name, expected a recording of rosbag2"),
        ("db.mcap", b"SQLite format 3\0", "the start of every MCAP file"),
        ("a.bag", b"not a bag", "the start of every bag of ROS 1"),
        ("a.db3", b"", "the start of every SQLite file"),
        ("transforms.json", b"{", "transforms.json"),
    ];
    for (name, bytes, expected) in files {
        let path = folder.path().join(name);
        fs::write(&path, bytes).unwrap();
        let ended = inspect(&path, &[]);
        // An ffmpeg is tried first where there is one.
        let lines: Vec<&str> =
            ended.err.trim_end().lines().filter(|line| !line.contains("decoding with ffmpeg")).collect();
        assert_eq!((ended.code, lines.len()), (2, 1), "{name}: {}", ended.err);
        assert!(lines[0].starts_with("error: ") && ended.err.contains(expected), "{name}: {}", ended.err);
        assert!(!ended.err.contains("checkpoint"), "{name}: {}", ended.err);
    }
    // 200 GB of nothing.
    for name in ["huge", "huge.mcap", "huge.bag", "huge.db3", "huge.mkv", "huge.r3d"] {
        let path = folder.path().join(name);
        fs::File::create(&path).and_then(|file| file.set_len(200 << 30)).unwrap();
        let ended = inspect(&path, &[]);
        assert_eq!((ended.code, ended.err.trim_end().lines().count()), (2, 1), "{name}: {}", ended.err);
        fs::remove_file(&path).unwrap();
    }
}

#[cfg(unix)]
#[test]
fn of_a_video_only_the_first_frame_is_decoded() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    image::RgbImage::from_pixel(64, 48, image::Rgb([90, 80, 70])).save(folder.path().join("frame.jpg")).unwrap();
    // Writes an image in place of ffmpeg, if asked for one only.
    let program = folder.path().join("ffmpeg");
    let script = "#!/bin/sh\ncase \"$*\" in *'-frames:v 1 '*) ;; *) exit 1;; esac\nfor last; do true; done\n\
        cp \"${0%/*}/frame.jpg\" \"${last%/*}/000000.jpg\"\n\
        echo '[Parsed_showinfo_1 @ 0x5] n:   0 pts:   0 pts_time:0.5   duration: 1' >&2\n";
    fs::write(&program, script).unwrap();
    fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
    let video = folder.path().join("walk.mp4");
    fs::write(&video, b"\0\0\0\x20ftypisom").unwrap();
    let path = format!("{}:/usr/bin:/bin", folder.path().display());
    let ended = finish(splatseg().arg("inspect").arg(&video).env("PATH", &path));
    assert_eq!(ended.code, 0, "{}", ended.err);
    for line in ["format video", "not counted", "64x48", "60 degrees", "0.500 s, of one frame", "--depth-weights"] {
        assert!(ended.out.contains(line), "{line}: {}", ended.out);
    }
    let ended = finish(splatseg().args(["inspect", "--json"]).arg(&video).env("PATH", &path));
    let described: Value = serde_json::from_str(&ended.out).unwrap();
    assert_eq!((&described["frames"], &described["has_depth"]), (&Value::Null, &Value::Bool(false)), "{described}");
}

#[test]
fn a_file_that_is_a_scene_is_shown() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    image::RgbImage::from_pixel(64, 48, image::Rgb([90, 80, 70])).save(path("a.png")).unwrap();
    image::ImageBuffer::from_pixel(64, 48, image::Luma([1500_u16])).save(path("depth.png")).unwrap();
    let matrix = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]];
    let frame = json!({"file_path": "a.png", "depth_file_path": "depth.png", "transform_matrix": matrix});
    let file = json!({"fl_x": 60, "cx": 32, "cy": 24, "w": 64, "h": 48, "frames": [frame]});
    fs::write(path("transforms.json"), file.to_string()).unwrap();
    let ended = inspect(&path("transforms.json"), &[]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    for line in ["format nerfstudio", "frames         1", "64x48", "1.50 to 1.50 m"] {
        assert!(ended.out.contains(line), "{line}: {}", ended.out);
    }
}
