//! Errors of a device, shortened to their cause.

use splatseg_files::display_bytes;

/// Extracts the root cause of a device's error, on one line, without the chain of computations that it made fail.
pub(crate) fn root_cause(message: &str) -> String {
    const NO_ROOM: &str = "can't allocate buffer of size: ";
    let size =
        message.split(NO_ROOM).nth(1).map(|rest| rest.chars().take_while(char::is_ascii_digit).collect::<String>());
    if let Some(bytes) = size.and_then(|digits| digits.parse::<u64>().ok()) {
        return format!("not enough memory for a buffer of {}", display_bytes(bytes));
    }
    let last = message.rsplit("Caused by:").next().unwrap_or(message);
    let lines =
        last.lines().map(str::trim).take_while(|line| !line.starts_with("Asked at") && !line.contains("backtrace"));
    lines.filter(|line| !line.is_empty()).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The message of Burn 0.22 for a buffer that is too large for the device.
    const CHAIN: &str = "An error happened during execution\nCaused by:\n  Several failures at once\nCaused by:\n  The \
        bytes were never written\n  skipped `KernelBinop`\nCaused by:\n  An IO error happened\nCaused by:\n  can't \
        allocate buffer of size: 176160768\nNo backtrace available\nAsked at:\nNo backtrace available";

    #[test]
    fn the_root_cause_is_the_last_of_the_chain() {
        assert_eq!(root_cause(CHAIN), "not enough memory for a buffer of 176 MB");
        let lost = CHAIN.replace("can't allocate buffer of size: 176160768", "Parent device is lost");
        assert_eq!(root_cause(&lost), "Parent device is lost");
        assert_eq!(root_cause("no adapter\n"), "no adapter");
    }
}
