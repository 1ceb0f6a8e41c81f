//! `splatseg ros2` in a program without the feature `ros2`: says how to build it.

use crate::Failure;
use clap::Args;
use std::ffi::OsString;

const HOW: &str = "this build of splatseg has no ROS 2 node: build it with --features ros2, e.g. cargo install --path \
                   crates/splatseg-cli --features networks,ros2,mcp --profile dist";

#[derive(Debug, Args)]
#[command(after_help = HOW)]
pub struct Ros2Arguments {
    #[arg(hide = true, trailing_var_arg = true, allow_hyphen_values = true)]
    ignored: Vec<OsString>,
}

/// Refuses `splatseg ros2`.
pub fn ros2(_: &Ros2Arguments, _: &[OsString]) -> Result<(), Failure> {
    Err(Failure::input(HOW))
}
