//! HTTP responses.

use crate::hub::Shared;
use crate::request::{BadRequest, Refusal, Upgrade};
use splatseg_output::{VIEWER_SCRIPT, live_page};
use tungstenite::handshake::derive_accept_key;

/// Headers of every response. Nothing is stored, embedded elsewhere, or loaded from elsewhere, and the link with its token
/// is not passed on.
const HEADERS: &str = "Connection: close\r\nCache-Control: no-store\r\nReferrer-Policy: no-referrer\r\n\
    X-Content-Type-Options: nosniff\r\nCross-Origin-Resource-Policy: same-origin\r\n\
    Content-Security-Policy: default-src 'none'; script-src 'self'; style-src 'unsafe-inline'; img-src blob: data:; \
    connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'\r\n";

fn response(status: &str, content_type: &str, body: &str) -> Vec<u8> {
    let length = body.len();
    format!("HTTP/1.1 {status}\r\nContent-Type: {content_type}\r\nContent-Length: {length}\r\n{HEADERS}\r\n{body}")
        .into_bytes()
}

fn plain(status: &str, text: &str) -> Vec<u8> {
    response(status, "text/plain; charset=utf-8", text)
}

/// The response to a request that has passed all checks.
pub(crate) fn file(path: &str, shared: &Shared) -> Vec<u8> {
    match path {
        "/" | "/index.html" => {
            // A token needs no escape.
            let script = format!("viewer.js?token={}", shared.token.as_str());
            response("200 OK", "text/html; charset=utf-8", &live_page(&script))
        }
        "/viewer.js" => response("200 OK", "text/javascript; charset=utf-8", VIEWER_SCRIPT),
        _ => plain("404 Not Found", "There is nothing here.\n"),
    }
}

/// The response to a request that cannot be understood. Empty if there was none.
pub(crate) fn bad_request(problem: BadRequest) -> Vec<u8> {
    match problem {
        BadRequest::Nothing => Vec::new(),
        BadRequest::Malformed => plain("400 Bad Request", "The request is not valid.\n"),
        BadRequest::TooLarge => plain("431 Request Header Fields Too Large", "The request is too large.\n"),
        BadRequest::Incomplete => plain("408 Request Timeout", "The request was not complete in time.\n"),
        BadRequest::Method => plain("405 Method Not Allowed", "Viewers can only look.\n"),
    }
}

/// The response to a request that is refused.
pub(crate) fn refusal(refusal: Refusal) -> Vec<u8> {
    match refusal {
        Refusal::Token => {
            plain("403 Forbidden", "The token is missing or wrong. Open the whole link, with ?token=...\n")
        }
        Refusal::Origin => plain("403 Forbidden", "A page of another site has no access.\n"),
        Refusal::Host => plain("421 Misdirected Request", "This name is unknown here. Use the address in the link.\n"),
    }
}

/// The response if there are too many viewers.
pub(crate) fn too_many_viewers() -> Vec<u8> {
    plain("503 Service Unavailable", "There are too many viewers.\n")
}

/// The response that starts a websocket.
pub(crate) fn switch(upgrade: &Upgrade) -> Vec<u8> {
    let accept = derive_accept_key(upgrade.key.as_bytes());
    let subprotocol = upgrade.subprotocol.map(|name| format!("Sec-WebSocket-Protocol: {name}\r\n")).unwrap_or_default();
    format!(
        "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
         Sec-WebSocket-Accept: {accept}\r\n{subprotocol}\r\n"
    )
    .into_bytes()
}
