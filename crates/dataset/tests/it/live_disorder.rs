//! Streams in any disorder: what is fed is counted once, memory is bounded, and time goes back only with the clock.

use crate::messages::{Received, messages};
use crate::support;
use crate::support::mcap::{FRAME_NS, McapWriter, OPTICAL, START, header, transform, write_frames};
use crate::support::recording::recording;
use proptest::prelude::*;
use splatseg_dataset::{DatasetSettings, FrameMatcher, MatchLimits};
use splatseg_geometry::RgbdFrame;
use splatseg_ros::{Odometry, TfMessage, TransformStamped, to_cdr};
use std::sync::OnceLock;
use std::time::Duration;

const LIMITS: MatchLimits = MatchLimits {
    settle: Duration::from_millis(500),
    waiting: 6,
    complete: 2,
    bytes: 20_000,
    pair_wait: Duration::from_millis(50),
    pose_wait: Duration::from_millis(300),
};

/// Messages of 40 frames of a camera with poses in `/tf`.
fn stream() -> &'static [Received] {
    static STREAM: OnceLock<Vec<Received>> = OnceLock::new();
    STREAM.get_or_init(|| {
        let frames = recording("synthetic:frames=40,width=16,height=12,seed=3");
        let frames: Vec<&RgbdFrame> = frames.iter().map(|(frame, _)| frame).collect();
        let mut writer = McapWriter::new();
        write_frames(&mut writer, &frames, support::mcap::ALL);
        messages(&writer.finish())
    })
}

/// Adds nanoseconds to the stamp of a message with a header, or of the only transform.
fn shift_stamp(message: &mut Received, by: i64) {
    let at = if message.type_name.ends_with("TFMessage") { 8 } else { 4 };
    let seconds = i32::from_le_bytes(message.data[at..at + 4].try_into().unwrap());
    let seconds = seconds.wrapping_add((by / 1_000_000_000) as i32);
    message.data[at..at + 4].copy_from_slice(&seconds.to_le_bytes());
}

fn named() -> DatasetSettings {
    DatasetSettings::default().with(|s| {
        s.color = Some("/camera/image_raw/compressed".to_owned());
        s.depth = Some("/camera/depth".to_owned());
        s.world_frame = Some("world".to_owned());
    })
}

/// Checks what holds for any stream. `last` is the stamp of the last frame, and how often the clock had been set back.
fn check(
    matcher: &mut FrameMatcher,
    last: &mut Option<(i64, u64)>,
    take: Option<Duration>,
) -> Result<(), TestCaseError> {
    if let Some(frame) = take.and_then(|at| matcher.take(at)) {
        let (stamp, set_back) = (frame.stamp(), matcher.counts().clock_set_back);
        if let Some((before, set_back_before)) = *last {
            prop_assert!(stamp > before || set_back > set_back_before, "{stamp} after {before}");
        }
        *last = Some((stamp, set_back));
        let _ = frame.read();
    }
    let counts = matcher.counts();
    prop_assert_eq!(counts.messages, counts.images + counts.taken_in + counts.ignored + counts.damaged);
    let frames = counts.frames + counts.unreadable;
    prop_assert_eq!(counts.images, 2 * frames + counts.dropped.total() + counts.waiting, "{:?}", counts);
    let limits = LIMITS;
    let most = 2 * (limits.waiting + 3) + 2 * limits.waiting + 2 * limits.complete;
    prop_assert!(counts.waiting <= most as u64, "{:?}", counts);
    Ok(())
}

/// A change of a message: its place, how much later it comes, how often, and how its stamp is changed, seconds.
#[derive(Clone, Debug)]
struct Change {
    at: prop::sample::Index,
    later: usize,
    copies: usize,
    seconds: i64,
}

fn change() -> impl Strategy<Value = Change> {
    let seconds = prop_oneof![4 => Just(0i64), 1 => -20i64..20, 1 => Just(i64::from(i32::MAX / 2))];
    (any::<prop::sample::Index>(), 0usize..30, 0usize..3, seconds).prop_map(|(at, later, copies, seconds)| Change {
        at,
        later,
        copies,
        seconds,
    })
}

