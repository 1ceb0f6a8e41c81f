//! Who is served, and how the server ends.

use crate::client::{PATIENCE, TOKEN, WebSocket, connect, is_serving, request, start, status, wait_until};
use splatseg_ros::PoseStamped;
use splatseg_view::{Channel, Reach, Token, ViewError, ViewLimits, ViewOptions, ViewServer};
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::time::{Duration, Instant};

#[test]
fn nothing_is_served_without_the_token() {
    let server = start(ViewLimits::default());
    let upgrade = ["Upgrade: websocket", "Sec-WebSocket-Version: 13", "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ=="];
    let targets = ["/", "/viewer.js", "/live", "/?token=", "/?token=0123456789abcdeg", "/?token=0123456789abcdef0"];
    for target in targets {
        let response = request(&server, "GET", target, &[]);
        assert_eq!(status(&response), 403, "{target}: {response}");
        assert!(!response.contains(TOKEN), "{target}");
        assert_eq!(status(&request(&server, "GET", target, &upgrade)), 403, "{target}");
    }
    assert_eq!(server.counts().refused, 2 * targets.len() as u64);
    assert_eq!(server.viewers(), 0);
}

#[test]
fn the_link_opens_the_page_and_its_script() {
    let server = start(ViewLimits::default());
    assert_eq!(server.link(), format!("http://{}/?token={TOKEN}", server.address()));
    let page = request(&server, "GET", &format!("/?token={TOKEN}"), &[]);
    assert_eq!(status(&page), 200);
    let script = format!("viewer.js?token={TOKEN}");
    assert!(page.contains(&format!("<script src=\"{script}\"></script>")), "the page loads its script with the token");
    assert!(!page.contains("<script src=\"viewer/run.js"), "a live page has no data of a finished run");
    for header in ["Cache-Control: no-store", "Referrer-Policy: no-referrer", "frame-ancestors 'none'"] {
        assert!(page.contains(header), "{header}");
    }
    let script = request(&server, "GET", &format!("/{script}"), &[]);
    assert_eq!(status(&script), 200);
    assert!(script.ends_with(splatseg_output::VIEWER_SCRIPT));
    let cookie = format!("Cookie: splatseg_token={TOKEN}");
    assert_eq!(status(&request(&server, "GET", "/", &[&cookie])), 200);
    assert_eq!(status(&request(&server, "GET", &format!("/other?token={TOKEN}"), &[])), 404);
    assert_eq!(server.counts().refused + server.counts().bad_requests, 0);
}

#[test]
fn viewers_can_only_look() {
    let server = start(ViewLimits::default());
    for method in ["POST", "PUT", "DELETE", "HEAD", "OPTIONS", "get"] {
        let response = request(&server, method, &format!("/?token={TOKEN}"), &[]);
        assert_eq!(status(&response), 405, "{method}: {response}");
    }
    assert_eq!(server.counts().bad_requests, 6);
}

#[test]
fn other_sites_have_no_access() {
    let server = start(ViewLimits::default());
    let target = format!("/?token={TOKEN}");
    let foreign = request(&server, "GET", &target, &["Origin: http://evil.example"]);
    assert_eq!(status(&foreign), 403, "{foreign}");
    let rebound = format!("GET {target} HTTP/1.1\r\nHost: evil.example:{}\r\n\r\n", server.address().port());
    let rebound = crate::client::exchange(server.address(), rebound.as_bytes());
    assert!(rebound.starts_with(b"HTTP/1.1 421 "));
    assert_eq!(server.counts().refused, 2);
}

#[test]
fn other_computers_have_access_only_if_allowed() {
    for address in ["0.0.0.0:0", "[::]:0", "192.168.1.7:0", "[::ffff:192.168.1.7]:0"] {
        let address = address.parse().unwrap();
        let options = ViewOptions { address, ..ViewOptions::default() };
        assert!(matches!(ViewServer::start(options), Err(ViewError::NotLoopback(refused)) if refused == address));
    }
    let token = Some(Token::new(TOKEN).unwrap());
    let address = "0.0.0.0:0".parse().unwrap();
    let options = ViewOptions { address, reach: Reach::Network, token, ..ViewOptions::default() };
    let server = ViewServer::start(options).unwrap();
    let port = server.address().port();
    assert_eq!(server.link(), format!("http://127.0.0.1:{port}/?token={TOKEN}"));
    assert!(TcpStream::connect(("127.0.0.1", port)).is_ok());
}

