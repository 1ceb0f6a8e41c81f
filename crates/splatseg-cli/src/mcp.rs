//! `splatseg mcp`: a saved map for assistants.

use super::Failure;
use super::name::open_network;
use super::options::memory_limit;
use clap::Args;
use splatseg_mcp::{Assistant, AssistantOptions, McpError, floor_places, serve_stdio};
use std::path::PathBuf;

#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    splatseg mcp map.ply --objects out/objects.json\n  \
    splatseg mcp home.ply --allow-write                  # a map that `live` or `ros2` keeps\n  \
    splatseg mcp tuesday.ply --earlier monday.ply\n\n\
    An assistant's program starts this command itself and talks to it through standard input and output (Model Context\n\
    Protocol): docs/ASSISTANT.md has the lines for its configuration, and the tools. Nothing else is read or written, and\n\
    no network is used. When the map's file changes, the next answer is of the new map.")]
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
    #[arg(long, value_name = "SIZE")]
    pub memory_limit: Option<String>,
}

/// Serves a map until standard input ends.
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
    let assistant = Assistant::with_places(options, Box::new(floor_places)).map_err(Failure::input)?;
    serve_stdio(assistant).map_err(|error| match error {
        // A person at a terminal, or a program that speaks something else.
        McpError::Connection(_) => Failure::input(error),
        _ => Failure::runtime(error),
    })
}
