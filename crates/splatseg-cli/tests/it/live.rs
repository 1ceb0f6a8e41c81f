//! `splatseg live`.

use crate::support::{Ended, finish, read_json, splatseg, stoppable_splatseg};
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

fn recording() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../dataset/tests/data/mcap/room.mcap")
}

fn live(source: &Path, more: &[&str]) -> Ended {
    finish(splatseg().arg("live").arg(source).args(["--threads", "2", "--world-frame", "map"]).args(more))
}

#[test]
fn every_frame_gives_the_map_of_an_online_run() {
    let folder = tempfile::tempdir().unwrap();
    let [of_stream, of_run, out] = ["stream.ply", "run.ply", "out"].map(|name| folder.path().join(name));
    let ended = live(&recording(), &["--every-frame", "--map", of_stream.to_str().unwrap()]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    assert!(ended.out.contains("4 frames, "), "{}", ended.out);
    let mut command = splatseg();
    command.arg("run").arg(recording()).arg("--out").arg(&out).arg("--save-memory").arg(&of_run);
    let ended = finish(command.args(["--threads", "2", "--world-frame", "map", "--online"]));
    assert_eq!(ended.code, 0, "{}", ended.err);
    assert!(fs::read(&of_stream).unwrap() == fs::read(&of_run).unwrap(), "the maps differ");
    let ids = |path: &Path| -> Vec<u64> {
        let list = read_json(path);
        list["objects"].as_array().unwrap().iter().map(|object| object["id"].as_u64().unwrap()).collect()
    };
    assert_eq!(ids(&folder.path().join("stream.objects.json")), ids(&out.join("objects.json")));
}

#[test]
fn a_map_is_continued_and_nothing_else_is_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let [map, text] = ["home.ply", "notes.txt"].map(|name| folder.path().join(name));
    let map_text = map.to_str().unwrap();
    for _ in 0..2 {
        let ended = live(&recording(), &["--every-frame", "--map", map_text]);
        assert_eq!(ended.code, 0, "{}", ended.err);
    }
    // A map of its name would have its list of objects there.
    let list = folder.path().join("mine.objects.json");
    for (mine, map) in [(&text, &text), (&list, &folder.path().join("mine.ply"))] {
        fs::write(mine, "mine").unwrap();
        let ended = live(&recording(), &["--map", map.to_str().unwrap()]);
        assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{}", ended.err);
        assert_eq!(fs::read_to_string(mine).unwrap(), "mine");
    }
}

#[test]
fn wrong_input_is_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let none = folder.path().join("none.mcap");
    let broken = folder.path().join("broken.mcap");
    fs::write(&broken, "not a recording").unwrap();
    for (source, more) in [
        (&none, vec![]),
        (&broken, vec![]),
        (&recording(), vec!["--speed", "0"]),
        (&recording(), vec!["--stride", "2"]),
        (&recording(), vec!["--save-interval", "nan"]),
        (&recording(), vec!["--method", "fastsam", "--map", "map.ply"]),
        (&folder.path().to_owned(), vec![]),
    ] {
        let ended = live(source, &more);
        assert_eq!(ended.code, 2, "{more:?}: {}", ended.err);
        let errors = ended.err.lines().filter(|line| line.starts_with("error: ")).count();
        assert_eq!(errors, 1, "{}", ended.err);
    }
}

/// Neither file of the map may be lost to the recording.
#[test]
fn a_recording_is_no_file_of_the_map() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let other = folder.path().join("../").join(folder.path().file_name().unwrap()).join("home.ply");
    for (record, expected) in [
        (path("home.ply"), "is the file of --map: choose another file for --record"),
        (other.to_str().unwrap().to_owned(), "is the file of --map: choose another file for --record"),
        (path("home.objects.json"), "is the list of objects beside --map: choose another file for --record"),
    ] {
        let ended = live(&recording(), &["--map", &path("home.ply"), "--record", &record]);
        assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{record}: {}", ended.err);
        assert!(ended.err.contains(expected), "{record}: {}", ended.err);
    }
    let ended = live(&recording(), &["--record", &path("rec.bag")]);
    assert!(ended.code == 2 && ended.err.contains("rec.bag: expected a name that ends in .mcap"), "{}", ended.err);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn a_taken_port_is_said_with_the_option_that_chooses_another() {
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let ended = live(&recording(), &[&format!("--view={}", taken.local_addr().unwrap())]);
    assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{}", ended.err);
    assert!(ended.err.contains("another port: --view=127.0.0.1:PORT"), "{}", ended.err);
}

