//! The protocol over HTTP, for assistants that do not start the server themselves: MCP's streamable HTTP, with the official
//! SDK. Each request is answered by itself, as JSON; there are no sessions.
//!
//! A client needs the token, as `Authorization: Bearer TOKEN` or as `?token=TOKEN`. Connections that have not shown it have
//! a pool of their own, in which a new one takes the place of the oldest: they keep no client out. Pages of browsers are refused: requests
//! with an `Origin`, and on loopback those whose `Host` is not a loopback name (DNS rebinding).

use crate::{Assistant, MAX_MESSAGE_BYTES, MapServer, McpError};
use http_body_util::combinators::BoxBody;
use http_body_util::{BodyExt, Full};
use hyper::body::{Bytes, Incoming};
use hyper::header::{AUTHORIZATION, CONTENT_TYPE, WWW_AUTHENTICATE};
use hyper::service::service_fn;
use hyper::{Request, Response, StatusCode};
use hyper_util::rt::{TokioIo, TokioTimer};
use rmcp::transport::streamable_http_server::session::never::NeverSessionManager;
use rmcp::transport::{StreamableHttpServerConfig, StreamableHttpService};
use splatseg_view::{Reach, Token};
use std::collections::BTreeMap;
use std::convert::Infallible;
use std::net::{SocketAddr, TcpListener};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::task::AbortHandle;

/// Path of the protocol.
const PATH: &str = "/mcp";
/// Most connections at the same time that have shown the token.
const MAX_CONNECTIONS: usize = 32;
/// Most connections at the same time that have not.
const MAX_STRANGERS: usize = 64;
/// A client must send the head of its request within this time.
const HEAD_TIME: Duration = Duration::from_secs(10);
/// Pause after the system has refused a connection, e.g. for lack of files.
const RETRY: Duration = Duration::from_millis(100);

/// Where a map is served over HTTP.
#[derive(Clone, Debug)]
pub struct HttpOptions {
    /// The address; port 0 for any free one.
    pub address: SocketAddr,
    /// Whether other computers may reach it.
    pub reach: Reach,
    /// The clients' password; `None` for a random token.
    pub token: Option<Token>,
}

/// A server of a map over HTTP.
pub struct HttpServer {
    listener: TcpListener,
    address: SocketAddr,
    answers: Arc<Answers>,
}

impl HttpServer {
    /// Opens the port.
    ///
    /// # Errors
    /// If the port is in use, or if its address can be reached from other computers and [`HttpOptions::reach`] does not
    /// allow that.
    pub fn bind(options: HttpOptions, assistant: Assistant) -> Result<Self, McpError> {
        let HttpOptions { address, reach, token } = options;
        let failed = |problem: String| McpError::Address { address, problem };
        if reach == Reach::Loopback && !address.ip().to_canonical().is_loopback() {
            return Err(failed("other computers could reach it".to_owned()));
        }
        let token = token.map_or_else(Token::random, Ok).map_err(|error| failed(error.to_string()))?;
        let listener = TcpListener::bind(address).map_err(|error| failed(error.to_string()))?;
        listener.set_nonblocking(true).map_err(|error| failed(error.to_string()))?;
        let address = listener.local_addr().map_err(|error| failed(error.to_string()))?;
        let config = StreamableHttpServerConfig::default()
            .with_legacy_session_mode(false)
            .with_json_response(true)
            .with_max_request_body_bytes(MAX_MESSAGE_BYTES)
            .enforce_origin_validation();
        let config = if reach == Reach::Loopback { config } else { config.disable_allowed_hosts() };
        let server = MapServer::new(assistant);
        let service = StreamableHttpService::new(move || Ok(server.clone()), Arc::default(), config);
        Ok(Self { listener, address, answers: Arc::new(Answers { token, service }) })
    }

    /// The address that it listens on, with its port.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// The token that clients must send.
    pub fn token(&self) -> &Token {
        &self.answers.token
    }

    /// The URL of the protocol, without the token.
    pub fn url(&self) -> String {
        format!("http://{}{PATH}", self.address)
    }

