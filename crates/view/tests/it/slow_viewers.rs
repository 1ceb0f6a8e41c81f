//! Viewers that stop reading: they delay nobody.

use crate::client::{BINARY, PATIENCE, PING, PONG, TEXT, WebSocket, frame, pose_at, start, wait_until};
use splatseg_ros::PoseStamped;
use splatseg_view::{Channel, ViewLimits};
use std::thread;
use std::time::{Duration, Instant};

const FRAMES: usize = 80;
const INTERVAL: Duration = Duration::from_millis(25);

/// Numbers of the frames that a page receives, up to the last one.
fn watch(mut page: WebSocket) -> Vec<u64> {
    let mut numbers = Vec::new();
    while numbers.last() != Some(&(FRAMES as u64 - 1)) {
        let Some((header, _)) = page.page_message("frame") else { break };
        numbers.push(header["number"].as_u64().unwrap());
    }
    numbers
}

#[test]
fn one_of_ten_viewers_stops_reading() {
    // Whoever waited for the stopped viewer would wait until the test gives up.
    let server = start(ViewLimits { viewer_time: 6 * PATIENCE, ..ViewLimits::default() });
    let stopped = WebSocket::page(&server);
    let readers: Vec<WebSocket> = (0..9).map(|_| WebSocket::page(&server)).collect();
    wait_until("all are counted", || server.viewers() == 10);
    let readers: Vec<_> = readers.into_iter().map(|page| thread::spawn(move || watch(page))).collect();
    let start = Instant::now();
    for number in 0..FRAMES {
        server.publish_frame(Some(&pose_at(number as f64, 0.0, 0.0)), || frame(number, 320, 240));
        thread::sleep(INTERVAL);
    }
    for reader in readers {
        let numbers = reader.join().unwrap();
        assert!(numbers.is_sorted_by(|earlier, later| earlier < later), "{numbers:?}");
        assert_eq!(numbers.last(), Some(&(FRAMES as u64 - 1)), "the last frame arrives");
        assert!(numbers.len() > FRAMES / 4, "only {} of {FRAMES} frames", numbers.len());
    }
    assert!(start.elapsed() < 3 * PATIENCE, "{:?}", start.elapsed());
    // The readers have left by themselves.
    assert!(server.viewers() >= 1 && server.counts().viewers_dropped == 0, "the stopped viewer is still there");
    assert!(server.counts().frames_dropped > 0, "frames for the stopped viewer are counted");
    drop(stopped);
}

#[test]
fn a_foxglove_viewer_that_stops_reading_loses_older_messages_and_then_its_connection() {
    let server = start(ViewLimits { viewer_time: Duration::from_secs(1), ..ViewLimits::default() });
    let channel = server.add_channel(Channel::of::<PoseStamped>("/large"));
    let subscription = br#"{"op":"subscribe","subscriptions":[{"id":1,"channelId":1}]}"#;
    let mut stopped = WebSocket::open(&server, "foxglove.sdk.v1").0;
    stopped.send(TEXT, subscription);
    wait_until("the subscription is known", || server.wants_message(channel));
    for time in 0..120 {
        server.publish_message(channel, vec![1; 1 << 20], time);
    }
    assert!(server.counts().messages_dropped > 0);
    wait_until("the stopped viewer is disconnected", || server.viewers() == 0);
    assert_eq!(server.counts().viewers_dropped, 1);
    assert!(!server.wants_message(channel));
    // Another one is served.
    let mut reader = WebSocket::open(&server, "foxglove.sdk.v1").0;
    reader.send(TEXT, subscription);
    wait_until("the subscription is known", || server.wants_message(channel));
    server.publish_message(channel, vec![9], 500);
    while reader.next().unwrap() != (BINARY, [&[1, 1, 0, 0, 0], &500_u64.to_le_bytes()[..], &[9]].concat()) {}
}

