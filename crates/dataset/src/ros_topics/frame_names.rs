//! Names of coordinate frames and topics.

/// Removes leading slashes, as of ROS 1, from a frame's name.
pub(crate) fn bare_frame(name: &str) -> &str {
    name.trim_start_matches('/')
}

/// Replaces control characters in a name from a file, because messages are one line.
pub(crate) fn one_line(name: &str) -> String {
    name.replace(char::is_control, "\u{fffd}")
}

/// Returns a frame's name in one line, without the leading slash of ROS 1.
pub(crate) fn frame_name(name: &str) -> String {
    one_line(bare_frame(name))
}
