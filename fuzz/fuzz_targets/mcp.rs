//! Messages to the server for assistants: one line after the other, after the beginning of the protocol.
#![no_main]

use libfuzzer_sys::fuzz_target;
use splatseg_mcp::MapServer;
use std::cell::OnceCell;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::runtime::{Builder, Runtime};

const BEGINNING: &str = concat!(
    r#"{"jsonrpc":"2.0","id":0,"method":"initialize","params":{"protocolVersion":"2025-06-18","capabilities":{},"#,
    r#""clientInfo":{"name":"fuzz","version":"1"}}}"#,
    "\n",
    r#"{"jsonrpc":"2.0","method":"notifications/initialized"}"#,
    "\n"
);

thread_local!(static SERVER: OnceCell<(Runtime, MapServer)> = const { OnceCell::new() });

fuzz_target!(|lines: &[u8]| {
    SERVER.with(|server| {
        let (runtime, server) = server.get_or_init(|| {
            let runtime = Builder::new_current_thread().enable_all().build().expect("a runtime");
            (runtime, MapServer::new(splatseg_fuzz::assistant()))
        });
        runtime.block_on(async {
            let (here, there) = tokio::io::duplex(1 << 20);
            let (from_client, to_client) = tokio::io::split(there);
            let served = tokio::spawn(server.clone().serve_on(from_client, to_client));
            let (mut from_server, mut to_server) = tokio::io::split(here);
            // What the server answers is read, so that it never waits.
            let answers = tokio::spawn(async move {
                let mut bytes = Vec::new();
                let _ = from_server.read_to_end(&mut bytes).await;
                bytes
            });
            for part in [BEGINNING.as_bytes(), lines, b"\n"] {
                let _ = to_server.write_all(part).await;
            }
            let _ = to_server.shutdown().await;
            drop(to_server);
            let _ = served.await.expect("the server does not panic");
            let answers = answers.await.expect("the answers are read");
            // -32603: a tool has panicked.
            assert!(!answers.windows(6).any(|part| part == b"-32603"), "{}", String::from_utf8_lossy(&answers));
        });
    });
});
