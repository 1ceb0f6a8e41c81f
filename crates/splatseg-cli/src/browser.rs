//! Opens a page in the browser.
//!
//! By hand: the crates for this (`open`, `opener`, `webbrowser`) start the same programs, and the demo's path has few
//! crates left.

use std::env;
use std::path::Path;
use std::process::{Command, Stdio};

/// Opens a file in the browser. Without a screen or a browser, a message says what to do instead.
pub fn open(page: &Path) {
    let absolute = std::path::absolute(page).unwrap_or_else(|_| page.to_owned());
    let started = has_screen() && opener(&absolute).is_some_and(|mut command| starts(&mut command));
    if !started {
        say_error!("warning: --open: there is no browser here: open {} yourself", absolute.display());
    }
}

/// Returns true if windows can be shown.
fn has_screen() -> bool {
    let is_set = |name| env::var_os(name).is_some_and(|value| !value.is_empty());
    !cfg!(target_os = "linux") || ["DISPLAY", "WAYLAND_DISPLAY", "WSL_DISTRO_NAME"].into_iter().any(is_set)
}

/// The command that opens a file on this system; `None` on an unknown one.
fn opener(page: &Path) -> Option<Command> {
    let (program, arguments): (&str, &[&str]) = match env::consts::OS {
        "macos" => ("open", &[]),
        "windows" => ("cmd", &["/C", "start", ""]),
        _ if env::var_os("WSL_DISTRO_NAME").is_some() => ("wslview", &[]),
        "linux" | "freebsd" => ("xdg-open", &[]),
        _ => return None,
    };
    let mut command = Command::new(program);
    command.args(arguments).arg(page);
    Some(command)
}

/// Starts a command that ends once it has told the browser. It may also be the browser itself, so it is not waited for.
fn starts(command: &mut Command) -> bool {
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn().is_ok()
}
