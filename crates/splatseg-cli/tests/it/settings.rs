//! Settings from a user's view: unused ones are errors, numbers stay exact, and errors use the user's terms.

use crate::support::{Ended, FEATURES, finish, read_json, splatseg};
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

const SMALL: &str = "synthetic:frames=3,width=64,height=48,objects=6";

fn run_scene(scene: &str, out: &Path, options: &[&str]) -> Ended {
    finish(splatseg().args(["run", scene, "--out"]).arg(out).args(options))
}

/// Asserts that a run with these options fails with this one-line error before it writes anything.
fn assert_refused(options: &[&str], expected: &str) {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let ended = run_scene(SMALL, &out, options);
    assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{options:?}: {}", ended.err);
    assert!(ended.err.contains(expected), "{options:?}: {}", ended.err);
    assert!(!out.exists(), "{options:?}");
}

fn written(folder: &TempDir, name: &str, text: &str) -> PathBuf {
    let path = folder.path().join(name);
    fs::write(&path, text).unwrap();
    path
}

/// Returns the id images of a run, in order.
fn segments(out: &Path) -> Vec<Vec<u8>> {
    let mut paths: Vec<PathBuf> =
        fs::read_dir(out.join("segments")).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    paths.iter().map(|path| fs::read(path).unwrap()).collect()
}

#[test]
fn numbers_of_2_63_and_more_are_errors_that_name_the_range() {
    let cases = [
        ("--seed", "seed", "0 to 9223372036854775807"),
        ("--threads", "threads", "0 to 512"),
        ("--start", "dataset.start", "0 to 1000000000"),
        ("--stride", "dataset.stride", "1 to 1000000000"),
        ("--max-frames", "dataset.max_frames", "1 to 1000000000"),
        ("--crop-border", "dataset.crop_border", "0 to 8192"),
    ];
    for (option, key, range) in cases {
        for number in ["9223372036854775808", "18446744073709551616"] {
            assert_refused(&[option, number], &format!("{key} is {number}, expected a whole number, {range}"));
        }
    }
    let folder = tempfile::tempdir().unwrap();
    let largest = "9223372036854775807";
    assert_eq!(run_scene(SMALL, &folder.path().join("out"), &["--seed", largest]).code, 0);
    assert_eq!(read_json(&folder.path().join("out/summary.json"))["seed"].to_string(), largest);
}

#[test]
fn settings_that_would_hang_are_out_of_range() {
    assert_refused(&["--threads", "10000"], "threads is 10000, expected a whole number, 0 to 512");
    let features = ["--set", "memory.kind=features", "--set"];
    for (setting, range) in [
        ("memory.num_steps=1000000000", "0 to 200"),
        ("memory.num_codes=1000000000", "1 to 2048"),
        ("memory.feature_dim=1000000000", "1 to 256"),
        ("memory.active_margin=1000000000", "0 to 100"),
    ] {
        let (key, number) = setting.split_once('=').unwrap();
        let expected = format!("{key} is {number}, expected a whole number, {range}");
        assert_refused(&[&features[..], &[setting]].concat(), &expected);
        // Also if the setting is not in use.
        assert_refused(&["--set", setting], &expected);
    }
}

