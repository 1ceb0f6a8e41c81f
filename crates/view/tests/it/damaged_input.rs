//! Damaged, huge and slow input: counted, and the server goes on.

use crate::client::{BINARY, TEXT, TOKEN, WebSocket, connect, exchange, is_serving, start, wait_until};
use proptest::prelude::{any, prop};
use proptest::prop_assert;
use proptest::test_runner::{Config, TestCaseError, TestRunner};
use splatseg_view::ViewLimits;
use std::io::{Read, Write};
use std::thread;
use std::time::Duration;

const CASES: u32 = 200;

fn runner() -> TestRunner {
    // Cases come from a fixed seed, and nothing is written.
    let config = Config { cases: CASES, failure_persistence: None, ..Config::default() };
    TestRunner::new_with_rng(config, proptest::test_runner::TestRng::deterministic_rng(Default::default()))
}

fn valid_request() -> Vec<u8> {
    format!("GET /?token={TOKEN} HTTP/1.1\r\nHost: 127.0.0.1\r\nAccept: */*\r\n\r\n").into_bytes()
}

#[test]
fn random_bytes_are_bad_requests() {
    let server = start(ViewLimits::default());
    let bytes = prop::collection::vec(any::<u8>(), 1..400);
    runner()
        .run(&bytes, |bytes| {
            let response = exchange(server.address(), &bytes);
            prop_assert!(response.starts_with(b"HTTP/1.1 4"), "{:?}", String::from_utf8_lossy(&response));
            Ok::<(), TestCaseError>(())
        })
        .unwrap();
    assert_eq!(server.counts().bad_requests, u64::from(CASES));
    assert!(is_serving(&server));
}

#[test]
fn damaged_requests_are_refused_or_answered() {
    let server = start(ViewLimits::default());
    let valid = valid_request();
    let damage = (0..valid.len(), any::<u8>());
    runner()
        .run(&damage, |(place, byte)| {
            let mut bytes = valid.clone();
            bytes[place] = byte;
            let response = String::from_utf8(exchange(server.address(), &bytes)).unwrap();
            let code = crate::client::status(&response);
            prop_assert!([200, 400, 403, 404, 405, 408, 421].contains(&code), "{code}");
            // The page never comes without the whole token.
            let has_token = String::from_utf8_lossy(&bytes).contains(&format!("token={TOKEN}"));
            prop_assert!(code != 200 || has_token);
            Ok(())
        })
        .unwrap();
    for length in 1..valid.len() {
        let response = exchange(server.address(), &valid[..length]);
        assert!(response.starts_with(b"HTTP/1.1 408 "), "{length} bytes");
    }
    assert!(is_serving(&server));
}

#[test]
fn large_requests_are_refused() {
    let server = start(ViewLimits::default());
    let long = "a".repeat(1 << 20);
    let many: String = (0..200).map(|number| format!("X-{number}: a\r\n")).collect();
    for head in [
        format!("GET /{long} HTTP/1.1\r\nHost: localhost\r\n\r\n"),
        format!("GET / HTTP/1.1\r\nHost: localhost\r\nX: {long}\r\n\r\n"),
        format!("GET / HTTP/1.1\r\nHost: localhost\r\n{many}\r\n"),
        long.clone(),
    ] {
        let before = server.counts().bad_requests;
        let response = exchange(server.address(), head.as_bytes());
        // A client that is still sending may see the connection end before it reads the answer.
        assert!(response.is_empty() || response.starts_with(b"HTTP/1.1 431 "), "{}", &head[..40]);
        wait_until("the request is counted", || server.counts().bad_requests == before + 1);
    }
    assert!(is_serving(&server));
}

