//! The protocol: MCP over a pair of byte streams, with the official SDK.

use crate::tool::Outcome;
use crate::{Assistant, McpError, lines};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use rmcp::model::{
    CallToolRequestParams, CallToolResponse, CallToolResult, ContentBlock, ErrorData, Implementation, ListToolsResult,
    PaginatedRequestParams, ServerCapabilities, ServerConfig, Tool,
};
use rmcp::service::{RequestContext, RoleServer};
use rmcp::transport::async_rw::AsyncRwTransport;
use rmcp::{ServerHandler, ServiceExt};
use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite, duplex};
use tokio::sync::Mutex;

/// Longer messages of a client are refused, bytes. No tool needs more.
pub const MAX_MESSAGE_BYTES: usize = 1 << 20;
/// Bytes that wait between a client and the SDK.
const BUFFER: usize = 64 << 10;
/// How long the program waits for a call that still runs when the client has gone.
const LAST_CALL: Duration = Duration::from_secs(2);

/// Serves a map to one client.
#[derive(Clone)]
pub struct MapServer {
    /// Calls come one after the other.
    assistant: Arc<Mutex<Assistant>>,
    tools: Arc<[Tool]>,
    config: ServerConfig,
}

impl MapServer {
    /// A server with the tools of an assistant.
    pub fn new(mut assistant: Assistant) -> Self {
        let about =
            Implementation::new("splatseg", env!("CARGO_PKG_VERSION")).with_title("splatseg: objects of a place");
        let config = ServerConfig::new(ServerCapabilities::builder().enable_tools().build())
            .with_server_info(about)
            .with_instructions(assistant.instructions());
        let tools = assistant.tools().cloned().collect();
        Self { assistant: Arc::new(Mutex::new(assistant)), tools, config }
    }

    /// Serves a client until it closes its side of the connection. Anything but a message of the protocol is answered as
    /// the protocol says or dropped; it does not end the connection. Lines that are no JSON, or longer than
    /// [`MAX_MESSAGE_BYTES`], are answered with the error -32700.
    ///
    /// # Errors
    /// [`McpError::Connection`] if the client leaves before the protocol has begun, or the connection fails.
    ///
    /// # Panics
    /// On a runtime of Tokio without timers.
    pub async fn serve_on<R, W>(self, from_client: R, to_client: W) -> Result<(), McpError>
    where
        R: AsyncRead + Send + Unpin + 'static,
        W: AsyncWrite + Send + Unpin + 'static,
    {
        let failed = |error: String| McpError::Connection(error);
        let ((to_sdk, of_client), (to_answer, of_sdk)) = (duplex(BUFFER), duplex(BUFFER));
        let (errors, wrong) = tokio::sync::mpsc::channel(lines::WAITING);
        let passing = tokio::spawn(lines::pass_on(from_client, to_sdk, errors));
        let answering = tokio::spawn(lines::answer(of_sdk, to_client, wrong));
        let transport = AsyncRwTransport::new_server(of_client, to_answer).with_max_line_length(MAX_MESSAGE_BYTES);
        let served = match self.serve(transport).await {
            Ok(running) => running.waiting().await.map(drop).map_err(|error| failed(error.to_string())),
            Err(error) => Err(failed(error.to_string())),
        };
        // If the protocol has not begun, more of the client's lines may wait. The last answers have some time to leave.
        passing.abort();
        let _ = tokio::time::timeout(LAST_CALL, answering).await;
        served
    }
}

impl ServerHandler for MapServer {
    fn get_info(&self) -> ServerConfig {
        self.config.clone()
    }

    async fn list_tools(
        &self,
        _: Option<PaginatedRequestParams>,
        _: RequestContext<RoleServer>,
    ) -> Result<ListToolsResult, ErrorData> {
        Ok(ListToolsResult::with_all_items(self.tools.to_vec()))
    }

    fn get_tool(&self, name: &str) -> Option<Tool> {
        self.tools.iter().find(|tool| tool.name == name).cloned()
    }

    async fn call_tool(
        &self,
        request: CallToolRequestParams,
        context: RequestContext<RoleServer>,
    ) -> Result<CallToolResponse, ErrorData> {
        // The SDK also cancels a call whose id another request takes while it runs, so a client may see this.
        let cancelled = || ErrorData::invalid_request("the call was cancelled", None);
        // A cancelled call that waits for its turn never begins. One that has begun ends, and its answer is dropped.
        let assistant = tokio::select! {
            assistant = Arc::clone(&self.assistant).lock_owned() => assistant,
            () = context.ct.cancelled() => return Err(cancelled()),
        };
        let call = tokio::task::spawn_blocking(move || {
            let mut assistant = assistant;
            assistant
                .call(&request.name, request.arguments.unwrap_or_default())
                .ok_or_else(|| unknown(&assistant, &request.name))
        });
        let outcome = tokio::select! {
            ended = call => ended.map_err(|error| ErrorData::internal_error(format!("the tool failed: {error}"), None))?,
            () = context.ct.cancelled() => return Err(cancelled()),
        };
        Ok(result(outcome?).into())
    }
}

/// The error for a tool that does not exist.
fn unknown(assistant: &Assistant, name: &str) -> ErrorData {
    let known: Vec<&str> = assistant.tools().map(|tool| tool.name.as_ref()).collect();
    let name: String = name.chars().take(100).collect();
    ErrorData::invalid_params(format!("there is no tool {name:?}, only {}", known.join(", ")), None)
}

/// Result of a call, in the protocol's form.
fn result(outcome: Outcome) -> CallToolResult {
    let mut content = vec![ContentBlock::text(outcome.text)];
    if let Some(picture) = outcome.picture {
        content.push(ContentBlock::image(STANDARD.encode(picture.bytes), picture.mime_type));
    }
    match outcome.data {
        None => CallToolResult::error(content),
        Some(data) => {
            let mut result = CallToolResult::success(content);
            result.structured_content = Some(data);
            result
        }
    }
}

/// Serves an assistant on standard input and output, until standard input ends. Nothing else may be printed there.
///
/// # Errors
/// As [`MapServer::serve_on`], or if the system gives no threads.
pub fn serve_stdio(assistant: Assistant) -> Result<(), McpError> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    let runtime = runtime.map_err(|error| McpError::Connection(error.to_string()))?;
    let served = runtime.block_on(async {
        let (from_client, to_client) = rmcp::transport::io::stdio_pipes();
        MapServer::new(assistant).serve_on(from_client, to_client).await
    });
    runtime.shutdown_timeout(LAST_CALL);
    served
}