#[test]
fn a_map_in_a_new_folder_is_saved() {
    let folder = tempfile::tempdir().unwrap();
    let map = folder.path().join("new/maps/home.ply");
    let ended = live(&recording(), &["--every-frame", "--map", map.to_str().unwrap()]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    assert!(map.is_file() && map.with_extension("objects.json").is_file());
}

/// A stream with nothing in it ends soon after SIGTERM.
#[cfg(unix)]
#[test]
fn sigterm_ends_it_within_two_seconds() {
    let mut command = stoppable_splatseg();
    let command = command.arg("live").arg(recording()).args(["--speed", "0.01", "--threads", "2"]);
    let mut child = command.stderr(std::process::Stdio::null()).spawn().unwrap();
    std::thread::sleep(Duration::from_secs(1));
    let sent = std::process::Command::new("kill").arg(child.id().to_string()).status().unwrap();
    assert!(sent.success());
    let started = Instant::now();
    let status = child.wait().unwrap();
    assert!(started.elapsed() < Duration::from_secs(2), "{:?}", started.elapsed());
    assert_eq!(status.code(), Some(0));
}

#[test]
fn wrong_names_and_domains_of_a_node_are_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let taken = folder.path().join("taken.mcap");
    fs::write(&taken, "mine").unwrap();
    for (arguments, expected) in [
        (vec!["--domain-id", "102"], "ROS_DOMAIN_ID: found \"102\", expected 0 to 101"),
        (vec!["--discovery-range", "everywhere"], "ROS_AUTOMATIC_DISCOVERY_RANGE: found \"EVERYWHERE\""),
        (vec!["--name", "1a"], "/ 1a: not a namespace and a name"),
        (vec!["--namespace", "robot"], "robot splatseg: not a namespace"),
        (vec!["--stride", "2"], "--stride"),
        (vec!["--method", "fastsam", "--map", "home.ply"], "has no map to save"),
        (vec!["--record", taken.to_str().unwrap()], "exists: choose another file for --record"),
    ] {
        let ended = finish(splatseg().arg("ros2").args(&arguments));
        assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{arguments:?}: {}", ended.err);
        assert!(ended.err.contains(expected), "{arguments:?}: {}", ended.err);
    }
    assert_eq!(fs::read_to_string(&taken).unwrap(), "mine");
}

/// As [`live`], with the size of files limited to `kib` KiB: larger ones fail as on a full disk.
#[cfg(unix)]
fn live_with_small_files(kib: usize, more: &[&str]) -> Ended {
    let mut shell = assert_cmd::Command::new("bash");
    shell.args(["-c", &format!("ulimit -f {kib}; exec \"$@\""), "bash"]);
    shell.arg(assert_cmd::cargo::cargo_bin!("splatseg")).arg("live").arg(recording());
    finish(shell.args(["--every-frame", "--threads", "2", "--world-frame", "map"]).args(more))
}

#[cfg(unix)]
#[test]
fn on_a_full_disk_every_file_that_is_not_there_is_named_and_no_other() {
    let folder = tempfile::tempdir().unwrap();
    let [map, used] = ["home.ply", "used.mcap"].map(|name| folder.path().join(name));
    let options = ["--map", map.to_str().unwrap(), "--record", used.to_str().unwrap(), "--save-interval", "0.1"];
    let ended = live_with_small_files(40, &options);
    assert_eq!(ended.code, 1, "{}", ended.err);
    assert!(ended.err.contains("warning: the map is not saved: ") && ended.err.contains("home.ply"), "{}", ended.err);
    let last = ended.err.lines().last().unwrap();
    assert!(last.starts_with("error: ") && last.contains("home.ply") && last.contains("used.mcap"), "{last}");
    assert!(!ended.out.contains("home") && !ended.out.contains("used"), "{}", ended.out);
    assert!(ended.out.contains("4 frames, "), "{}", ended.out);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "no part of a file is left");
    // An earlier map stays, and is not said to be this one.
    let whole = live(&recording(), &["--every-frame", "--map", map.to_str().unwrap()]);
    assert!(whole.code == 0 && whole.out.contains("map: "), "{}", whole.err);
    let before = fs::read(&map).unwrap();
    let ended = live_with_small_files(40, &options[..2]);
    assert_eq!(ended.code, 1, "{}", ended.err);
    assert!(fs::read(&map).unwrap() == before && !ended.out.contains("map: "), "{}", ended.out);
}