#[test]
fn a_foxglove_viewer_that_was_slow_goes_on_with_the_newest_message() {
    const MESSAGES: u64 = 40;
    let server = start(ViewLimits { viewer_time: 6 * PATIENCE, ..ViewLimits::default() });
    let channel = server.add_channel(Channel::of::<PoseStamped>("/large"));
    let mut slow = WebSocket::open(&server, "foxglove.sdk.v1").0;
    slow.send(TEXT, br#"{"op":"subscribe","subscriptions":[{"id":1,"channelId":1}]}"#);
    wait_until("the subscription is known", || server.wants_message(channel));
    // More than the system takes in for a viewer that does not read, whatever its buffers are.
    for time in 0..MESSAGES {
        server.publish_message(channel, vec![1; 1 << 20], time);
        thread::sleep(Duration::from_millis(5));
    }
    let mut times = Vec::new();
    while times.last() != Some(&(MESSAGES - 1)) {
        let (kind, payload) = slow.next().unwrap();
        if kind == BINARY {
            times.push(u64::from_le_bytes(payload[5..13].try_into().unwrap()));
        }
    }
    // Those that were on their way when it stopped, and the newest one.
    let dropped = usize::try_from(server.counts().messages_dropped).unwrap();
    assert!(dropped > 0 && times.len() + dropped == MESSAGES as usize, "{times:?}, {dropped} dropped");
    assert!(times[times.len() - 2] < MESSAGES - 2, "{times:?}");
}

#[test]
fn a_page_that_confirms_nothing_is_sent_three_messages() {
    let server = start(ViewLimits { viewer_time: Duration::from_secs(1), ..ViewLimits::default() });
    let mut page = WebSocket::page(&server);
    wait_until("the page is counted", || server.viewers() == 1);
    for number in 0..20 {
        server.publish_frame(None, || frame(number, 32, 24));
        thread::sleep(Duration::from_millis(20));
    }
    let mut messages = 0;
    while page.next().is_some() {
        messages += 1;
    }
    assert_eq!(messages, 3);
    wait_until("the page is disconnected", || server.viewers() == 0);
    assert_eq!(server.counts().viewers_dropped, 1);
}

#[test]
fn a_viewer_that_sends_everything_and_reads_nothing_is_disconnected() {
    for subprotocol in ["", "foxglove.sdk.v1"] {
        let server = start(ViewLimits { viewer_time: Duration::from_secs(1), ..ViewLimits::default() });
        let mut deaf = WebSocket::open(&server, subprotocol).0;
        wait_until("the viewer is counted", || server.viewers() == 1);
        deaf.tcp.set_write_timeout(Some(Duration::from_millis(300))).unwrap();
        let begin = Instant::now();
        let mut is_heard = true;
        while server.viewers() == 1 {
            assert!(begin.elapsed() < PATIENCE, "{subprotocol}: it is still there");
            // Each of them alone would not do. What arrives in part must not be followed by anything.
            is_heard = is_heard && deaf.send(PING, &[7; 100]) && deaf.send(PONG, &[]) && deaf.send(TEXT, b"shown");
            server.publish_frame(None, || frame(0, 64, 48));
            thread::sleep(Duration::from_millis(1));
        }
        assert_eq!(server.counts().viewers_dropped, 1, "{subprotocol}");
    }
}

#[test]
fn a_viewer_that_answers_pings_only_stays() {
    let server = start(ViewLimits { viewer_time: Duration::from_millis(300), ..ViewLimits::default() });
    let mut quiet = WebSocket::open(&server, "foxglove.sdk.v1").0;
    quiet.tcp.set_read_timeout(Some(Duration::from_millis(20))).unwrap();
    let begin = Instant::now();
    while begin.elapsed() < Duration::from_secs(2) {
        if let Some((PING, content)) = quiet.receive() {
            quiet.send(PONG, &content);
        }
    }
    assert_eq!((server.viewers(), server.counts().viewers_dropped), (1, 0));
}
