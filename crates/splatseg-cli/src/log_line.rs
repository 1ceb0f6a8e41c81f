//! The form of a line of the log.

use std::fmt;
use tracing::{Event, Level, Subscriber};
use tracing_subscriber::fmt::format::{Format, Full, Writer};
use tracing_subscriber::fmt::{FmtContext, FormatEvent, FormatFields};
use tracing_subscriber::registry::LookupSpan;

/// Warnings and errors look as those of the command itself: `warning: …`. Events that `RUST_LOG` asks for have their
/// level and spans, as `tracing` writes them.
pub struct LogLine(pub Format<Full, ()>);

impl<S, N> FormatEvent<S, N> for LogLine
where
    S: Subscriber + for<'a> LookupSpan<'a>,
    N: for<'a> FormatFields<'a> + 'static,
{
    fn format_event(&self, context: &FmtContext<'_, S, N>, mut writer: Writer<'_>, event: &Event<'_>) -> fmt::Result {
        let start = match *event.metadata().level() {
            Level::ERROR => "error: ",
            Level::WARN => "warning: ",
            _ => return self.0.format_event(context, writer, event),
        };
        writer.write_str(start)?;
        context.format_fields(writer.by_ref(), event)?;
        writeln!(writer)
    }
}
