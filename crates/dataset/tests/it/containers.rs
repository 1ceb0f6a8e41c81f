//! The same messages in MCAP, SQLite and bags of ROS 1, and damage to the latter two.

use crate::support::{damaged, two_ways};
use proptest::prelude::*;
use splatseg_dataset::{DatasetSettings, Format, RecordingScene, RecordingSummary, Scene, open_scene, read_messages};
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// All containers of the messages in `room.mcap`.
const OTHERS: [(&str, Format); 7] = [
    ("room.db3", Format::Db3),
    ("db3_file", Format::Db3),
    ("db3_message", Format::Db3),
    ("db3_split", Format::Db3),
    ("room.bag", Format::Bag),
    ("room_lz4.bag", Format::Bag),
    ("room_bz2.bag", Format::Bag),
];

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/recordings").join(name)
}

fn settings(change: impl FnOnce(&mut DatasetSettings)) -> DatasetSettings {
    DatasetSettings::default().with(|settings| {
        settings.color = Some("/camera/color/image_raw".to_owned());
        // A stream does not use corrected paths.
        settings.corrections = Some("none".to_owned());
        change(settings);
    })
}

/// Returns the messages of a recording that can be read: topic, type, time, and content.
fn messages(path: &Path) -> Vec<(String, String, u128, Vec<u8>)> {
    let mut list = Vec::new();
    read_messages(path, &mut |message| {
        let (topic, type_name) = (message.topic.to_owned(), message.type_name.to_owned());
        list.push((topic, type_name, message.recorded.as_nanos(), message.data.to_owned()));
        Ok(())
    })
    .unwrap();
    list
}

#[test]
fn every_container_has_the_messages_of_the_mcap() {
    let expected = messages(&data("room.mcap"));
    assert_eq!(expected.len(), 53);
    for (name, format) in OTHERS {
        let found = messages(&data(name));
        // Other types than those that are used are not converted.
        let is_read = |message: &&(String, String, u128, Vec<u8>)| format != Format::Bag || message.0 != "/number";
        let expected: Vec<_> = expected.iter().filter(is_read).collect();
        assert_eq!(found.len(), expected.len(), "{name}");
        let mut found = found.iter();
        for message in &expected {
            let same = found.find(|other| other.0 == message.0 && other.2 == message.2).unwrap();
            assert_eq!(same.1, message.1, "{name}: {}", message.0);
            // The end of a message is padded or not.
            let shorter = same.3.len().min(message.3.len());
            assert!(same.3.len().abs_diff(message.3.len()) < 4, "{name}: {}", message.0);
            assert!(same.3[4..shorter] == message.3[4..shorter], "{name}: {}", message.0);
        }
    }
}

/// Corrections are read from files only.
#[test]
fn every_container_has_the_path_of_the_mcap() {
    let settings = settings(|settings| settings.corrections = None);
    let corrections = |name: &str| {
        let scene = RecordingScene::open(&data(name), &settings).unwrap();
        assert!(scene.sources().iter().any(|source| source.starts_with("corrected poses: /path")), "{name}");
        format!("{:?}", scene.corrections(0..4))
    };
    let expected = corrections("room.mcap");
    for (name, _) in OTHERS {
        assert_eq!(corrections(name), expected, "{name}");
    }
}

#[test]
fn every_container_has_the_frames_and_topics_of_the_mcap() {
    let poses = ["/tf", "/odom", "/pose", "/pose_with_covariance", "/transform"];
    for pose in poses {
        let settings = settings(|s| s.pose = Some(pose.to_owned()));
        let expected = two_ways::read_path(&data("room.mcap"), &settings).unwrap();
        assert_eq!(expected.frames.len(), 4);
        for (name, format) in OTHERS {
            let scene = open_scene(data(name), &settings).unwrap();
            assert_eq!((scene.format(), scene.frame_count()), (Some(format), 4), "{name}");
            let found = two_ways::read_path(&data(name), &settings).unwrap();
            assert!(found.frames == expected.frames, "{name}, {pose}: frames or poses differ");
            assert_eq!((found.sources, found.warnings), (expected.sources.clone(), expected.warnings.clone()));
        }
    }
    let png = settings(|s| s.color = Some("/camera/color/image_raw/compressed".to_owned()));
    let expected = two_ways::read_path(&data("room.mcap"), &png).unwrap();
    for (name, _) in OTHERS {
        let found = two_ways::read_path(&data(name), &png).unwrap();
        assert!(found.frames == expected.frames && found.sources == expected.sources, "{name}");
    }
}

