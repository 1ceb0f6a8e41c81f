//! `splatseg mcp`: a saved map for assistants.

use super::Failure;
use super::name::open_network;
use super::options::memory_limit;
use clap::Args;
use splatseg_mcp::{Assistant, AssistantOptions, HttpOptions, HttpServer, McpError, floor_places, serve_stdio};
use splatseg_view::{Reach, Token};
use std::net::SocketAddr;
use std::path::PathBuf;

#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    splatseg mcp map.ply --objects out/objects.json\n  \
    splatseg mcp home.ply --allow-write                  # a map that `live` or `ros2` keeps\n  \
    splatseg mcp tuesday.ply --earlier monday.ply\n  \
    splatseg mcp home.ply --http                         # for a program that does not start the command itself\n\n\
    An assistant's program starts this command itself and talks to it through standard input and output (Model Context\n\
    Protocol): docs/ASSISTANT.md has the lines for its configuration, and the tools. Nothing else is read or written, and\n\
    no network is used, but for --http. When the map's file changes, the next answer is of the new map.")]
pub struct McpArguments {
    /// The map: a memory saved by `run --save-memory`, `live --map` or a program
    pub map: PathBuf,
    /// The objects.json of the run that saved the map, which tells when each object was seen
    /// [default: home.objects.json beside home.ply, if it exists]
    #[arg(long, value_name = "FILE.json")]
    pub objects: Option<PathBuf>,
    /// An earlier map of the place, to tell what has changed
    #[arg(long, value_name = "FILE.ply")]
    pub earlier: Option<PathBuf>,
    /// Network for images and words, with which the objects were named
    #[arg(long, value_name = "FILE")]
    pub names: Option<PathBuf>,
    /// Let the assistant name objects, in the map's file; without it, nothing is written
    #[arg(long)]
    pub allow_write: bool,
    /// Serve clients over HTTP instead; they need the token, which is printed
    #[arg(
        long,
        value_name = "ADDRESS:PORT",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "127.0.0.1:8766"
    )]
    pub http: Option<SocketAddr>,
    /// With --http, allow an address that other computers can reach. There is no encryption
    #[arg(long, requires = "http")]
    pub allow_network: bool,
    /// With --http, a token of your own, 16 to 128 letters, digits, `-` or `_`; by default a random one
    #[arg(long, value_name = "TEXT", requires = "http")]
    pub token: Option<String>,
    #[arg(long, value_name = "SIZE")]
    pub memory_limit: Option<String>,
}

/// Serves a map until standard input ends, or over HTTP until the program does.
pub fn mcp(arguments: &McpArguments) -> Result<(), Failure> {
    memory_limit(arguments.memory_limit.as_ref())?.enforce();
    let network = arguments.names.as_deref().map(|network| open_network(network, None)).transpose()?;
    let options = AssistantOptions {
        map: arguments.map.clone(),
        objects: arguments.objects.clone(),
        earlier: arguments.earlier.clone(),
        network,
        allow_write: arguments.allow_write,
    };
    let token = arguments.token.as_deref().map(Token::new).transpose();
    let token = token.map_err(|error| Failure::input(format!("--token: {error}")))?;
    let assistant = Assistant::with_places(options, Box::new(floor_places)).map_err(Failure::input)?;
    if let Some(address) = arguments.http {
        let reach = if arguments.allow_network { Reach::Network } else { Reach::Loopback };
        return serve_http(HttpOptions { address, reach, token }, assistant);
    }
    serve_stdio(assistant).map_err(|error| match error {
        // A person at a terminal, or a program that speaks something else.
        McpError::Connection(_) => Failure::input(error),
        _ => Failure::runtime(error),
    })
}

/// Prints where clients find the map, and serves them.
fn serve_http(options: HttpOptions, assistant: Assistant) -> Result<(), Failure> {
    let server = HttpServer::bind(options, assistant).map_err(|error| match error {
        McpError::Address { address, .. } if !address.ip().is_loopback() => {
            Failure::input(format!("--http: {error}: give --allow-network if that is meant"))
        }
        _ => Failure::input(format!("--http: {error}")),
    })?;
    say_error!("url:   {}\ntoken: {}", server.url(), server.token().as_str());
    server.serve().map_err(Failure::runtime)
}
