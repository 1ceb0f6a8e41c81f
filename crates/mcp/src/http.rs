//! The protocol over HTTP, for assistants that do not start the server themselves: MCP's streamable HTTP, with the official
//! SDK. Each request is answered by itself, as JSON; there are no sessions.
//!
//! A client needs the token, as `Authorization: Bearer TOKEN` or as `?token=TOKEN`. Pages of browsers are refused: requests
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
use std::convert::Infallible;
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::sync::Semaphore;

/// Path of the protocol.
const PATH: &str = "/mcp";
/// Most connections at the same time; others wait.
const MAX_CONNECTIONS: usize = 32;
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
        self.answers.serve_on(stream).await;
    }

    async fn accept(self) -> Result<(), McpError> {
        let Self { listener, answers, .. } = self;
        let listener = tokio::net::TcpListener::from_std(listener);
        let listener = listener.map_err(|error| McpError::Connection(error.to_string()))?;
        let places = Arc::new(Semaphore::new(MAX_CONNECTIONS));
        loop {
            let Ok(place) = Arc::clone(&places).acquire_owned().await else { return Ok(()) };
            let Ok((stream, _)) = listener.accept().await else {
                tokio::time::sleep(RETRY).await;
                continue;
            };
            let answers = Arc::clone(&answers);
            tokio::spawn(async move {
                let _place = place;
                answers.serve_on(stream).await;
            });
        }
    }
}

/// Shared by all connections.
struct Answers {
    token: Token,
    service: StreamableHttpService<MapServer, NeverSessionManager>,
}

impl Answers {
    async fn serve_on<S: AsyncRead + AsyncWrite + Unpin>(&self, stream: S) {
        let answer = service_fn(async |request| Ok::<_, Infallible>(self.answer(request).await));
        // A client that leaves or sends no HTTP is its own problem.
        let _ = hyper::server::conn::http1::Builder::new()
            .timer(TokioTimer::new())
            .header_read_timeout(HEAD_TIME)
            .serve_connection(TokioIo::new(stream), answer)
            .await;
    }

    /// The answer to a request.
    async fn answer(&self, request: Request<Incoming>) -> Response<BoxBody<Bytes, Infallible>> {
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
        self.service.handle(request).await
    }
}

fn refused(status: StatusCode, text: &'static str) -> Response<BoxBody<Bytes, Infallible>> {
    let mut response = Response::new(Full::new(Bytes::from_static(text.as_bytes())).boxed());
    *response.status_mut() = status;
    response.headers_mut().insert(CONTENT_TYPE, hyper::header::HeaderValue::from_static("text/plain; charset=utf-8"));
    response
}