    /// Answers clients until the program ends.
    ///
    /// # Errors
    /// If the system gives no threads.
    pub fn serve(self) -> Result<(), McpError> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
        let runtime = runtime.map_err(|error| McpError::Connection(error.to_string()))?;
        runtime.block_on(self.accept())
    }

    /// Answers one client on a stream that is open already, until either side closes it.
    pub async fn serve_on<S: AsyncRead + AsyncWrite + Unpin>(&self, stream: S) {
        self.answers.serve_on(stream, || true).await;
    }

    async fn accept(self) -> Result<(), McpError> {
        let Self { listener, answers, .. } = self;
        let listener = tokio::net::TcpListener::from_std(listener);
        let listener = listener.map_err(|error| McpError::Connection(error.to_string()))?;
        let connections = Arc::new(Connections::default());
        for number in 0.. {
            let Ok((stream, _)) = listener.accept().await else {
                tokio::time::sleep(RETRY).await;
                continue;
            };
            let (answers, place) = (Arc::clone(&answers), Place { connections: Arc::clone(&connections), number });
            let task = tokio::spawn(async move { answers.serve_on(stream, || place.admit()).await });
            // All tasks are on this thread, so that this one has not begun.
            connections.add(number, task.abort_handle());
        }
        Ok(())
    }
}

/// The open connections, by number, in the order of their coming.
#[derive(Default)]
struct Connections(Mutex<BTreeMap<u64, Open>>);

struct Open {
    task: AbortHandle,
    has_shown_token: bool,
}

impl Connections {
    fn lock(&self) -> MutexGuard<'_, BTreeMap<u64, Open>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds a connection. Too many without the token cost the oldest of them its place.
    fn add(&self, number: u64, task: AbortHandle) {
        let mut open = self.lock();
        let strangers: Vec<u64> =
            open.iter().filter(|(_, other)| !other.has_shown_token).map(|(number, _)| *number).collect();
        if strangers.len() >= MAX_STRANGERS
            && let Some(oldest) = strangers.first().and_then(|oldest| open.remove(oldest))
        {
            oldest.task.abort();
        }
        open.insert(number, Open { task, has_shown_token: false });
    }
}

/// The place of an open connection, which it leaves at the end.
struct Place {
    connections: Arc<Connections>,
    number: u64,
}

impl Place {
    /// Records that the connection has shown the token. Returns false if too many others have.
    fn admit(&self) -> bool {
        let mut open = self.connections.lock();
        let known = open.iter().filter(|(number, other)| **number != self.number && other.has_shown_token).count();
        let has_room = known < MAX_CONNECTIONS;
        if let (true, Some(own)) = (has_room, open.get_mut(&self.number)) {
            own.has_shown_token = true;
        }
        has_room
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.connections.lock().remove(&self.number);
    }
}

/// Shared by all connections.
struct Answers {
    token: Token,
    service: StreamableHttpService<MapServer, NeverSessionManager>,
}

impl Answers {
    /// Answers a client. `admit` is called once a request has the token; if it returns false, there are too many clients.
    async fn serve_on<S: AsyncRead + AsyncWrite + Unpin>(&self, stream: S, admit: impl Fn() -> bool) {
        let answer = service_fn(async |request| Ok::<_, Infallible>(self.answer(request, &admit).await));
        // A client that leaves or sends no HTTP is its own problem.
        let _ = hyper::server::conn::http1::Builder::new()
            .timer(TokioTimer::new())
            .header_read_timeout(HEAD_TIME)
            .serve_connection(TokioIo::new(stream), answer)
            .await;
    }

    /// The answer to a request.
    async fn answer(
        &self,
        request: Request<Incoming>,
        admit: &impl Fn() -> bool,
    ) -> Response<BoxBody<Bytes, Infallible>> {
        if request.uri().path() != PATH {
            return refused(StatusCode::NOT_FOUND, "this server has only /mcp");
        }
        let header = request.headers().get(AUTHORIZATION).and_then(|value| value.to_str().ok());
        let bearer = header.and_then(|value| value.strip_prefix("Bearer ")).map(str::trim);
        let query = request.uri().query().unwrap_or_default();
        let in_query = query.split('&').find_map(|pair| pair.strip_prefix("token="));
        if !bearer.or(in_query).is_some_and(|given| self.token.matches(given)) {
            let mut response =
                refused(StatusCode::UNAUTHORIZED, "the token that the server has printed is missing or wrong");
            response.headers_mut().insert(WWW_AUTHENTICATE, hyper::header::HeaderValue::from_static("Bearer"));
            return response;
        }
        if !admit() {
            return refused(StatusCode::SERVICE_UNAVAILABLE, "there are too many clients");
        }
        self.service.handle(request).await
    }
}

fn refused(status: StatusCode, text: &'static str) -> Response<BoxBody<Bytes, Infallible>> {
    let mut response = Response::new(Full::new(Bytes::from_static(text.as_bytes())).boxed());
    *response.status_mut() = status;
    response.headers_mut().insert(CONTENT_TYPE, hyper::header::HeaderValue::from_static("text/plain; charset=utf-8"));
    response
}
