//! `splatseg settings`: lists every setting.

use super::Failure;
use clap::Args;
use splatseg::settings::{describe_settings, described_settings, markdown, settings_text};
use std::io::IsTerminal;

/// Width of a terminal of unknown size, and the largest that lines use.
const WIDTHS: (usize, usize) = (80, 100);

#[derive(Debug, Args)]
#[command(after_long_help = "Set them in a TOML file (--config), as options, or with --set KEY=VALUE.\n\n\
    Without a terminal, the output is Markdown, as in docs/SETTINGS.md.")]
pub struct SettingsArguments {
    /// A setting or a section, e.g. memory.max_votes or memory; by default all
    pub name: Option<String>,
    /// Print a JSON list with key, default, paper_default, allowed, used_with and help of each setting
    #[arg(long)]
    pub json: bool,
}

/// Prints all settings, or one setting or section: as text in a terminal, otherwise as in `docs/SETTINGS.md`.
pub fn settings(arguments: &SettingsArguments) -> Result<(), Failure> {
    let name = arguments.name.as_deref();
    let unknown = |nearest: Option<String>| {
        let nearest = nearest.map(|nearest| format!(", did you mean {nearest}?"));
        let name = name.unwrap_or_default();
        Failure::input(format!("there is no setting or section {name}{}", nearest.unwrap_or_default()))
    };
    let text = if arguments.json {
        let settings = described_settings(name).map_err(unknown)?;
        serde_json::to_string_pretty(&settings).map_err(Failure::runtime)?
    } else if std::io::stdout().is_terminal() {
        settings_text(name, width()).map_err(unknown)?
    } else {
        name.map_or_else(|| Ok(markdown()), describe_settings).map_err(unknown)?
    };
    say!("{}", text.trim_end());
    Ok(())
}

/// Width of the terminal, characters.
fn width() -> usize {
    let (unknown, most) = WIDTHS;
    let columns = terminal_size::terminal_size().map(|(terminal_size::Width(columns), _)| usize::from(columns));
    columns.unwrap_or(unknown).clamp(20, most)
}
