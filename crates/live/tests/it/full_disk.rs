//! A recording on a disk that is full: in a process of its own, whose files are limited in size.

use splatseg::Pipeline;
use splatseg_dataset::{DatasetSettings, MatchLimits, read_messages};
use splatseg_live::{BuildPipeline, LiveOptions, LiveSession, LiveStream, Outlet, Silent};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// Set in the process with small files.
const FOLDER: &str = "SPLATSEG_TEST_FULL_DISK";
/// Largest size of a file there, KiB.
const LARGEST: u64 = 3000;
/// Size of a message.
const MESSAGE_BYTES: usize = 400_000;

#[test]
fn a_recording_keeps_what_there_was_room_for_and_says_so_at_once() {
    if let Some(folder) = std::env::var_os(FOLDER) {
        return record_on_a_full_disk(Path::new(&folder));
    }
    let folder = tempfile::tempdir().unwrap();
    let mut shell = std::process::Command::new("bash");
    // Too large a file is an error of writing, not the end of the process.
    shell.args(["-c", &format!("trap '' XFSZ; ulimit -f {LARGEST}; exec \"$@\""), "bash"]);
    shell.arg(std::env::current_exe().unwrap()).env(FOLDER, folder.path());
    let ended = shell.args(["--exact", "full_disk::a_recording_keeps_what_there_was_room_for_and_says_so_at_once"]);
    let ended = ended.output().unwrap();
    let text = String::from_utf8_lossy(&ended.stdout);
    assert!(ended.status.success() && text.contains("1 passed"), "{text}");
}

fn record_on_a_full_disk(folder: &Path) {
    let path = folder.join("used.mcap");
    let stream = Arc::new(LiveStream::new(&DatasetSettings::default(), MatchLimits::default()).unwrap());
    stream.record(&path).unwrap();
    let mut fed = 0;
    while stream.recording_problem().is_none() && fed < 20 {
        assert!(!path.exists(), "after {fed} messages");
        // Nonsense of a type that is recorded.
        stream.feed_at(("/tf", "tf2_msgs/msg/TFMessage"), &vec![fed; MESSAGE_BYTES], Duration::from_secs(1));
        fed += 1;
    }
    let problem = stream.recording_problem().unwrap();
    assert!(fed < 13, "{fed} messages of {MESSAGE_BYTES} bytes, and {LARGEST} KiB");
    // Chunks of three messages.
    assert!(problem.contains("used.mcap: the recording ends early, with 6 messages: "), "{problem}");
    // It is there, and stays as it is.
    let written = std::fs::read(&path).unwrap();
    stream.feed_at(("/tf", "tf2_msgs/msg/TFMessage"), &[fed; 9], Duration::from_secs(2));
    let mut read = Vec::new();
    read_messages(&path, &mut |message| {
        assert_eq!((message.topic, message.data.len()), ("/tf", MESSAGE_BYTES));
        read.push(message.data[7]);
        Ok(())
    })
    .unwrap();
    assert_eq!(read, [0, 1, 2, 3, 4, 5]);

    let build: BuildPipeline = Box::new(|_| Pipeline::builder(&splatseg::Settings::default()).build());
    let ends: (_, Box<dyn Outlet>) = (Arc::clone(&stream), Box::new(Silent));
    let mut session = LiveSession::new(build, None, ends, LiveOptions::default()).unwrap();
    session.run(&mut || true).unwrap();
    assert_eq!(session.status().problems(), [problem.as_str()]);
    assert_eq!(stream.finish_recording().unwrap_err().to_string(), problem);
    assert!(std::fs::read(&path).unwrap() == written);
    assert_eq!(std::fs::read_dir(folder).unwrap().count(), 1, "no other part of it is left");
}
