//! The protocol over HTTP: who is answered, and what.

use crate::support::{options, room};
use serde_json::{Value, json};
use splatseg_mcp::{Assistant, HttpOptions, HttpServer};
use splatseg_view::{Reach, Token};
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

const TOKEN: &str = "0123456789abcdef";

fn bind(address: &str) -> Result<HttpServer, String> {
    let (_folder, map) = room();
    let assistant = Assistant::open(options(&map)).unwrap();
    let (address, token) = (address.parse().unwrap(), Some(Token::new(TOKEN).unwrap()));
    let options = HttpOptions { address, reach: Reach::Loopback, token };
    HttpServer::bind(options, assistant).map_err(|error| error.to_string())
}

/// Sends a request and returns status and body.
fn send(address: SocketAddr, head: &[&str], body: &str) -> (u16, String) {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    let head = head.join("\r\n");
    let length = body.len();
    write!(stream, "{head}\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n{body}").unwrap();
    let mut answer = String::new();
    let _ = stream.read_to_string(&mut answer);
    let status = answer.split(' ').nth(1).and_then(|status| status.parse().ok()).unwrap_or(0);
    (status, answer.split_once("\r\n\r\n").map(|(_, body)| body.to_owned()).unwrap_or_default())
}

/// The JSON of an answer, which may come in chunks.
fn json_of(body: &str) -> Value {
    let (start, end) = (body.find('{').unwrap(), body.rfind('}').unwrap());
    serde_json::from_str(&body[start..=end]).unwrap()
}

fn request(id: u64, method: &str, params: &Value) -> String {
    json!({ "jsonrpc": "2.0", "id": id, "method": method, "params": params }).to_string()
}

#[test]
fn tools_are_called_with_the_token_only() {
    let server = bind("127.0.0.1:0").unwrap();
    let address = server.address();
    assert_eq!(server.url(), format!("http://{address}/mcp"));
    // The thread ends with the test program.
    std::thread::spawn(move || server.serve());
    let (host, bearer) = (format!("Host: {address}"), format!("Authorization: Bearer {TOKEN}"));
    let accept = "Accept: application/json, text/event-stream";
    let post = "POST /mcp HTTP/1.1";
    let kind = "Content-Type: application/json";
    let right = [post, &host, &bearer, accept, kind];
    let about =
        json!({ "protocolVersion": "2025-06-18", "capabilities": {}, "clientInfo": { "name": "a", "version": "1" } });
    let (status, body) = send(address, &right, &request(1, "initialize", &about));
    assert_eq!(status, 200, "{body}");
    assert_eq!(json_of(&body)["result"]["serverInfo"]["name"], "splatseg");
    let (status, body) = send(address, &right, &request(2, "tools/list", &json!({})));
    assert_eq!((status, json_of(&body)["result"]["tools"].as_array().unwrap().len()), (200, 7), "{body}");
    let call = request(3, "tools/call", &json!({ "name": "where_is", "arguments": { "object": "mug" } }));
    let (status, body) = send(address, &right, &call);
    assert!(
        status == 200 && json_of(&body)["result"]["content"][0]["text"].as_str().unwrap().contains("mug"),
        "{body}"
    );
    let query = format!("POST /mcp?token={TOKEN} HTTP/1.1");
    assert_eq!(send(address, &[&query, &host, accept, kind], &call).0, 200);

    // Without the token, with a wrong one, at another path, from a page, by another name, too long, or no JSON.
    let is = |head: &[&str], body: &str| send(address, head, body).0;
    assert_eq!(is(&[post, &host, accept, kind], &call), 401);
    assert_eq!(is(&[post, &host, "Authorization: Bearer 0123456789abcdee", accept, kind], &call), 401);
    assert_eq!(is(&["POST / HTTP/1.1", &host, &bearer, accept, kind], &call), 404);
    assert_eq!(is(&[post, &host, &bearer, accept, kind, "Origin: http://evil.example"], &call), 403);
    assert_eq!(is(&[post, "Host: evil.example", &bearer, accept, kind], &call), 403);
    assert_eq!(is(&[post, &host, &bearer, accept, kind], &"x".repeat((1 << 20) + 1)), 413);
    assert!((400..500).contains(&is(&right, "no JSON")));
    assert!((400..500).contains(&is(&["GET /mcp HTTP/1.1", &host, &bearer, accept], "")));
    assert_eq!(is(&right, &call), 200);
}

#[test]
fn addresses_of_the_network_are_refused() {
    let error = bind("0.0.0.0:0").err().unwrap();
    assert!(error.contains("0.0.0.0:0") && error.contains("other computers could reach it"), "{error}");
    let taken = bind("127.0.0.1:0").unwrap();
    assert!(bind(&taken.address().to_string()).err().unwrap().contains(&taken.address().to_string()));
}
