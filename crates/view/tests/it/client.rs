//! A small HTTP and websocket client, independent of the server's libraries.

use splatseg_geometry::{Image, Intrinsics, Pose};
use splatseg_objects::ObjectState;
use splatseg_view::{Token, ViewFrame, ViewLimits, ViewObject, ViewOptions, ViewServer, ViewStatus};
use std::io::{Read, Write};
use std::net::{Shutdown, SocketAddr, TcpStream};
use std::thread;
use std::time::{Duration, Instant};

pub const TOKEN: &str = "0123456789abcdef";
/// The longest that a test waits for something that should happen soon.
pub const PATIENCE: Duration = Duration::from_secs(10);

pub const TEXT: u8 = 1;
pub const BINARY: u8 = 2;
pub const CLOSE: u8 = 8;
pub const PING: u8 = 9;
pub const PONG: u8 = 10;

/// A server on a free port of 127.0.0.1.
pub fn start(limits: ViewLimits) -> ViewServer {
    let token = Some(Token::new(TOKEN).unwrap());
    let address = "127.0.0.1:0".parse().unwrap();
    let scene = "a scene".to_owned();
    ViewServer::start(ViewOptions { address, token, scene, limits, ..ViewOptions::default() }).unwrap()
}

/// Waits until something is true.
pub fn wait_until(what: &str, mut is_true: impl FnMut() -> bool) {
    let start = Instant::now();
    while !is_true() {
        assert!(start.elapsed() < PATIENCE, "waited too long until {what}");
        thread::sleep(Duration::from_millis(5));
    }
}

/// A frame with a stripe of object 7 on the left and a picture that changes with the number.
pub fn frame(number: usize, width: usize, height: usize) -> ViewFrame {
    let noise = |column: usize, row: usize| ((column * 7919 + row * 104_729 + number * 31) % 251) as u8;
    ViewFrame {
        number,
        name: format!("frame {number}"),
        timestamp: Some(Duration::from_millis(100 * number as u64)),
        color: Image::from_fn(width, height, |column, row| [noise(column, row), noise(row, column), 90]),
        segments: Image::from_fn(width, height, |column, _| if column < width / 4 { 7 } else { 0 }),
        intrinsics: Intrinsics {
            fx: width as f32,
            fy: width as f32,
            cx: width as f32 / 2.0,
            cy: height as f32 / 2.0,
            width,
            height,
        },
        status: ViewStatus {
            dropped: 3,
            is_pose_given: number == 5,
            detail: Some("normal"),
            delay: None,
            lines: vec!["a warning".to_owned()],
        },
    }
}

/// Object 7, as it is after the frame with a number.
pub fn object(number: usize, label: &str) -> ViewObject {
    ViewObject {
        id: 7,
        label: Some(label.to_owned()),
        oriented_box: None,
        frames: number + 1,
        state: Some(ObjectState::Remembered),
        seen: vec![(0.0, 0.1 * number as f64)],
    }
}

/// A camera that looks along the world's axes.
pub fn pose_at(x: f64, y: f64, z: f64) -> Pose {
    Pose::from_row_major([1.0, 0.0, 0.0, x, 0.0, 1.0, 0.0, y, 0.0, 0.0, 1.0, z, 0.0, 0.0, 0.0, 1.0]).unwrap()
}

pub fn connect(address: SocketAddr) -> TcpStream {
    let tcp = TcpStream::connect(address).unwrap();
    tcp.set_read_timeout(Some(PATIENCE)).unwrap();
    tcp
}

/// Sends bytes, and returns everything that the server sends until it closes the connection.
pub fn exchange(address: SocketAddr, bytes: &[u8]) -> Vec<u8> {
    let mut tcp = connect(address);
    // The server may close the connection before it has read everything.
    let _ = tcp.write_all(bytes);
    let _ = tcp.shutdown(Shutdown::Write);
    let mut response = Vec::new();
    let _ = tcp.read_to_end(&mut response);
    response
}

/// Sends a request with more headers after `Host`, and returns the response.
pub fn request(server: &ViewServer, method: &str, target: &str, headers: &[&str]) -> String {
    let host = format!("Host: {}", server.address());
    let first = format!("{method} {target} HTTP/1.1");
    let lines = [&[first.as_str(), &host], headers].concat();
    let bytes = format!("{}\r\n\r\n", lines.join("\r\n"));
    String::from_utf8(exchange(server.address(), bytes.as_bytes())).unwrap()
}

/// The status code of a response.
pub fn status(response: &str) -> u16 {
    response.strip_prefix("HTTP/1.1 ").and_then(|rest| rest.get(..3)).map_or(0, |code| code.parse().unwrap())
}

