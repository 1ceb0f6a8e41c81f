//! Output to the terminal.
//!
//! Results go to standard output ([`say!`]), and so does the report about what was done ([`report!`]); messages while the
//! work goes on go to standard error ([`inform!`]), with warnings and errors ([`say_error!`]). `--quiet` leaves out
//! reports and messages. Only a terminal shows colours, and bars that move.
//!
//! Names and messages may come from files, which can contain terminal control sequences. All text for standard output,
//! standard error and the log is passed through [`escape`]. Progress bars contain no text from files and are not escaped.

use super::Failure;
use clap::builder::styling::AnsiColor;
use std::borrow::Cow;
use std::fmt;
use std::io::{ErrorKind, IsTerminal, Result, Write};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

/// Prints a line to standard output.
macro_rules! say {
    ($($text:tt)*) => { $crate::terminal::print_line(&format!($($text)*)) };
}

/// Prints a line about what was done to standard output, unless `--quiet` is given.
macro_rules! report {
    ($($text:tt)*) => { if !$crate::terminal::is_quiet() { $crate::terminal::print_line(&format!($($text)*)) } };
}

/// Prints a message to standard error, unless `--quiet` is given.
macro_rules! inform {
    ($($text:tt)*) => { if !$crate::terminal::is_quiet() { $crate::terminal::print_error_line(&format!($($text)*)) } };
}

/// Prints a warning or an error to standard error.
macro_rules! say_error {
    ($($text:tt)*) => { $crate::terminal::print_error_line(&format!($($text)*)) };
}

/// True if `--quiet` is given.
static QUIET: AtomicBool = AtomicBool::new(false);

/// The starts of lines on standard error that have a colour, as in the messages about invalid arguments.
const COLORED: [(&str, AnsiColor); 2] = [("error:", AnsiColor::Red), ("warning:", AnsiColor::Yellow)];

/// Leaves out reports and messages from now on.
pub fn be_quiet() {
    QUIET.store(true, Ordering::Relaxed);
}

/// Returns true if reports and messages are left out.
pub fn is_quiet() -> bool {
    QUIET.load(Ordering::Relaxed)
}

/// Returns true if standard error is a terminal that shows progress.
pub fn shows_progress() -> bool {
    std::io::stderr().is_terminal() && !is_quiet()
}

/// The first error writing standard output.
static OUTPUT_ERROR: OnceLock<String> = OnceLock::new();

/// Prints a line to standard output. A closed pipe (`splatseg … | head`) is not an error. [`check_output`] reports other
/// errors at the end, so that they do not stop the work.
pub fn print_line(text: &str) {
    let mut output = std::io::stdout().lock();
    let written = writeln!(output, "{}", escape(text)).and_then(|()| output.flush());
    record_output_error(written);
}

/// Prints lines that end with line breaks to standard output, as [`print_line`].
pub fn print_text(text: &str) {
    let mut output = std::io::stdout().lock();
    let written = output.write_all(escape(text).as_bytes()).and_then(|()| output.flush());
    record_output_error(written);
}

/// Prints a line to standard error. Errors are ignored. In a terminal, the word that starts a warning or an error has a
/// colour, unless `NO_COLOR` is set.
pub fn print_error_line(text: &str) {
    let escaped = escape(text);
    // It removes the colours where there is no terminal.
    let mut output = anstream::stderr().lock();
    let colored = COLORED.iter().find_map(|(start, color)| Some((start, color, escaped.strip_prefix(start)?)));
    let _ = match colored {
        Some((start, color, rest)) => {
            let style = color.on_default().bold();
            writeln!(output, "{style}{start}{style:#}{rest}")
        }
        None => writeln!(output, "{escaped}"),
    };
}

/// Records the first error writing standard output.
pub fn record_output_error(written: Result<()>) {
    if let Err(error) = written
        && error.kind() != ErrorKind::BrokenPipe
    {
        let _ = OUTPUT_ERROR.set(error.to_string());
    }
}

/// Checks that all of standard output was written.
///
/// # Errors
/// If standard output could not be written, except because its reader closed it.
pub fn check_output() -> std::result::Result<(), Failure> {
    match OUTPUT_ERROR.get() {
        Some(error) => Err(Failure::runtime(format!("standard output cannot be written: {error}"))),
        None => Ok(()),
    }
}

/// Escapes control characters (except line feed and tab) and characters that change the text direction, as in a Rust
/// string: the escape character becomes `\u{1b}`.
pub fn escape(text: &str) -> Cow<'_, str> {
    let turns = |character| matches!(character, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    let is_harmful =
        |character: char| (character.is_control() && character != '\n' && character != '\t') || turns(character);
    if !text.contains(is_harmful) {
        return Cow::Borrowed(text);
    }
    let mut escaped = String::with_capacity(text.len() + 16);
    for character in text.chars() {
        if is_harmful(character) {
            escaped.extend(character.escape_default());
        } else {
            escaped.push(character);
        }
    }
    Cow::Owned(escaped)
}

/// Standard error for the log, whose lines look as those of [`print_error_line`]. Each event is written in one piece.
pub struct LogOutput;

impl Write for LogOutput {
    fn write(&mut self, bytes: &[u8]) -> Result<usize> {
        let text = String::from_utf8_lossy(bytes);
        print_error_line(text.strip_suffix('\n').unwrap_or(&text));
        Ok(bytes.len())
    }

    fn flush(&mut self) -> Result<()> {
        std::io::stderr().flush()
    }
}

/// Formats a number of things: `1 frame`, `2 frames`.
pub fn counted(count: usize, thing: &str) -> impl fmt::Display {
    format!("{count} {thing}{}", if count == 1 { "" } else { "s" })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_are_escaped() {
        assert_eq!(escape("\x1b[31mred\x07\r"), "\\u{1b}[31mred\\u{7}\\r");
        assert_eq!(escape("\u{9b}31m \u{7f} \u{202e}gpj"), "\\u{9b}31m \\u{7f} \\u{202e}gpj");
        assert!(matches!(escape("two\nlines\tand ümlauts"), Cow::Borrowed(_)));
    }

    #[test]
    fn one_frame_is_not_1_frames() {
        assert_eq!(format!("{}, {}", counted(1, "frame"), counted(0, "frame")), "1 frame, 0 frames");
    }
}