#[test]
fn damaged_websocket_frames_end_only_their_connection() {
    let server = start(ViewLimits::default());
    let mut witness = WebSocket::page(&server);
    let frames: [(&str, Vec<u8>); 9] = [
        ("not masked", vec![0x81, 5, b's', b'h', b'o', b'w', b'n']),
        ("reserved kind", vec![0x83, 0x80, 1, 2, 3, 4]),
        ("reserved bits", vec![0xf1, 0x80, 1, 2, 3, 4]),
        ("huge length", [&[0x82, 0xff], &u64::MAX.to_be_bytes()[..], &[1, 2, 3, 4]].concat()),
        ("long length", [&[0x82, 0xff], &(1_u64 << 30).to_be_bytes()[..], &[1, 2, 3, 4]].concat()),
        ("above the limit", [&[0x82, 0xff], &(64_u64 * 1024 + 1).to_be_bytes()[..], &[0; 4]].concat()),
        ("continuation of nothing", vec![0x80, 0x80, 1, 2, 3, 4]),
        ("ping in parts", vec![0x09, 0x80, 1, 2, 3, 4]),
        ("text that is not UTF-8", vec![0x81, 0x82, 0, 0, 0, 0, 0xff, 0xfe]),
    ];
    for (count, (name, bytes)) in (1..).zip(frames) {
        let mut socket = WebSocket::page(&server);
        socket.tcp.write_all(&bytes).unwrap();
        while socket.receive().is_some() {}
        wait_until(name, || server.counts().bad_messages == count);
    }
    wait_until("only the witness is left", || server.viewers() == 1);
    assert!(witness.page_message("status").is_some());
}

#[test]
fn wrong_messages_of_a_page_are_counted() {
    let server = start(ViewLimits::default());
    let mut page = WebSocket::page(&server);
    page.page_message("hello").unwrap();
    for (kind, payload) in [(TEXT, &b"draw me a sheep"[..]), (BINARY, &[0; 1000]), (TEXT, &vec![b'x'; 60_000])] {
        page.send(kind, payload);
    }
    wait_until("all are counted", || server.counts().bad_messages == 3);
    assert!(page.page_message("status").is_some(), "the page is still served");
}

#[test]
fn random_bytes_in_a_websocket_end_only_their_connection() {
    let server = start(ViewLimits::default());
    let mut witness = WebSocket::page(&server);
    let input = (any::<bool>(), prop::collection::vec(any::<u8>(), 1..200));
    runner()
        .run(&input, |(is_foxglove, bytes)| {
            let (mut socket, _) = WebSocket::open(&server, if is_foxglove { "foxglove.sdk.v1" } else { "" });
            // Either may end the connection first.
            let _ = socket.tcp.write_all(&bytes);
            let _ = socket.tcp.shutdown(std::net::Shutdown::Write);
            let _ = socket.tcp.read_to_end(&mut Vec::new());
            Ok(())
        })
        .unwrap();
    wait_until("only the witness is left", || server.viewers() == 1);
    assert!(witness.page_message("status").is_some());
}

#[test]
fn slow_requests_do_not_block_others() {
    let limits = ViewLimits { request_time: Duration::from_secs(2), ..ViewLimits::default() };
    let server = start(limits);
    let mut slow: Vec<_> = (0..40).map(|_| connect(server.address())).collect();
    let (mut position, mut served) = (0, 0);
    let request = valid_request();
    // A byte at a time: each read succeeds, and the whole takes too long.
    while server.counts().bad_requests == 0 {
        for tcp in &mut slow {
            let _ = tcp.write_all(&request[position..=position]);
        }
        position += 1;
        assert!(is_serving(&server));
        // Served while all the others were still under way.
        served += usize::from(server.counts().bad_requests == 0);
        thread::sleep(Duration::from_millis(100));
    }
    assert!(served > 0);
    wait_until("all are counted", || server.counts().bad_requests == 40);
}

#[test]
fn too_many_connections_are_refused_and_make_room_again() {
    let limits = ViewLimits { viewers: 4, request_time: Duration::from_millis(500), ..ViewLimits::default() };
    let server = start(limits);
    let idle: Vec<_> = (0..100).map(|_| connect(server.address())).collect();
    wait_until("some are refused", || server.counts().refused > 0);
    wait_until("there is room again", || is_serving(&server));
    assert_eq!(server.counts().bad_requests, 0, "a connection without a request is no error");
    drop(idle);
}
