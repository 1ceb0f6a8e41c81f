//! `splatseg mcp` in a program without the feature `mcp`: says how to build it.

use super::Failure;
use clap::Args;

const HOW: &str = "this build of splatseg has no server for assistants: build it with --features mcp, e.g. cargo install \
                   --path crates/splatseg-cli --features networks,ros2,mcp --profile dist";

#[derive(Debug, Args)]
#[command(after_help = HOW)]
pub struct McpArguments {
    #[arg(hide = true, trailing_var_arg = true, allow_hyphen_values = true)]
    ignored: Vec<std::ffi::OsString>,
}

/// Refuses `splatseg mcp`.
pub fn mcp(_: &McpArguments) -> Result<(), Failure> {
    Err(Failure::input(HOW))
}
