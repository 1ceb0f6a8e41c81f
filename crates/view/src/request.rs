//! HTTP requests: reading, parsing, and the decision whether to answer.
//!
//! The token must be right. The host must be numeric or known, because a hostile site's name may resolve to this
//! computer. The origin must be the server's own, except for Foxglove with the whole link, whose pages come from
//! another site.

use crate::foxglove::SUBPROTOCOLS;
use crate::hub::Shared;
use crate::timed_stream::TimedStream;
use std::io::Read;
use std::net::IpAddr;

/// Maximum size of a request's head, bytes.
const MAX_HEAD: usize = 16 << 10;
const MAX_HEADERS: usize = 64;
/// Name of the cookie that may hold the token, e.g. behind a proxy that sets it.
const COOKIE: &str = "splatseg_token";

/// A request for a file or a websocket.
#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct Request {
    /// The path without the query.
    pub(crate) path: String,
    /// The token in the query.
    query_token: Option<String>,
    cookie_token: Option<String>,
    host: Option<String>,
    origin: Option<String>,
    /// The upgrade to a websocket, if requested.
    pub(crate) upgrade: Option<Upgrade>,
    /// Bytes received after the head.
    pub(crate) rest: Vec<u8>,
}

/// The upgrade to a websocket.
#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct Upgrade {
    pub(crate) key: String,
    /// The preferred subprotocol of those that the viewer offers.
    pub(crate) subprotocol: Option<&'static str>,
}

/// A request cannot be understood.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum BadRequest {
    /// The viewer left without a request. Browsers open spare connections.
    Nothing,
    /// Invalid HTTP.
    Malformed,
    /// Too many bytes or headers.
    TooLarge,
    /// Not complete in time, or the connection broke.
    Incomplete,
    /// Not `GET`.
    Method,
}

/// A request is not answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Refusal {
    Host,
    Origin,
    Token,
}

/// Reads a request until the stream's deadline.
pub(crate) fn read_request(stream: &mut TimedStream) -> Result<Request, BadRequest> {
    let mut bytes = Vec::new();
    let mut part = [0; 2048];
    loop {
        let count = match stream.read(&mut part) {
            Ok(0) | Err(_) if bytes.is_empty() => return Err(BadRequest::Nothing),
            Ok(0) | Err(_) => return Err(BadRequest::Incomplete),
            Ok(count) => count,
        };
        // The end of the head may begin in the bytes before.
        let start = bytes.len().saturating_sub(3);
        bytes.extend(part.get(..count).unwrap_or_default());
        let end = bytes.get(start..).unwrap_or_default().windows(4).position(|window| window == b"\r\n\r\n");
        let head = end.map(|end| start + end + 4);
        if head.unwrap_or(bytes.len()) > MAX_HEAD {
            return Err(BadRequest::TooLarge);
        }
        if let Some(head) = head {
            let rest = bytes.split_off(head);
            return Ok(Request { rest, ..parse(&bytes)? });
        }
    }
}

