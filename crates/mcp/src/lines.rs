//! Lines of a client that are no JSON, or too long, are answered with the protocol's error: the SDK drops them.

use crate::MAX_MESSAGE_BYTES;
use serde::de::IgnoredAny;
use std::io;
use tokio::io::{AsyncBufReadExt, AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt, BufReader};
use tokio::sync::mpsc::{Receiver, Sender};

/// Errors that may wait for the client to read. Beyond, its next lines wait.
pub(crate) const WAITING: usize = 16;

/// A line of a client.
enum Line {
    /// Text that is JSON, and the end of the line.
    Json(Vec<u8>),
    Empty,
    Wrong(String),
}

/// Passes the lines of a client on to the SDK until the client closes its side, and the errors of the others to `errors`.
pub(crate) async fn pass_on(
    from_client: impl AsyncRead + Unpin,
    mut to_sdk: impl AsyncWrite + Unpin,
    errors: Sender<String>,
) -> io::Result<()> {
    let mut from_client = BufReader::new(from_client);
    while let Some(line) = next_line(&mut from_client).await? {
        match line {
            Line::Json(line) => to_sdk.write_all(&line).await?,
            Line::Empty => {}
            // The other side is closed together with the connection.
            Line::Wrong(problem) => drop(errors.send(error(&problem)).await),
        }
    }
    Ok(())
}

/// Writes the SDK's lines to the client, and the errors between them, until both have ended.
pub(crate) async fn answer(
    from_sdk: impl AsyncRead + Unpin,
    mut to_client: impl AsyncWrite + Unpin,
    mut errors: Receiver<String>,
) -> io::Result<()> {
    let mut from_sdk = BufReader::new(from_sdk);
    let (mut line, mut has_sdk, mut has_errors) = (Vec::new(), true, true);
    while has_sdk || has_errors {
        // What was read of a line stays in it if an error comes first.
        tokio::select! {
            read = from_sdk.read_until(b'\n', &mut line), if has_sdk => {
                has_sdk = read? > 0;
                to_client.write_all(&std::mem::take(&mut line)).await?;
            }
            error = errors.recv(), if has_errors => match error {
                Some(error) => to_client.write_all(error.as_bytes()).await?,
                None => has_errors = false,
            },
        }
        to_client.flush().await?;
    }
    Ok(())
}

/// Reads a line; `None` at the end. Of a line that is too long, no more is kept than a message may have.
async fn next_line(from_client: &mut (impl AsyncBufReadExt + Unpin)) -> io::Result<Option<Line>> {
    let mut line = Vec::new();
    let most = MAX_MESSAGE_BYTES as u64 + 1;
    let mut length = (&mut *from_client).take(most).read_until(b'\n', &mut line).await?;
    if length == 0 {
        return Ok(None);
    }
    let is_long = length > MAX_MESSAGE_BYTES && line.last() != Some(&b'\n');
    while is_long && line.last() != Some(&b'\n') && length > 0 {
        line.clear();
        length = (&mut *from_client).take(most).read_until(b'\n', &mut line).await?;
    }
    if is_long {
        return Ok(Some(Line::Wrong(format!("the message has more than {MAX_MESSAGE_BYTES} bytes"))));
    }
    if line.trim_ascii().is_empty() {
        return Ok(Some(Line::Empty));
    }
    let parsed = std::str::from_utf8(&line).map_err(|error| error.to_string());
    let parsed = parsed.and_then(|text| serde_json::from_str::<IgnoredAny>(text).map_err(|error| error.to_string()));
    Ok(Some(match parsed {
        Ok(IgnoredAny) => Line::Json(line),
        Err(problem) => Line::Wrong(format!("the message is no JSON: {problem}")),
    }))
}

/// JSON-RPC's error for a message whose id is not known, as a line.
fn error(problem: &str) -> String {
    let error = serde_json::json!({ "code": -32700, "message": problem });
    format!("{}\n", serde_json::json!({ "jsonrpc": "2.0", "id": null, "error": error }))
}
