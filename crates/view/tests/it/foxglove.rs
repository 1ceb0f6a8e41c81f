//! Foxglove's protocol, as its client speaks it.

use crate::client::{BINARY, PING, PONG, TEXT, WebSocket, start, wait_until};
use serde_json::{Value, json};
use splatseg_ros::{Header, Message, PointCloud2, PoseMessage, PoseStamped, Time, from_cdr, to_cdr};
use splatseg_view::{Channel, ChannelId, ViewLimits, ViewServer};
use std::time::Duration;

fn open(server: &ViewServer) -> WebSocket {
    let (mut socket, response) = WebSocket::open(server, "foxglove.sdk.v1, foxglove.websocket.v1");
    assert!(response.contains("\r\nSec-WebSocket-Protocol: foxglove.sdk.v1\r\n"), "{response}");
    assert_eq!(text(&mut socket)["op"], "serverInfo");
    socket
}

fn text(socket: &mut WebSocket) -> Value {
    let (kind, payload) = socket.next().unwrap();
    assert_eq!(kind, TEXT);
    serde_json::from_slice(&payload).unwrap()
}

/// Subscription, time and data of the next message.
fn data(socket: &mut WebSocket) -> (u32, u64, Vec<u8>) {
    let (kind, payload) = socket.next().unwrap();
    assert_eq!((kind, payload[0]), (BINARY, 1));
    let (subscription, time) = (payload[1..5].try_into().unwrap(), payload[5..13].try_into().unwrap());
    (u32::from_le_bytes(subscription), u64::from_le_bytes(time), payload[13..].to_vec())
}

fn subscribe(server: &ViewServer, socket: &mut WebSocket, subscription: u32, channel: (ChannelId, u32)) {
    let entry = json!({ "id": subscription, "channelId": channel.1 });
    socket.send(TEXT, json!({ "op": "subscribe", "subscriptions": [entry] }).to_string().as_bytes());
    wait_until("the subscription is known", || server.wants_message(channel.0));
}

fn pose(x: f64) -> PoseStamped {
    let header = Header { stamp: Time::from_nanoseconds(1_500_000_000), frame_id: "map".to_owned() };
    let mut pose = PoseMessage::default();
    pose.position.x = x;
    PoseStamped { header, pose }
}

#[test]
fn each_version_of_the_protocol_is_spoken() {
    let server = start(ViewLimits::default());
    for (offered, chosen) in [
        ("foxglove.websocket.v1", "foxglove.websocket.v1"),
        ("foxglove.websocket.v1, foxglove.sdk.v1", "foxglove.sdk.v1"),
        ("other, foxglove.sdk.v1", "foxglove.sdk.v1"),
    ] {
        let (mut socket, response) = WebSocket::open(&server, offered);
        assert!(response.contains(&format!("\r\nSec-WebSocket-Protocol: {chosen}\r\n")), "{response}");
        let info = text(&mut socket);
        assert_eq!(
            (&info["op"], &info["name"], &info["capabilities"]),
            (&json!("serverInfo"), &json!("splatseg"), &json!([]))
        );
        assert!(info["sessionId"].is_string());
    }
}

