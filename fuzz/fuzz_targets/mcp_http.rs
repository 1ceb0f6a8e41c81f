//! Bytes to the server for assistants over HTTP: as they are, or as the body of a request that has the token.
#![no_main]

use libfuzzer_sys::fuzz_target;
use splatseg_fuzz::assistant;
use splatseg_mcp::{HttpOptions, HttpServer};
use splatseg_view::{Reach, Token};
use std::cell::OnceCell;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::runtime::{Builder, Runtime};

const TOKEN: &str = "0123456789abcdef";

thread_local!(static SERVER: OnceCell<(Runtime, HttpServer)> = const { OnceCell::new() });

fn server() -> (Runtime, HttpServer) {
    let runtime = Builder::new_current_thread().enable_all().build().expect("a runtime");
    let token = Some(Token::new(TOKEN).expect("a token"));
    let options = HttpOptions { address: ([127, 0, 0, 1], 0).into(), reach: Reach::Loopback, token };
    (runtime, HttpServer::bind(options, assistant()).expect("a port"))
}

fuzz_target!(|bytes: &[u8]| {
    let Some((kind, bytes)) = bytes.split_first() else { return };
    let head = format!(
        "POST /mcp HTTP/1.1\r\nHost: 127.0.0.1\r\nAuthorization: Bearer {TOKEN}\r\nAccept: application/json, \
         text/event-stream\r\nContent-Type: application/json\r\nContent-Length: {}\r\n\r\n",
        bytes.len()
    );
    let head = if kind % 2 == 0 { String::new() } else { head };
    SERVER.with(|server| {
        let (runtime, server) = server.get_or_init(self::server);
        runtime.block_on(async {
            let (mut here, there) = tokio::io::duplex(1 << 20);
            let client = async move {
                for part in [head.as_bytes(), bytes] {
                    let _ = here.write_all(part).await;
                }
                let _ = here.shutdown().await;
                // What the server answers is read, so that it never waits.
                let mut answers = Vec::new();
                let _ = here.read_to_end(&mut answers).await;
                answers
            };
            let ((), answers) = tokio::join!(server.serve_on(there), client);
            // -32603: a tool has panicked.
            assert!(!answers.windows(6).any(|part| part == b"-32603"), "{}", String::from_utf8_lossy(&answers));
        });
    });
});
