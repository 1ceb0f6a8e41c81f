//! The layout of the help: which options `-h` shows, and the groups of `--help`.

use clap::{Arg, Command};

/// The headings of `--help`, in order, with the options below each, by their ids. Options of no group are below
/// `Options`.
const GROUPS: [(&str, &[&str]); 6] = [
    (
        "Results",
        &[
            "out",
            "overwrite",
            "resume",
            "open",
            "save_memory",
            "save_coco",
            "save_mcap",
            "save_every",
            "no_page",
            "no_overlay",
            "online",
        ],
    ),
    (
        "Reading the scene",
        &["format", "preset", "stride", "start", "max_frames", "resize", "crop_border", "strict_input"],
    ),
    (
        "Camera and topics",
        &[
            "fx",
            "fy",
            "cx",
            "cy",
            "depth_scale",
            "max_depth_m",
            "pose_convention",
            "quaternion_order",
            "pose_scale",
            "color",
            "depth",
            "camera_info",
            "pose",
            "world_frame",
            "pose_frame",
            "register_depth",
            "max_time_difference_ms",
        ],
    ),
    (
        "Method",
        &[
            "method",
            "method_preset",
            "segmenter",
            "weights",
            "masks",
            "detail",
            "rotate",
            "poses",
            "load_memory",
            "tracker",
            "tracker_weights",
            "prompts",
            "names",
            "vocabulary",
            "depth_weights",
            "predicted_depth",
        ],
    ),
    ("Settings", &["config", "set", "seed"]),
    ("Machine", &["device", "threads", "memory_limit"]),
];

/// The options that `-h` shows of the commands that process a scene; all others only have `--help`.
const SHORT: [&str; 15] = [
    "out",
    "overwrite",
    "resume",
    "open",
    "save_memory",
    "load_memory",
    "save_mcap",
    "stride",
    "max_frames",
    "resize",
    "segmenter",
    "names",
    "poses",
    "config",
    "set",
];

/// Commands with more options than this show only a choice of them with `-h`.
const MANY: usize = 30;

/// Arranges the options of a command and of its subcommands.
pub fn arranged(command: Command) -> Command {
    let has_many = command.get_arguments().count() > MANY;
    let arrange = |argument: Arg| {
        let id = argument.get_id().to_string();
        let is_shown = argument.is_positional() || argument.is_required_set() || SHORT.contains(&id.as_str());
        // Only commands that process a scene have so many.
        let is_own = GROUPS.iter().all(|(_, ids)| !ids.contains(&id.as_str()));
        let argument = if has_many && !is_shown && !is_own { argument.hide_short_help(true) } else { argument };
        match GROUPS.iter().find(|(_, ids)| ids.contains(&id.as_str())) {
            Some((heading, _)) if has_many => argument.help_heading(*heading),
            _ => argument,
        }
    };
    command.mut_args(arrange).mut_subcommands(arranged)
}