#[test]
fn summaries_name_container_compression_and_topics() {
    let topics = |name: &str| -> Vec<(String, String, String, u64)> {
        let summary = RecordingSummary::read(&data(name), &settings(|_| {})).unwrap();
        assert!(summary.damage.is_empty() && summary.scene.is_ok(), "{name}: {:?}", summary.damage);
        let topics = summary.topics.into_iter();
        // Messages of ROS 1 are converted if their type is used.
        let encoding = |encoding: String| if encoding == "ros1" { "cdr".to_owned() } else { encoding };
        let facts = topics.map(|topic| (topic.name, topic.type_name, encoding(topic.encoding), topic.messages));
        facts.collect()
    };
    let expected = topics("room.mcap");
    for name in ["room.db3", "db3_file", "db3_message", "room.bag", "room_lz4.bag", "room_bz2.bag"] {
        assert_eq!(topics(name), expected, "{name}");
    }
    for (name, title, compression, files) in [
        ("room.mcap", "MCAP", None, 1),
        ("room.db3", "SQLite of rosbag2", None, 1),
        ("db3_file", "SQLite of rosbag2", Some("zstd, each file"), 1),
        ("db3_message", "SQLite of rosbag2", Some("zstd, each message"), 1),
        ("db3_split", "SQLite of rosbag2", None, 2),
        ("room.bag", "bag of ROS 1", None, 1),
    ] {
        let summary = RecordingSummary::read(&data(name), &settings(|_| {})).unwrap();
        assert_eq!((summary.title, summary.compression, summary.files), (title, compression, files), "{name}");
    }
}

#[test]
fn what_is_no_recording_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let error = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        fs::write(&path, bytes).unwrap();
        let error = open_scene(&path, &DatasetSettings::default()).unwrap_err().to_string();
        error.replace(&path.display().to_string(), name)
    };
    assert_eq!(
        error("a.bag", b"#ROSBAG V1.2\n"),
        "a.bag: first bytes: found \"#ROSBAG V1.2\\\\n\", expected \"#ROSBAG V2.0\\\\n\", the start of every bag of ROS 1"
    );
    assert!(error("a.bag", b"").starts_with("a.bag: first bytes: found an empty file, expected "));
    assert!(error("a.db3", b"").starts_with("a.db3: first bytes: found an empty file, expected \"SQLite format 3"));
    assert!(error("a.db3", &[7; 200]).starts_with("a.db3: first bytes: found "));
    let mut other = fs::read(data("room.db3")).unwrap();
    replace_all(&mut other, b"messages", b"massages");
    assert_eq!(
        error("b.db3", &other),
        "b.db3: tables: found schema, metadata, topics, message_definitions, massages, expected topics and messages, as \
         rosbag2 writes them"
    );
    let mut other = fs::read(data("room.db3")).unwrap();
    replace_all(&mut other, b"timestamp INTEGER", b"timestump INTEGER");
    let text = error("c.db3", &other);
    assert!(
        text.starts_with("c.db3: columns of the table messages: found id, topic_id, timestump, data, exp"),
        "{text}"
    );
}

fn replace_all(bytes: &mut [u8], from: &[u8], to: &[u8]) {
    for at in 0..bytes.len() - from.len() {
        if bytes[at..].starts_with(from) {
            bytes[at..at + from.len()].copy_from_slice(to);
        }
    }
}