/// True if the page is served.
pub fn is_serving(server: &ViewServer) -> bool {
    status(&request(server, "GET", &format!("/?token={TOKEN}"), &[])) == 200
}

/// A websocket.
pub struct WebSocket {
    pub tcp: TcpStream,
}

impl WebSocket {
    /// Connects with the right token. `subprotocols` is the header's value, empty for none.
    pub fn open(server: &ViewServer, subprotocols: &str) -> (Self, String) {
        let mut tcp = connect(server.address());
        let offer =
            if subprotocols.is_empty() { String::new() } else { format!("Sec-WebSocket-Protocol: {subprotocols}\r\n") };
        // The key and its answer are the example of RFC 6455.
        let head = format!(
            "GET /live?token={TOKEN} HTTP/1.1\r\nHost: {}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n\
             Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n{offer}\r\n",
            server.address()
        );
        tcp.write_all(head.as_bytes()).unwrap();
        let mut response = Vec::new();
        while !response.ends_with(b"\r\n\r\n") {
            let mut byte = [0];
            tcp.read_exact(&mut byte).unwrap();
            response.push(byte[0]);
        }
        let response = String::from_utf8(response).unwrap();
        assert!(response.starts_with("HTTP/1.1 101 "), "{response}");
        assert!(response.contains("\r\nSec-WebSocket-Accept: s3pPLMBiTxaQ9kYGzzhZRbK+xOo=\r\n"), "{response}");
        (Self { tcp }, response)
    }

    /// A page's connection.
    pub fn page(server: &ViewServer) -> Self {
        Self::open(server, "").0
    }

    /// Sends a message. Returns false if the connection has ended.
    pub fn send(&mut self, kind: u8, payload: &[u8]) -> bool {
        let mask = [0x12, 0xab, 0x34, 0xcd];
        let mut bytes = vec![0x80 | kind];
        match payload.len() {
            length @ 0..126 => bytes.push(0x80 | length as u8),
            length @ 126..65536 => {
                bytes.push(0x80 | 126);
                bytes.extend((length as u16).to_be_bytes());
            }
            length => {
                bytes.push(0x80 | 127);
                bytes.extend((length as u64).to_be_bytes());
            }
        }
        bytes.extend(mask);
        bytes.extend(payload.iter().zip(mask.iter().cycle()).map(|(byte, mask)| byte ^ mask));
        self.tcp.write_all(&bytes).is_ok()
    }

    /// Receives a frame with its kind; `None` once the connection has ended.
    pub fn receive(&mut self) -> Option<(u8, Vec<u8>)> {
        let mut head = [0; 2];
        self.tcp.read_exact(&mut head).ok()?;
        assert_eq!(head[0] & 0xf0, 0x80, "the server sends whole messages without extensions");
        assert_eq!(head[1] & 0x80, 0, "a server must not mask");
        let length = match head[1] {
            126 => {
                let mut bytes = [0; 2];
                self.tcp.read_exact(&mut bytes).ok()?;
                usize::from(u16::from_be_bytes(bytes))
            }
            127 => {
                let mut bytes = [0; 8];
                self.tcp.read_exact(&mut bytes).ok()?;
                usize::try_from(u64::from_be_bytes(bytes)).unwrap()
            }
            length => usize::from(length),
        };
        let mut payload = vec![0; length];
        self.tcp.read_exact(&mut payload).ok()?;
        Some((head[0] & 0x0f, payload))
    }

    /// Receives the next message with data, and answers pings and messages as a page or Foxglove does.
    pub fn next(&mut self) -> Option<(u8, Vec<u8>)> {
        loop {
            let (kind, payload) = self.receive()?;
            match kind {
                PING => drop(self.send(PONG, &payload)),
                CLOSE => return None,
                _ => return Some((kind, payload)),
            }
        }
    }

    /// The next message of a page of a kind, as JSON with the bytes after it. Confirms all messages on the way.
    pub fn page_message(&mut self, kind: &str) -> Option<(serde_json::Value, Vec<u8>)> {
        loop {
            let (opcode, payload) = self.next()?;
            self.send(TEXT, b"shown");
            let (value, rest) = if opcode == BINARY {
                let length = u32::from_le_bytes(payload[..4].try_into().unwrap()) as usize;
                (serde_json::from_slice(&payload[4..4 + length]).unwrap(), payload[4 + length..].to_vec())
            } else {
                (serde_json::from_slice::<serde_json::Value>(&payload).unwrap(), Vec::new())
            };
            if value["kind"] == kind {
                return Some((value, rest));
            }
        }
    }
}