#[test]
fn a_message_arrives_byte_for_byte() {
    let server = start(ViewLimits::default());
    let channel = server.add_channel(Channel::of::<PoseStamped>("/splatseg/pose"));
    let other = server.add_channel(Channel::of::<PointCloud2>("/splatseg/points"));
    let mut socket = open(&server);
    let channels = text(&mut socket);
    assert_eq!(channels["op"], "advertise");
    assert_eq!(
        channels["channels"][0],
        json!({
            "id": 1,
            "topic": "/splatseg/pose",
            "encoding": "cdr",
            "schemaName": "geometry_msgs/msg/PoseStamped",
            "schema": PoseStamped::INTERFACE.schema(),
            "schemaEncoding": "ros2msg",
        })
    );
    assert_eq!(channels["channels"][1]["topic"], "/splatseg/points");
    assert!(!server.wants_message(channel), "nobody has subscribed");
    subscribe(&server, &mut socket, 40, (channel, 1));
    assert!(!server.wants_message(other));
    let message = to_cdr(&pose(2.5)).unwrap();
    server.publish_message(other, vec![1, 2, 3], 1);
    server.publish_message(channel, message.clone(), u64::MAX - 1);
    let (subscription, time, bytes) = data(&mut socket);
    assert_eq!((subscription, time), (40, u64::MAX - 1));
    assert_eq!(bytes, message);
    assert_eq!(from_cdr::<PoseStamped>(&bytes).unwrap(), pose(2.5));

    socket.send(TEXT, br#"{"op":"unsubscribe","subscriptionIds":[40]}"#);
    wait_until("the subscription has ended", || !server.wants_message(channel));
    // A channel that comes later is announced.
    server.add_channel(Channel::of::<PoseStamped>("/late"));
    let late = text(&mut socket);
    assert_eq!((&late["channels"][0]["topic"], &late["channels"][0]["id"]), (&json!("/late"), &json!(3)));
    assert_eq!(server.counts().bad_messages, 0);
}

#[test]
fn a_latched_message_reaches_those_who_come_later() {
    let server = start(ViewLimits::default());
    let channel = server.add_channel(Channel::of::<PoseStamped>("/objects").latched());
    assert!(!server.wants_message(channel), "nobody has subscribed");
    server.publish_message(channel, to_cdr(&pose(1.0)).unwrap(), 1);
    server.publish_message(channel, to_cdr(&pose(2.0)).unwrap(), 2);
    let mut socket = open(&server);
    text(&mut socket);
    subscribe(&server, &mut socket, 5, (channel, 1));
    assert_eq!(data(&mut socket), (5, 2, to_cdr(&pose(2.0)).unwrap()));
}

#[test]
fn mistakes_are_explained_and_counted() {
    let server = start(ViewLimits::default());
    let channel = server.add_channel(Channel::of::<PoseStamped>("/pose"));
    let mut socket = open(&server);
    text(&mut socket);
    subscribe(&server, &mut socket, 1, (channel, 1));
    let wrong: [&[u8]; 5] = [
        br#"{"op":"subscribe","subscriptions":[{"id":2,"channelId":9}]}"#,
        br#"{"op":"subscribe","subscriptions":[{"id":1,"channelId":1}]}"#,
        br#"{"op":"unsubscribe","subscriptionIds":[77]}"#,
        br#"{"op":"advertise","channels":[]}"#,
        br#"{"op":"setParameters","parameters":[]}"#,
    ];
    for (count, request) in (1..).zip(wrong) {
        socket.send(TEXT, request);
        let answer = text(&mut socket);
        assert_eq!((&answer["op"], &answer["level"]), (&json!("status"), &json!(2)), "{answer}");
        assert_eq!(server.counts().bad_messages, count);
    }
    // No answer can help these.
    for (kind, payload) in [(TEXT, &b"{"[..]), (TEXT, b"[]"), (TEXT, br#"{"op":1}"#), (BINARY, b"\x01\0\0\0\0")] {
        socket.send(kind, payload);
    }
    wait_until("all are counted", || server.counts().bad_messages == 9);
    server.publish_message(channel, vec![4], 4);
    assert_eq!(data(&mut socket), (1, 4, vec![4]), "the viewer is still served");
}

#[test]
fn pings_are_answered_and_silence_ends_the_connection() {
    let server = start(ViewLimits { viewer_time: Duration::from_millis(600), ..ViewLimits::default() });
    let mut socket = open(&server);
    socket.send(PING, b"are you there?");
    loop {
        let (kind, payload) = socket.receive().unwrap();
        if kind == PONG {
            assert_eq!(payload, b"are you there?");
            break;
        }
    }
    // This one reads everything and answers nothing but its own pings.
    while let Some((kind, _)) = socket.receive() {
        if kind == PING {
            socket.send(PING, b"");
        }
    }
    wait_until("the viewer is gone", || server.viewers() == 0);
    assert_eq!(server.counts().viewers_dropped, 1);
}