/// Returns the damage to a recording of these bytes, and its number of frames or the error.
fn read(ending: &str, bytes: &[u8]) -> (Vec<String>, Result<usize, String>) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(format!("a.{ending}"));
    fs::write(&path, bytes).unwrap();
    let without = |text: String| text.replace(&path.display().to_string(), "a");
    let settings = settings(|settings| settings.pose = Some("/pose".to_owned()));
    match RecordingSummary::read(&path, &settings) {
        Ok(summary) => {
            let frames = summary.scene.map(|frames| frames.count).map_err(|error| without(error.to_string()));
            if frames.is_ok() {
                let scene = RecordingScene::open(&path, &settings).unwrap();
                (0..scene.frame_count()).for_each(|index| _ = scene.read_frame(index));
            }
            (summary.damage.into_iter().map(without).collect(), frames)
        }
        Err(error) => (Vec::new(), Err(without(error.to_string()))),
    }
}

/// Returns the offsets at which the records of a bag begin, outside compressed chunks.
fn borders(bag: &[u8]) -> Vec<usize> {
    let length = |at: usize| u32::from_le_bytes(bag[at..at + 4].try_into().unwrap()) as usize;
    let (mut at, mut borders) = (13, Vec::new());
    while at < bag.len() {
        borders.push(at);
        let data = at + 4 + length(at);
        let is_plain_chunk = bag[at..data].windows(16).any(|part| part == b"compression=none");
        at = if is_plain_chunk { data + 4 } else { data + 4 + length(data) };
    }
    borders
}

#[test]
fn a_bag_that_was_cut_off_is_read_up_to_its_end() {
    for name in ["room.bag", "room_lz4.bag", "room_bz2.bag"] {
        let bytes = fs::read(data(name)).unwrap();
        assert_eq!(read("bag", &bytes), (vec![], Ok(4)), "{name}");
        let mut counts = Vec::new();
        for border in borders(&bytes) {
            for cut in [border, border + 1, border + 7] {
                let (told, frames) = read("bag", &bytes[..cut.min(bytes.len())]);
                if cut > border {
                    let line = told.first().unwrap();
                    assert!(line.starts_with("a: the recording was not finished: the record at byte "), "{line}");
                }
                counts.extend(frames.ok());
            }
        }
        assert!(counts.is_sorted() && counts.contains(&4), "{name}: {counts:?}");
        assert!(name != "room.bag" || [1, 2, 3].iter().all(|count| counts.contains(count)), "{counts:?}");
    }
}

#[test]
fn a_bag_without_an_index_is_read() {
    let mut bytes = fs::read(data("room.bag")).unwrap();
    let at = bytes.windows(10).position(|part| part == b"index_pos=").unwrap() + 10;
    bytes[at..at + 8].fill(0);
    let line = "a: the recording was not closed: it is read without an index".to_owned();
    assert_eq!(read("bag", &bytes), (vec![line.clone()], Ok(4)));
    // As it is while it is recorded: the last chunk's length is not known, and nothing follows.
    let chunks: Vec<usize> = borders(&bytes)
        .into_iter()
        .filter(|at| bytes[at + 4..].windows(16).next().is_some() && is_chunk(&bytes, *at))
        .collect();
    let last = *chunks.last().unwrap();
    let data_at = last + 4 + u32::from_le_bytes(bytes[last..last + 4].try_into().unwrap()) as usize;
    let length = u32::from_le_bytes(bytes[data_at..data_at + 4].try_into().unwrap()) as usize;
    bytes.truncate(data_at + 4 + length);
    bytes[data_at..data_at + 4].fill(0);
    assert_eq!(read("bag", &bytes), (vec![line], Ok(4)));
}

fn is_chunk(bag: &[u8], at: usize) -> bool {
    let length = u32::from_le_bytes(bag[at..at + 4].try_into().unwrap()) as usize;
    bag[at + 4..at + 4 + length].windows(16).any(|part| part == b"compression=none")
}