#[test]
fn options_that_do_nothing_are_errors_that_say_what_would_use_them() {
    let tracker = "it needs method = sam2 or sam2-splat, but method is fastsam-splat";
    for (option, expected) in [
        (["--masks", "x"], "masks is not used here: it needs segmenter = masks, but segmenter is affinity"),
        (
            ["--set", "graph.min_area=9"],
            "graph.min_area is not used here: it needs segmenter = graph, but segmenter is affinity",
        ),
        (["--tracker", "sim"], tracker),
        (["--tracker-weights", "x.pt"], tracker),
        (["--prompts", "ground-truth"], tracker),
        (["--set", "sim_tracker.swap_rate=0"], tracker),
        (["--set", "dataset.depth_offset_m=0.1"], "it needs dataset.register_depth = true"),
    ] {
        assert_refused(&option, expected);
    }
    let paper = ["--set", "memory.growth=paper", "--set", "memory.growth_spacing=4"];
    assert_refused(&paper, "memory.growth_spacing is not used here: it needs memory.growth = missing");
    let features = ["--set", "memory.kind=features", "--set", "memory.growth_spacing=4"];
    assert_refused(&features, "it needs memory.growth = missing, but memory.growth is paper");
    assert_refused(&["--register-depth"], "only 7scenes, mcap, db3, bag and mkv have depth that is not registered");
    assert_refused(
        &["--set", "dataset.register_depth=true"],
        "only 7scenes, mcap, db3, bag and mkv have depth that is not registered",
    );

    let prompted = ["--method", "sam2", "--tracker", "sim", "--prompts", "ground-truth"];
    for (option, key) in
        [(["--segmenter", "oracle"], "segmenter"), (["--set", "affinity.min_area=9"], "affinity.min_area")]
    {
        let expected = format!("{key} is not used here: it needs");
        assert_refused(&[&prompted[..], &option].concat(), &expected);
    }
    let sim = ["--method", "sam2", "--tracker", "sim", "--device", "vulkan"];
    assert_refused(&[&sim[..], &["--segmenter", "graph"]].concat(), "but segmenter is graph and tracker is sim");
    #[cfg(not(feature = "cuda"))]
    assert_refused(
        &["--segmenter", "fastsam", "--weights", "x.pt", "--device", "cuda"],
        "this program was built without the device cuda: build it with --features cuda",
    );
}

#[test]
fn settings_files_are_named_with_their_line() {
    let folder = tempfile::tempdir().unwrap();
    for (name, text, expected) in [
        ("value.toml", "seed = 1\n[memory]\nmax_votes = 0\n", "line 3: memory.max_votes is 0, expected more than 0"),
        ("type.toml", "[memory]\n\nfeature_dim = \"many\"\n", "line 3: memory.feature_dim is \"many\", expected"),
        ("typo.toml", "[memory]\nmax_vots = 3\n", "line 2: there is no setting memory.max_vots, did you mean"),
        ("name.toml", "\nsegmenter = \"fastsan\"\n", "line 2: segmenter is \"fastsan\", did you mean fastsam?"),
        ("unused.toml", "[memory]\nnum_codes = 9\n", "line 2: memory.num_codes is not used here"),
        ("section.toml", "memory = 3\n", "line 1: memory is a section: choose one of its settings, e.g. memory.kind"),
        ("large.toml", "\n\nseed = 9223372036854775808\n", "line 3: 9223372036854775808 is out of range"),
        ("syntax.toml", "seed = 1\n[memory\n", "line 2: "),
        ("value.json", "{\"settings\": {\"memory\": {\"max_votes\": 0}}}", "value.json: memory.max_votes is 0"),
        ("large.json", "{\"seed\": 9223372036854775808}", "large.json: seed is 9223372036854775808, expected"),
        ("syntax.json", "{\"settings\": ", "syntax.json: is not JSON"),
    ] {
        let path = written(&folder, name, text);
        assert_refused(&["--config", path.to_str().unwrap()], expected);
        let ended = run_scene(SMALL, &folder.path().join("out"), &["--config", path.to_str().unwrap()]);
        assert!(ended.err.contains(name), "{}", ended.err);
        for word in ["usize", "u64", "i64", "f32", "struct", "Settings", "expected one of"] {
            assert!(!ended.err.contains(word), "{word}: {}", ended.err);
        }
    }
    // An invalid value that an option replaces is not an error.
    let path = written(&folder, "replaced.toml", "seed = 1\n[memory]\nmax_votes = 0\n");
    let replaced = ["--config", path.to_str().unwrap(), "--set", "memory.max_votes=3"];
    assert_eq!(run_scene(SMALL, &folder.path().join("out"), &replaced).code, 0);
}

#[test]
fn misspelt_names_are_answered_with_the_nearest_one() {
    for (setting, nearest) in [
        ("memory.max_vots=3", "memory.max_votes"),
        ("max_votes=3", "memory.max_votes"),
        ("graphs.min_aria=3", "graph.min_area"),
        ("segmentr=graph", "segmenter"),
        ("memory.kind=feature", "features"),
    ] {
        assert_refused(&["--set", setting], &format!("did you mean {nearest}?"));
    }
    let ended = finish(splatseg().args(["settings", "memory.max_vots"]));
    assert_eq!(ended.code, 2);
    assert!(ended.err.contains("did you mean memory.max_votes?"), "{}", ended.err);
}