fn disordered(changes: &[Change], steps: &[(prop::sample::Index, i64)]) -> Vec<Received> {
    let mut keyed: Vec<(usize, Received)> = stream().iter().cloned().enumerate().collect();
    let count = keyed.len();
    for (from, seconds) in steps {
        let from = from.index(count);
        keyed[from..].iter_mut().for_each(|(_, message)| shift_stamp(message, seconds * 1_000_000_000));
    }
    for Change { at, later, copies, seconds } in changes {
        let (key, mut message) = keyed[at.index(count)].clone();
        shift_stamp(&mut message, seconds * 1_000_000_000);
        keyed[at.index(count)].0 = if *copies == 0 { key + later } else { key };
        keyed.extend((0..*copies).map(|copy| (key + later * copy, message.clone())));
    }
    keyed.sort_by_key(|(key, _)| *key);
    keyed.into_iter().map(|(_, message)| message).collect()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    #[test]
    fn late_reordered_and_repeated_messages_and_clock_steps(
        changes in prop::collection::vec(change(), 0..60),
        steps in prop::collection::vec((any::<prop::sample::Index>(), -30i64..30), 0..4),
        take_every in 1usize..30,
        is_named in any::<bool>(),
    ) {
        let settings = if is_named { named() } else { DatasetSettings::default() };
        let mut matcher = FrameMatcher::new(&settings, LIMITS).unwrap();
        let mut last = None;
        for (number, message) in disordered(&changes, &steps).iter().enumerate() {
            matcher.feed(&message.topic, &message.type_name, &message.data, message.at);
            check(&mut matcher, &mut last, (number % take_every == 0).then_some(message.at))?;
        }
        matcher.flush();
        for _ in 0..=LIMITS.complete {
            check(&mut matcher, &mut last, Some(Duration::ZERO))?;
        }
        prop_assert_eq!(matcher.counts().waiting, 0);
    }

    #[test]
    fn any_bytes_on_any_topic_are_counted(
        damage in prop::collection::vec(
            (any::<prop::sample::Index>(), prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6)), 0..60),
        noise in prop::collection::vec(
            (0usize..TYPES.len(), prop::collection::vec(any::<u8>(), 0..200), any::<prop::sample::Index>(), any::<bool>()), 0..60),
    ) {
        let mut all = stream().to_vec();
        for (at, changes) in &damage {
            let index = at.index(all.len());
            let data = &mut all[index].data;
            changes.iter().for_each(|(place, value)| { let place = place.index(data.len()); data[place] = *value; });
        }
        for (kind, bytes, at, is_plain) in &noise {
            let (topic, type_name) = TYPES[*kind];
            let mut data = bytes.clone();
            if *is_plain && data.len() > 1 {
                data[..2].copy_from_slice(&[0, 1]);
            }
            let index = at.index(all.len());
            let received = all[index].at;
            all.insert(index, Received { topic: topic.to_owned(), type_name: type_name.to_owned(), data, at: received });
        }
        let mut matcher = FrameMatcher::new(&named(), LIMITS).unwrap();
        let mut last = None;
        for message in &all {
            matcher.feed(&message.topic, &message.type_name, &message.data, message.at);
            check(&mut matcher, &mut last, Some(message.at))?;
        }
        matcher.flush();
        check(&mut matcher, &mut last, Some(Duration::ZERO))?;
    }
}

const TYPES: [(&str, &str); 10] = [
    ("/camera/image_raw/compressed", "sensor_msgs/msg/CompressedImage"),
    ("/camera/depth", "sensor_msgs/msg/Image"),
    ("/camera/camera_info", "sensor_msgs/msg/CameraInfo"),
    ("/tf", "tf2_msgs/msg/TFMessage"),
    ("/tf_static", "tf2_msgs/msg/TFMessage"),
    ("/odom", "nav_msgs/msg/Odometry"),
    ("/pose", "geometry_msgs/msg/PoseStamped"),
    ("/pose2", "geometry_msgs/msg/PoseWithCovarianceStamped"),
    ("/transform", "geometry_msgs/msg/TransformStamped"),
    ("/path", "nav_msgs/msg/Path"),
];

#[test]
fn endless_topics_frames_and_poses_are_bounded() {
    let mut matcher = FrameMatcher::new(&DatasetSettings::default(), LIMITS).unwrap();
    let received = Duration::from_secs(1_700_000_000);
    let depth = &stream().iter().find(|message| message.topic == "/camera/depth").unwrap().data;
    for index in 0..2_000 {
        matcher.feed(&format!("/camera{index}/depth"), "sensor_msgs/msg/Image", depth, received);
    }
    let counts = matcher.counts();
    assert_eq!((counts.ignored, counts.images), (2_000 - 256, 256));
    assert!(counts.waiting as usize * depth.len() <= LIMITS.bytes && counts.dropped.memory > 0, "{counts}");
    let mut matcher = FrameMatcher::new(&DatasetSettings::default(), LIMITS).unwrap();
    for index in 0..20_000 {
        let stamp = START + index * FRAME_NS / 100;
        let odometry = Odometry { header: header(stamp, "odom"), ..Odometry::default() };
        matcher.feed("/odom", "nav_msgs/msg/Odometry", &to_cdr(&odometry).unwrap(), received);
        let tf = transform(stamp, "base", &format!("{index}"), glam::DVec3::ZERO, glam::DQuat::IDENTITY);
        matcher.feed("/tf", "tf2_msgs/msg/TFMessage", &to_cdr(&tf).unwrap(), received);
    }
    // Two copies of one transform more than fit in a message.
    let many = vec![TransformStamped { child_frame_id: OPTICAL.repeat(100), ..Default::default() }; 600];
    let many = to_cdr(&TfMessage { transforms: many }).unwrap();
    matcher.feed("/tf", "tf2_msgs/msg/TFMessage", &many, received);
    assert_eq!((matcher.counts().taken_in, matcher.counts().damaged), (40_000, 1));
    assert!(format!("{matcher:?}").len() < 4_000_000, "the history is limited");
}