/// Parses the head of a request.
fn parse(head: &[u8]) -> Result<Request, BadRequest> {
    let mut headers = [httparse::EMPTY_HEADER; MAX_HEADERS];
    let mut parsed = httparse::Request::new(&mut headers);
    match parsed.parse(head) {
        Ok(httparse::Status::Complete(_)) => {}
        Err(httparse::Error::TooManyHeaders) => return Err(BadRequest::TooLarge),
        Ok(httparse::Status::Partial) | Err(_) => return Err(BadRequest::Malformed),
    }
    if parsed.method != Some("GET") {
        return Err(BadRequest::Method);
    }
    let (path, query) =
        parsed.path.unwrap_or_default().split_once('?').unwrap_or((parsed.path.unwrap_or_default(), ""));
    let query_token = query.split('&').find_map(|pair| pair.strip_prefix("token=")).map(str::to_owned);
    let mut request = Request { path: path.to_owned(), query_token, ..Request::default() };
    let (mut key, mut version, mut wants_websocket, mut offered) = (None, None, false, Vec::new());
    for header in &*parsed.headers {
        let value = std::str::from_utf8(header.value).map_err(|_| BadRequest::Malformed)?.trim();
        let is = |name: &str| header.name.eq_ignore_ascii_case(name);
        if is("content-length") && value != "0" || is("transfer-encoding") {
            return Err(BadRequest::Malformed);
        } else if is("host") {
            set_once(&mut request.host, value)?;
        } else if is("origin") {
            set_once(&mut request.origin, value)?;
        } else if is("cookie") {
            let cookies = value.split(';').filter_map(|cookie| cookie.trim().split_once('='));
            let token = cookies.filter(|(name, _)| *name == COOKIE).map(|(_, token)| token.to_owned()).next();
            request.cookie_token = request.cookie_token.or(token);
        } else if is("upgrade") {
            wants_websocket = value.eq_ignore_ascii_case("websocket");
        } else if is("sec-websocket-key") {
            set_once(&mut key, value)?;
        } else if is("sec-websocket-version") {
            set_once(&mut version, value)?;
        } else if is("sec-websocket-protocol") {
            offered.extend(value.split(',').map(|name| name.trim().to_owned()));
        }
    }
    if wants_websocket {
        let (Some(key), Some("13")) = (key, version.as_deref()) else { return Err(BadRequest::Malformed) };
        let subprotocol = SUBPROTOCOLS.into_iter().find(|known| offered.iter().any(|name| name == known));
        request.upgrade = Some(Upgrade { key, subprotocol });
    }
    Ok(request)
}

/// Sets a header that may come only once.
fn set_once(place: &mut Option<String>, value: &str) -> Result<(), BadRequest> {
    if place.replace(value.to_owned()).is_some() { Err(BadRequest::Malformed) } else { Ok(()) }
}

impl Request {
    /// Decides whether a request is answered.
    pub(crate) fn check(&self, shared: &Shared) -> Result<(), Refusal> {
        let host = self.host.as_deref().ok_or(Refusal::Host)?;
        if !is_known_host(host, &shared.host_names) {
            return Err(Refusal::Host);
        }
        let given = self.query_token.as_ref().or(self.cookie_token.as_ref()).ok_or(Refusal::Token)?;
        if !shared.token.matches(given) {
            return Err(Refusal::Token);
        }
        // Foxglove's own pages come from another site: they have the link, with the token. A cookie would not show that.
        let is_foxglove = self.upgrade.as_ref().is_some_and(|upgrade| upgrade.subprotocol.is_some());
        let is_free = is_foxglove && self.query_token.is_some();
        let own = |origin: &str| origin.split_once("://").is_some_and(|(_, site)| site.eq_ignore_ascii_case(host));
        if is_free || self.origin.as_deref().is_none_or(own) { Ok(()) } else { Err(Refusal::Origin) }
    }
}

