//! `splatseg inspect drive.mcap`, `.db3`, `.bag` or a Kinect's `.mkv`: shows the topics, and the ones that a run would use.

use super::{InspectArguments, print_json};
use crate::Failure;
use crate::terminal::counted;
use serde_json::{Value, json};
use splatseg_dataset::{RecordingSummary, RecordingTopic};
use std::time::Duration;

/// Maximum number of topics listed. A recording may claim to have tens of thousands.
const LISTED: usize = 200;

/// Prints the contents of a recording.
pub fn inspect(arguments: &InspectArguments) -> Result<(), Failure> {
    arguments.refuse_checkpoint_options("a recording")?;
    let summary = RecordingSummary::read(&arguments.file, &arguments.topics.settings(&arguments.camera)?)
        .map_err(Failure::input)?;
    if arguments.json {
        print_json(&described(&summary))?;
        return summary.scene.map(|_| ()).map_err(Failure::input);
    }
    say!("file           {}", summary.path.display());
    let files = if summary.files == 1 { String::new() } else { format!(" in {} files", summary.files) };
    let compression = summary.compression.map_or_else(String::new, |how| format!(", compressed ({how})"));
    say!("kind           {}{files}{compression}", summary.title);
    if let Some(camera) = &summary.camera {
        say!("camera         {camera}");
    }
    print_times(&summary.topics);
    say!("topics         {}", summary.topics.len());
    for topic in summary.topics.iter().take(LISTED) {
        print_topic(topic);
    }
    if summary.topics.len() > LISTED {
        say!("  … and {} more", summary.topics.len() - LISTED);
    }
    for line in &summary.damage {
        say!("damaged        {line}");
    }
    match summary.scene {
        Ok(frames) => {
            say!("frames         {}", frames.count);
            frames.sources.iter().for_each(|source| say!("  {source}"));
            for kind in frames.without_pose {
                say!("  no pose: {} {}", counted(kind.count, "frame"), kind.what);
            }
            for kind in frames.left_out {
                say!("  left out: {} {}", counted(kind.count, "frame"), kind.what);
            }
            Ok(())
        }
        Err(error) => {
            say!("frames         none");
            Err(Failure::input(error))
        }
    }
}

/// The content of `--json`.
fn described(summary: &RecordingSummary) -> Value {
    let topic = |topic: &RecordingTopic| {
        json!({
            "name": topic.name,
            "type": topic.type_name,
            "messages": topic.messages,
            "first_s": topic.recorded.map(|(first, _)| first.as_secs_f64()),
            "last_s": topic.recorded.map(|(_, last)| last.as_secs_f64()),
            "unreadable": topic.unreadable.as_ref().map_or(0, |(count, _)| *count),
        })
    };
    let frames = summary.scene.as_ref().ok();
    json!({
        "file": summary.path,
        "kind": "recording",
        "format": summary.format.name(),
        "files": summary.files,
        "compression": summary.compression,
        "camera": summary.camera,
        "topics": summary.topics.iter().map(topic).collect::<Vec<_>>(),
        "damage": summary.damage,
        "frames": frames.map_or(0, |frames| frames.count),
        "sources": frames.map(|frames| &frames.sources),
        "error": summary.scene.as_ref().err().map(ToString::to_string),
    })
}

fn print_times(topics: &[RecordingTopic]) {
    let times = || topics.iter().filter_map(|topic| topic.recorded);
    let (Some(first), Some(last)) = (times().map(|(first, _)| first).min(), times().map(|(_, last)| last).max()) else {
        return;
    };
    say!("recorded       {} to {}, {:.1} s", time(first), time(last), (last.saturating_sub(first)).as_secs_f64());
}

fn print_topic(topic: &RecordingTopic) {
    let kind = if topic.type_name.is_empty() { "unknown type" } else { &topic.type_name };
    let mut text = format!("  {} {kind}", topic.name);
    if topic.encoding != "cdr" {
        text += &format!(", encoding {:?}", topic.encoding);
    }
    text += &format!(", {}", counted(usize::try_from(topic.messages).unwrap_or(usize::MAX), "message"));
    if let Some((first, last)) = topic.recorded {
        let seconds = last.saturating_sub(first).as_secs_f64();
        text += &format!(" in {seconds:.1} s");
        if seconds > 0.0 && topic.messages > 1 {
            text += &format!(" ({:.1} Hz)", (topic.messages - 1) as f64 / seconds);
        }
    }
    if let Some((encoding, frame)) = &topic.images {
        text += &format!(", {encoding}, frame {frame}");
    }
    if let Some((count, first)) = &topic.unreadable {
        text += &format!(", {count} unreadable: {first}");
    }
    say!("{}", text.replace('\n', " "));
}

/// Seconds since the Unix epoch.
fn time(at: Duration) -> String {
    format!("{}.{:03} s", at.as_secs(), at.subsec_millis())
}
