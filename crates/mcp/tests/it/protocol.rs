//! The protocol: wrong messages, cancelled calls, and messages that are changed at random.

use crate::support::{options, room};
use serde_json::{Value, json};
use splatseg_mcp::{Assistant, MAX_MESSAGE_BYTES, MapServer};
use std::time::Duration;
use tokio::io::{AsyncBufReadExt, AsyncWriteExt, BufReader, DuplexStream, ReadHalf, WriteHalf};

/// A client that sends lines.
struct Lines {
    to_server: WriteHalf<DuplexStream>,
    from_server: tokio::io::Lines<BufReader<ReadHalf<DuplexStream>>>,
}

impl Lines {
    async fn send(&mut self, line: impl AsRef<[u8]>) {
        self.to_server.write_all(&[line.as_ref(), b"\n"].concat()).await.unwrap();
    }

    async fn receive(&mut self) -> Value {
        let line = tokio::time::timeout(Duration::from_secs(15), self.from_server.next_line()).await;
        serde_json::from_str(&line.expect("an answer in time").unwrap().expect("an open connection")).unwrap()
    }

    /// The answer to a request, after others.
    async fn answer(&mut self, id: u64) -> Value {
        loop {
            let message = self.receive().await;
            if message["id"] == id {
                return message;
            }
        }
    }
}

const PING: &str = r#"{"jsonrpc":"2.0","id":7,"method":"ping"}"#;

fn call(id: u64, name: &str, arguments: &Value) -> String {
    let params = json!({ "name": name, "arguments": arguments });
    json!({ "jsonrpc": "2.0", "id": id, "method": "tools/call", "params": params }).to_string()
}

/// Runs a test on a connection that is initialised.
fn with_lines<F: AsyncFnOnce(&mut Lines)>(test: F) {
    let (_folder, map) = room();
    let server = MapServer::new(Assistant::open(options(&map)).unwrap());
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        let (here, there) = tokio::io::duplex(1 << 22);
        let (from_client, to_client) = tokio::io::split(there);
        let server = tokio::spawn(server.serve_on(from_client, to_client));
        let (from_server, to_server) = tokio::io::split(here);
        let mut lines = Lines { to_server, from_server: BufReader::new(from_server).lines() };
        let params = json!({ "protocolVersion": "2025-06-18", "capabilities": {}, "clientInfo": { "name": "test", "version": "1" } });
        lines.send(json!({ "jsonrpc": "2.0", "id": 0, "method": "initialize", "params": params }).to_string()).await;
        assert_eq!(lines.receive().await["result"]["serverInfo"]["name"], "splatseg");
        lines.send(r#"{"jsonrpc":"2.0","method":"notifications/initialized"}"#).await;
        test(&mut lines).await;
        drop(lines);
        server.await.unwrap().unwrap();
    });
}

