//! The protocol over HTTP: who is answered, and what.

use crate::support::{Client, options, room};
use rmcp::ServiceExt;
#[cfg(unix)]
use rmcp::transport::{StreamableHttpClientTransport, UnixSocketHttpClient, streamable_http_client};
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
    assert_eq!((status, json_of(&body)["result"]["tools"].as_array().unwrap().len()), (200, 9), "{body}");
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
fn connections_without_the_token_keep_no_client_out() {
    let server = bind("127.0.0.1:0").unwrap();
    let address = server.address();
    std::thread::spawn(move || server.serve());
    let strangers: Vec<TcpStream> = (0..150).map(|_| TcpStream::connect(address).unwrap()).collect();
    let (host, bearer) = (format!("Host: {address}"), format!("Authorization: Bearer {TOKEN}"));
    let accept = "Accept: application/json, text/event-stream";
    let head = ["POST /mcp HTTP/1.1", &host, &bearer, accept, "Content-Type: application/json"];
    let started = std::time::Instant::now();
    assert_eq!(send(address, &head, &request(1, "tools/list", &json!({}))).0, 200);
    assert!(started.elapsed() < Duration::from_secs(5), "{:?}", started.elapsed());
    // The oldest had to go, and the newest has not.
    let mut byte = [0];
    let (mut oldest, mut newest) = (&strangers[0], &strangers[149]);
    oldest.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
    assert_eq!(oldest.read(&mut byte).unwrap(), 0);
    newest.set_read_timeout(Some(Duration::from_millis(100))).unwrap();
    newest.read(&mut byte).unwrap_err();
}

#[test]
fn addresses_of_the_network_are_refused() {
    let error = bind("0.0.0.0:0").err().unwrap();
    assert!(error.contains("0.0.0.0:0") && error.contains("other computers could reach it"), "{error}");
    let taken = bind("127.0.0.1:0").unwrap();
    assert!(bind(&taken.address().to_string()).err().unwrap().contains(&taken.address().to_string()));
}

/// Carries what comes through a Unix socket to the server and back: the SDK's client without TLS speaks through such a
/// socket. The threads end with the test program.
#[cfg(unix)]
fn forward(socket: &std::path::Path, server: SocketAddr) {
    let listener = std::os::unix::net::UnixListener::bind(socket).unwrap();
    std::thread::spawn(move || {
        for client in listener.incoming() {
            let (mut client, mut stream) = (client.unwrap(), TcpStream::connect(server).unwrap());
            let (mut from_client, mut to_server) = (client.try_clone().unwrap(), stream.try_clone().unwrap());
            std::thread::spawn(move || {
                let _ = std::io::copy(&mut from_client, &mut to_server);
                let _ = to_server.shutdown(std::net::Shutdown::Write);
            });
            std::thread::spawn(move || {
                let _ = std::io::copy(&mut stream, &mut client);
                let _ = client.shutdown(std::net::Shutdown::Both);
            });
        }
    });
}

/// The SDK's own client, over HTTP, lists the tools and calls them, also two at once. A wrong token is reported.
#[cfg(unix)]
#[test]
fn the_client_of_the_sdk_is_served() {
    let server = bind("127.0.0.1:0").unwrap();
    let (url, address) = (server.url(), server.address());
    std::thread::spawn(move || server.serve());
    let folder = tempfile::tempdir().unwrap();
    let socket = folder.path().join("socket");
    forward(&socket, address);
    let connect = async |token: &str| {
        let client = UnixSocketHttpClient::new(socket.to_str().unwrap(), &url);
        let config = streamable_http_client::StreamableHttpClientTransportConfig::with_uri(url.as_str());
        let transport = StreamableHttpClientTransport::with_client(client, config.auth_header(token));
        ().serve(transport).await
    };
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        let refused = connect("0123456789abcdee").await.err().map(|error| error.to_string());
        assert!(refused.as_deref().is_some_and(|error| error.contains("Auth")), "{refused:?}");
        let client = Client(connect(TOKEN).await.unwrap());
        assert_eq!(client.0.peer_info().unwrap().server_info.as_ref().unwrap().name, "splatseg");
        assert_eq!(client.0.list_all_tools().await.unwrap().len(), 9);
        let (text, data) = client.ask("where_is", json!({ "object": "mug" })).await;
        assert!(text.contains("mug") && data["object"]["name"] == "mug", "{text} {data}");
        let both = [json!({ "object": "mug" }), json!({ "object": "the largest" })];
        let [one, two] = both.map(|arguments| client.ask("where_is", arguments));
        let ((one, _), (two, _)) = tokio::join!(one, two);
        assert!(one == text && two != text, "{one} {two}");
        let picture = client.call("plan_view", json!({})).await;
        assert!(picture.content.iter().any(|content| content.as_image().is_some()), "a picture");
        assert!(client.refused("where_is", json!({ "object": "no such thing" })).await.contains("no such thing"));
        client.0.cancel().await.unwrap();
    });
}
