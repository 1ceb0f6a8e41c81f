//! Names of coordinate frames and topics.

use crate::error::NAMES_IN_MESSAGES;

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

/// Lists the first few names and the number of the others.
pub(crate) fn listed(names: Vec<String>) -> String {
    let more = names.len().saturating_sub(2 * NAMES_IN_MESSAGES);
    let first = names.into_iter().take(2 * NAMES_IN_MESSAGES).collect::<Vec<_>>().join(", ");
    match (first.is_empty(), more) {
        (true, _) => "none found".to_owned(),
        (_, 0) => first,
        (_, more) => format!("{first} and {more} more"),
    }
}