#[test]
fn a_damaged_chunk_loses_only_its_messages() {
    let mut bytes = fs::read(data("room_lz4.bag")).unwrap();
    let chunk = bytes.windows(15).position(|part| part == b"compression=lz4").unwrap();
    bytes[chunk + 200..chunk + 260].fill(0xA5);
    let (told, frames) = read("bag", &bytes);
    assert!(told[0].starts_with("a: the chunk at byte 4109 is damaged and left out: damaged lz4 data"), "{told:?}");
    // It also held the topics, which the index repeats.
    assert!(told.len() == 1 && frames.as_ref().is_ok_and(|count| (1..4).contains(count)), "{told:?} {frames:?}");
    let mut unknown = fs::read(data("room_bz2.bag")).unwrap();
    replace_all(&mut unknown, b"compression=bz2", b"compression=zip");
    let (told, frames) = read("bag", &unknown);
    assert!(told[0].ends_with("the compression \"zip\" is not supported, only lz4 and bz2 are"), "{told:?}");
    assert!(told[1].ends_with("more chunks or records are damaged") && frames.is_err(), "{told:?}");
}

#[test]
fn a_database_that_was_cut_off_is_read_up_to_its_end() {
    let bytes = fs::read(data("room.db3")).unwrap();
    assert_eq!(read("db3", &bytes), (vec![], Ok(4)));
    let pages = bytes.len() / 4096;
    let mut most = 0;
    for page in 1..pages {
        for more in [0, 1, 2000] {
            let (told, frames) = read("db3", &bytes[..page * 4096 + more]);
            let line = format!("a: the recording is cut off: its header states {pages} pages, but the file has {page}");
            match frames {
                // What holds the tables is missing.
                Err(error) if told.is_empty() => assert!(error.starts_with("a: "), "{error}"),
                frames => {
                    assert_eq!(told[0], line);
                    most = most.max(frames.unwrap_or_default());
                }
            }
        }
    }
    assert!((1..=4).contains(&most), "{most}");
}

#[test]
fn a_log_beside_a_database_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.db3");
    fs::copy(data("room.db3"), &path).unwrap();
    fs::write(folder.path().join("a.db3-wal"), b"").unwrap();
    let damage = || RecordingSummary::read(&path, &settings(|_| {})).unwrap().damage;
    assert_eq!(damage(), [""; 0], "an empty log");
    fs::write(folder.path().join("a.db3-wal"), [7; 100]).unwrap();
    let told = damage().concat();
    assert!(told.contains("the log beside it with its last messages (a.db3-wal) cannot be read"), "{told}");
}

/// Writes `killed.db3` with its log into a folder, as a recorder leaves them, and versions of it whose log is cut off or
/// damaged. Prints how many messages SQLite finds in each.
const KILLED: &str = r#"
import os, shutil, sqlite3, sys
room, folder = sys.argv[1:]
os.chdir(folder)
source = sqlite3.connect(room)
tables = dict(source.execute("select name, sql from sqlite_master where type = 'table'"))
rows = {name: source.execute(f"select * from {name}").fetchall() for name in tables}
recorder = sqlite3.connect("open.db3", isolation_level=None)
recorder.execute("pragma page_size = 1024")
recorder.execute("pragma journal_mode = wal")
recorder.execute("pragma wal_autocheckpoint = 0")
def insert(name, part):
    for row in part:
        recorder.execute(f"insert into {name} values ({', '.join('?' * len(row))})", row)
for name, statement in tables.items():
    recorder.execute(statement)
for name in set(rows) - {"messages"}:
    insert(name, rows[name])
messages, third = rows["messages"], len(rows["messages"]) // 3
for start in range(0, len(messages), 2):
    if start // 2 == third // 2:
        recorder.execute("pragma wal_checkpoint(restart)")
    recorder.execute("begin")
    insert("messages", messages[start:start + 2])
    recorder.execute("commit")
shutil.copy("open.db3", "killed.db3")
shutil.copy("open.db3-wal", "killed.db3-wal")
log = open("killed.db3-wal", "rb").read()
for number in range(40):
    name = f"damaged{number}.db3"
    shutil.copy("killed.db3", name)
    place = len(log) * number // 40
    changed = log[:place] if number % 2 else log[:place] + bytes([log[place] ^ 1]) + log[place + 1:]
    open(name + "-wal", "wb").write(changed)