#[test]
fn a_port_in_use_is_an_error_with_the_address() {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap();
    let error = ViewServer::start(ViewOptions { address, ..ViewOptions::default() }).unwrap_err();
    assert!(error.to_string().starts_with(&format!("cannot listen on {address}: ")), "{error}");
}

#[test]
fn only_so_many_viewers_are_let_in() {
    let server = start(ViewLimits { viewers: 2, ..ViewLimits::default() });
    let page = WebSocket::page(&server);
    let foxglove = WebSocket::open(&server, "foxglove.sdk.v1").0;
    wait_until("both are counted", || server.viewers() == 2);
    let upgrade = ["Upgrade: websocket", "Sec-WebSocket-Version: 13", "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ=="];
    assert_eq!(status(&request(&server, "GET", &format!("/live?token={TOKEN}"), &upgrade)), 503);
    assert_eq!(server.counts().refused, 1);
    // The page itself is still served, and a place becomes free.
    assert!(is_serving(&server));
    drop((page, foxglove));
    wait_until("both have left", || server.viewers() == 0);
    drop(WebSocket::page(&server));
}

#[test]
fn a_dropped_server_waits_seconds_for_a_viewer_that_does_not_read() {
    let server = start(ViewLimits::default());
    let address = server.address();
    let channel = server.add_channel(Channel::of::<PoseStamped>("/pose"));
    let mut pages: Vec<WebSocket> = (0..3).map(|_| WebSocket::page(&server)).collect();
    let mut stuck = WebSocket::open(&server, "foxglove.sdk.v1").0;
    stuck.send(1, br#"{"op":"subscribe","subscriptions":[{"id":1,"channelId":1}]}"#);
    let mut half = connect(address);
    half.write_all(b"GET / HTTP/1.1\r\nHost: ").unwrap();
    wait_until("the subscription is known", || server.wants_message(channel));
    // More than the system's buffers hold: the server's write is under way when it is dropped.
    for time in 0..8 {
        server.publish_message(channel, vec![0; 4 << 20], time);
    }
    std::thread::sleep(Duration::from_millis(50));
    let start = Instant::now();
    drop(server);
    assert!(start.elapsed() < Duration::from_secs(7), "{:?}", start.elapsed());
    for page in &mut pages {
        while page.next().is_some() {}
    }
    assert!(start.elapsed() < PATIENCE);
    assert!(TcpStream::connect(address).is_err(), "the port is closed");
}

#[test]
fn connections_without_the_token_lock_nobody_out() {
    let server = start(ViewLimits { request_time: 6 * PATIENCE, ..ViewLimits::default() });
    let mut page = WebSocket::page(&server);
    let mut strangers = Vec::new();
    for number in 0..300 {
        let mut stranger = connect(server.address());
        // Some say nothing, some begin a request.
        if number % 2 == 0 {
            // The server may have ended it already.
            let _ = stranger.write_all(b"GET /?token=0123456789abcdeg HTTP/1.1\r\n");
        }
        strangers.push(stranger);
    }
    let begin = Instant::now();
    assert!(is_serving(&server), "the page");
    let mut other = WebSocket::open(&server, "foxglove.sdk.v1").0;
    wait_until("both viewers are counted", || server.viewers() == 2);
    assert!(page.next().is_some() && other.next().is_some(), "viewers stay");
    assert!(begin.elapsed() < PATIENCE, "{:?}", begin.elapsed());
    // The newest of the others are still heard.
    strangers[298].write_all(b"Host: localhost\r\n\r\n").unwrap();
    let mut answer = [0; 12];
    strangers[298].read_exact(&mut answer).unwrap();
    assert_eq!(&answer, b"HTTP/1.1 403");
    let mut oldest = Vec::new();
    let _ = strangers[1].read_to_end(&mut oldest);
    assert!(oldest.is_empty(), "the oldest were disconnected");
}