#[test]
fn wrong_messages_do_not_end_the_connection() {
    with_lines(async |lines| {
        let deep = "[".repeat(100_000);
        let long =
            format!(r#"{{"jsonrpc":"2.0","id":1,"method":"ping","params":"{}"}}"#, "x".repeat(MAX_MESSAGE_BYTES));
        let wrong: [&[u8]; 9] = [
            b"",
            b"hello",
            b"\xff\xfe\x00",
            b"{\"jsonrpc\":\"2.0\"",
            b"[]",
            b"null",
            br#"{"jsonrpc":"1.0","id":1,"method":"ping"}"#,
            deep.as_bytes(),
            long.as_bytes(),
        ];
        // An empty line is nothing; the others have the same form as a message.
        let is_json = |line: &[u8]| line.is_empty() || [&b"[]"[..], b"null"].contains(&line) || line.ends_with(b"}");
        for line in wrong {
            lines.send(line).await;
            if !is_json(line) || line.len() > MAX_MESSAGE_BYTES {
                let error = lines.receive().await;
                assert_eq!((&error["error"]["code"], &error["id"]), (&json!(-32700), &Value::Null), "{error}");
            }
            lines.send(PING).await;
            assert!(
                lines.answer(7).await["result"].is_object(),
                "{:?}",
                String::from_utf8_lossy(&line[..line.len().min(40)])
            );
        }
    });
}

#[test]
fn errors_say_what_is_wrong() {
    with_lines(async |lines| {
        lines.send(call(1, "fly", &json!({}))).await;
        let error = lines.answer(1).await["error"].clone();
        assert!(error["code"] == -32602 && error["message"].as_str().unwrap().contains("list_objects"), "{error}");
        lines.send(r#"{"jsonrpc":"2.0","id":2,"method":"no/such"}"#).await;
        assert_eq!(lines.answer(2).await["error"]["code"], -32601);
        lines.send(call(3, "where_is", &json!({ "object": -1 }))).await;
        let result = lines.answer(3).await["result"].clone();
        assert_eq!(result["isError"], true, "{result}");
        lines.send(call(4, "where_is", &Value::Null)).await;
        assert!(lines.answer(4).await["result"]["isError"] == true);
    });
}

#[test]
fn a_cancelled_call_has_no_answer_and_the_next_one_has() {
    with_lines(async |lines| {
        // All are sent at once: the first looks at every keyframe, and the others wait for it.
        lines.send(call(10, "picture_of", &json!({ "object": "mug" }))).await;
        for id in 11..20 {
            lines.send(call(id, "plan_view", &json!({}))).await;
            let params = json!({ "requestId": id });
            lines
                .send(json!({ "jsonrpc": "2.0", "method": "notifications/cancelled", "params": params }).to_string())
                .await;
        }
        lines.send(call(20, "list_objects", &json!({}))).await;
        let mut answered = Vec::new();
        while !(answered.contains(&10) && answered.contains(&20)) {
            let message = lines.receive().await;
            if message.get("result").is_some() {
                answered.push(message["id"].as_u64().unwrap());
            }
        }
        // A call may be answered before it is cancelled, but most wait.
        assert!(answered.len() < 8, "{answered:?}");
    });
}

/// Small random numbers (xorshift64).
struct Random(u64);

impl Random {
    fn below(&mut self, limit: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % limit.max(1) as u64) as usize
    }
}

/// A line with a few random changes.
fn changed(line: &str, random: &mut Random) -> Vec<u8> {
    const PIECES: [&[u8]; 16] = [
        b"null",
        b"-1",
        b"1e308",
        b"\"\"",
        b"[",
        b"}",
        b"{}",
        b"4294967296",
        b"\\u0000",
        b"\"mug\"",
        b"true",
        b",",
        b"\xff",
        b"0.5",
        b"[[1]]",
        b":",
    ];
    let mut bytes = line.as_bytes().to_vec();
    for _ in 0..=random.below(3) {
        let at = random.below(bytes.len());
        match random.below(4) {
            0 => bytes.truncate(at),
            1 => drop(bytes.splice(at..(at + 1 + random.below(8)).min(bytes.len()), [])),
            2 => drop(bytes.splice(at..at, PIECES[random.below(PIECES.len())].iter().copied())),
            _ => bytes[at] = b' ' + random.below(95) as u8,
        }
        if bytes.is_empty() {
            bytes.push(b'{');
        }
    }
    bytes.retain(|byte| *byte != b'\n');
    bytes
}

#[test]
fn changed_messages_neither_end_the_server_nor_make_a_tool_fail() {
    with_lines(async |lines| {
        let calls = [
            call(1, "list_objects", &json!({ "limit": 5, "offset": 1, "name": "table", "min_size_m": 0.1 })),
            call(1, "find_objects", &json!({ "words": "the small red mug", "limit": 3 })),
            call(1, "where_is", &json!({ "object": "mug" })),
            call(1, "what_is_near", &json!({ "point": [0.5, 0.0, 1.0], "radius_m": 2.0 })),
            call(1, "what_changed", &json!({ "since": "server_start", "limit": 3 })),
            call(1, "picture_of", &json!({ "object": 3, "close_up": true })),
            call(1, "plan_view", &json!({ "objects": [1, "mug"] })),
            r#"{"jsonrpc":"2.0","id":1,"method":"tools/list","params":{"cursor":"a"}}"#.to_owned(),
            PING.to_owned(),
        ];
        let mut random = Random(0x5eed);
        for _ in 0..15 {
            for _ in 0..50 {
                let line = changed(&calls[random.below(calls.len())], &mut random);
                lines.send(line).await;
            }
            lines.send(r#"{"jsonrpc":"2.0","id":424242,"method":"ping"}"#).await;
            loop {
                let message = lines.receive().await;
                let failed = message["error"]["code"] == -32603;
                assert!(!failed, "{message}");
                if message["id"] == 424_242 {
                    break;
                }
            }
        }
    });
}