for name in ["killed.db3"] + [f"damaged{number}.db3" for number in range(40)]:
    for ending in ["", "-wal"]:
        shutil.copy(name + ending, "peer.db3" + ending)
    peer = sqlite3.connect("peer.db3")
    print(name, peer.execute("select count(*) from messages").fetchone()[0])
    peer.close()
    for ending in ["", "-wal", "-shm"]:
        if os.path.exists("peer.db3" + ending):
            os.remove("peer.db3" + ending)
"#;

#[test]
fn the_log_of_a_killed_recorder_is_read_as_sqlite_does() {
    let test = "the_log_of_a_killed_recorder_is_read_as_sqlite_does";
    let folder = tempfile::tempdir().unwrap();
    let (room, path) = (fs::canonicalize(data("room.db3")).unwrap(), folder.path().join("killed.db3"));
    let Ok(python) = Command::new("python3").args(["-c", KILLED]).arg(room).arg(folder.path()).output() else {
        splatseg_test_scenes::skipped(test, "there is no python3");
        return;
    };
    assert!(python.status.success(), "{}", String::from_utf8_lossy(&python.stderr));
    let expected = messages(&data("room.db3"));
    assert_eq!(messages(&path), expected);
    assert_eq!(RecordingSummary::read(&path, &settings(|_| {})).unwrap().damage, [""; 0]);
    let whole = two_ways::read_path(&data("room.db3"), &settings(|_| {})).unwrap();
    assert_eq!(two_ways::read_path(&path, &settings(|_| {})).unwrap().frames, whole.frames);
    let mut counts = BTreeSet::new();
    for line in String::from_utf8(python.stdout).unwrap().lines() {
        let (name, count) = line.split_once(' ').unwrap();
        let found = messages(&folder.path().join(name));
        assert_eq!(found.len().to_string(), count, "{name}");
        assert!(found == expected[..found.len()], "{name}");
        counts.insert(found.len());
    }
    assert!(counts.len() > 10, "{counts:?}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// Damaged recordings are read or refused in one line that names them, without a panic.
    #[test]
    fn damaged_recordings_are_read_or_refused(
        container in 0usize..4,
        changes in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..12),
        keep in any::<prop::sample::Index>(),
    ) {
        let (name, ending) = [
            ("room.bag", "bag"), ("room_bz2.bag", "bag"), ("realsense_2.59.db3", "db3"), ("db3_message/db3_message.db3", "db3"),
        ][container];
        let (told, frames) = read(ending, &damaged(fs::read(data(name)).unwrap(), &changes, &keep));
        for line in told.iter().chain(frames.as_ref().err()) {
            prop_assert!(!line.contains('\n') && line.contains("a: "), "{line}");
        }
    }
}

/// Recordings of a whole scene, written by `tools/make_bag_test_data.py --scene`.
#[test]
fn recordings_of_a_scene_have_its_frames() {
    let test = "recordings_of_a_scene_have_its_frames";
    let variable = |name: &str| std::env::var_os(name).map(PathBuf::from);
    let (Some(recordings), Some(folder)) = (variable("SPLATSEG_RECORDINGS"), variable("SPLATSEG_SCENE")) else {
        splatseg_test_scenes::skipped(test, "SPLATSEG_RECORDINGS and SPLATSEG_SCENE are not set");
        return;
    };
    let scene = open_scene(folder, &DatasetSettings::default()).unwrap();
    for name in ["kitchen.mcap", "kitchen.db3", "kitchen.bag"] {
        let recorded = open_scene(recordings.join(name), &DatasetSettings::default()).unwrap();
        assert_eq!(recorded.frame_count(), scene.frame_count(), "{name}");
        for index in 0..scene.frame_count() {
            let (found, expected) = (recorded.read_frame(index).unwrap(), scene.read_frame(index).unwrap());
            assert!(found.color() == expected.color() && found.depth() == expected.depth(), "{name}: frame {index}");
            let (found, expected) = (found.world_from_camera().to_matrix(), expected.world_from_camera().to_matrix());
            assert!(found.abs_diff_eq(expected, 1e-6), "{name}: frame {index}: {found} {expected}");
        }
    }
}