/// True for a host that a hostile site cannot choose: a numeric address, `localhost`, or one of `names`. A site's own name
/// may resolve to this computer (DNS rebinding), so that its pages could otherwise read what is served here.
fn is_known_host(host: &str, names: &[String]) -> bool {
    if let Some((address, port)) = host.strip_prefix('[').and_then(|rest| rest.split_once(']')) {
        let is_port = |port: &str| port.bytes().all(|byte| byte.is_ascii_digit());
        let is_end = port.is_empty() || port.strip_prefix(':').is_some_and(is_port);
        return is_end && address.parse::<std::net::Ipv6Addr>().is_ok();
    }
    let name = host.split_once(':').map_or(host, |(name, _)| name);
    let is = |known: &str| name.eq_ignore_ascii_case(known);
    is("localhost") || name.parse::<IpAddr>().is_ok() || names.iter().any(|known| is(known))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Token, ViewLimits};

    const TOKEN: &str = "0123456789abcdef";

    fn check(head: &str) -> Result<(), Refusal> {
        let token = Token::new(TOKEN).unwrap();
        let shared = Shared::new(token, String::new(), vec!["robot.lan".to_owned()], ViewLimits::default());
        parse(head.as_bytes()).unwrap().check(&shared)
    }

    fn with(target: &str, headers: &[&str]) -> String {
        format!("GET {target} HTTP/1.1\r\n{}\r\n\r\n", headers.join("\r\n"))
    }

    #[test]
    fn the_token_is_needed() {
        let (right, host) = (format!("/?a=b&token={TOKEN}"), "Host: localhost:1");
        assert_eq!(check(&with(&right, &[host])), Ok(()));
        let cookie = format!("Cookie: a=b; splatseg_token={TOKEN}");
        assert_eq!(check(&with("/", &[host, &cookie])), Ok(()));
        for target in ["/", "/?token=", "/?token=0123456789abcdee", "/?tokens=0123456789abcdef"] {
            assert_eq!(check(&with(target, &[host])), Err(Refusal::Token), "{target}");
        }
        // A wrong token in the link is not saved by a cookie.
        assert_eq!(check(&with("/?token=x", &[host, &cookie])), Err(Refusal::Token));
    }

    #[test]
    fn names_of_other_sites_are_refused() {
        let target = format!("/?token={TOKEN}");
        for host in ["127.0.0.1", "127.0.0.1:80", "LOCALHOST:9", "[::1]:9", "[::1]", "192.168.1.7:8765", "Robot.lan:1"]
        {
            assert_eq!(check(&with(&target, &[&format!("Host: {host}")])), Ok(()), "{host}");
        }
        for host in
            ["evil.example", "evil.example:8765", "127.0.0.1.evil.example", "localhost.evil.example", "", "[::1].a"]
        {
            assert_eq!(check(&with(&target, &[&format!("Host: {host}")])), Err(Refusal::Host), "{host}");
        }
        assert_eq!(check(&with(&target, &["Accept: */*"])), Err(Refusal::Host));
    }

    #[test]
    fn pages_of_other_sites_are_refused_except_foxglove_with_the_link() {
        let target = format!("/?token={TOKEN}");
        let host = "Host: 127.0.0.1:8765";
        let foreign = "Origin: https://app.foxglove.dev";
        let upgrade = ["Upgrade: websocket", "Sec-WebSocket-Key: a", "Sec-WebSocket-Version: 13"];
        let foxglove = "Sec-WebSocket-Protocol: other, foxglove.websocket.v1";
        assert_eq!(check(&with(&target, &[host, "Origin: http://127.0.0.1:8765"])), Ok(()));
        assert_eq!(check(&with(&target, &[host, "Origin: http://127.0.0.1:8766"])), Err(Refusal::Origin));
        assert_eq!(check(&with(&target, &[host, "Origin: null"])), Err(Refusal::Origin));
        let websocket = |target: &str, more: &[&str]| with(target, &[&[host, foreign], &upgrade[..], more].concat());
        assert_eq!(check(&websocket(&target, &[])), Err(Refusal::Origin));
        assert_eq!(check(&websocket(&target, &[foxglove])), Ok(()));
        let cookie = format!("Cookie: splatseg_token={TOKEN}");
        assert_eq!(check(&websocket("/", &[foxglove, &cookie])), Err(Refusal::Origin));
    }

    #[test]
    fn ambiguous_requests_are_bad() {
        let host = "Host: localhost";
        for headers in [
            vec![host, host],
            vec![host, "Content-Length: 5"],
            vec![host, "Transfer-Encoding: chunked"],
            vec![host, "Upgrade: websocket"],
            vec![host, "Upgrade: websocket", "Sec-WebSocket-Key: a", "Sec-WebSocket-Version: 12"],
        ] {
            assert_eq!(parse(with("/", &headers).as_bytes()), Err(BadRequest::Malformed), "{headers:?}");
        }
        assert_eq!(parse(b"POST / HTTP/1.1\r\nHost: a\r\n\r\n"), Err(BadRequest::Method));
        assert_eq!(parse(with("/", &["a: b"; MAX_HEADERS + 1]).as_bytes()), Err(BadRequest::TooLarge));
    }
}