#[cfg(unix)]
#[test]
fn settings_are_read_from_regular_files_of_a_sensible_size_only() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["huge.toml", "summary.json"] {
        let huge = folder.path().join(name);
        // A sparse file: takes no disk space.
        fs::File::create(&huge).unwrap().set_len(3_000_000_000).unwrap();
        assert_refused(&["--config", huge.to_str().unwrap()], "at most 16000000 are read");
    }
    let pipe = folder.path().join("pipe.toml");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    for special in [pipe.to_str().unwrap(), "/dev/zero"] {
        assert_refused(&["--config", special], "expected a regular file");
        assert_refused(&["--load-memory", special], "expected a regular file");
    }
}

#[test]
fn a_summary_lists_the_settings_in_force_and_repeats_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let tracked = ["--method", "sam2-splat", "--tracker", "sim", "--prompts", "ground-truth"];
    let cases: [(&[&str], &[&str], &[&str]); 3] = [
        (
            &["--seed", "5", "--set", "memory.max_votes=3.3"],
            &["affinity", "device", "min_match_f_score"],
            &["graph", "tracker"],
        ),
        (&FEATURES, &["affinity"], &["min_match_f_score", "oracle"]),
        (&tracked, &["sim_tracker", "reprompt"], &["segmenter", "affinity", "sam2", "device"]),
    ];
    for (place, (options, with, without)) in cases.into_iter().enumerate() {
        let [first, second] = ["a", "b"].map(|name| folder.path().join(format!("{place}{name}")));
        let ended = run_scene(SMALL, &first, &[options, &["--crop-border", "2"]].concat());
        assert_eq!(ended.code, 0, "{}", ended.err);
        let summary = first.join("summary.json");
        let settings = read_json(&summary)["settings"].clone();
        assert!(with.iter().all(|key| settings.get(key).is_some()), "{settings}");
        assert!(without.iter().all(|key| settings.get(key).is_none()), "{settings}");
        let ended = run_scene(SMALL, &second, &["--config", summary.to_str().unwrap()]);
        assert_eq!(ended.code, 0, "{}", ended.err);
        assert!(segments(&first) == segments(&second), "{options:?}");
        assert_eq!(read_json(&second.join("summary.json"))["settings"], settings);
    }
    let settings = read_json(&folder.path().join("0a/summary.json"))["settings"].clone();
    assert_eq!(settings["memory"]["max_votes"].to_string(), "3.3");
    assert_eq!(settings["memory"].get("num_codes"), None);
}

#[test]
fn a_saved_memory_brings_its_own_settings() {
    let folder = tempfile::tempdir().unwrap();
    let (saved, memory) = (folder.path().join("saved"), folder.path().join("memory.ply"));
    let memory = memory.to_str().unwrap();
    let save = [&FEATURES[..], &["--save-memory", memory]].concat();
    assert_eq!(run_scene(SMALL, &saved, &save).code, 0);

    let out = folder.path().join("out");
    let ended = run_scene(SMALL, &out, &["--load-memory", memory]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    let settings = read_json(&out.join("summary.json"))["settings"]["memory"].clone();
    assert_eq!(
        (&settings["kind"], &settings["feature_dim"], &settings["num_codes"]),
        (&"features".into(), &8.into(), &32.into())
    );

    let load = ["--load-memory", memory, "--set"];
    for (setting, saved) in
        [("memory.num_codes=64", "32"), ("memory.feature_dim=28", "8"), ("memory.kind=evidence", "\"features\"")]
    {
        let expected = format!("memory.ply has {saved}: leave the setting out");
        assert_refused(&[&load[..], &[setting]].concat(), &expected);
    }
    assert_refused(&[&load[..], &["memory.max_votes=3"]].concat(), "but memory.kind is features");
    let again = folder.path().join("again");
    assert_eq!(run_scene(SMALL, &again, &[&load[..], &["memory.num_codes=32"]].concat()).code, 0);
}
