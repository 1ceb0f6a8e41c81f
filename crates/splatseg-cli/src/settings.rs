//! `splatseg settings`: lists every setting.

use super::Failure;
use clap::Args;
use splatseg::settings::{describe_settings, markdown};

#[derive(Debug, Args)]
#[command(after_long_help = "Set them in a TOML file (--config), as options, or with --set KEY=VALUE.")]
pub struct SettingsArguments {
    /// A setting or a section, e.g. memory.max_votes or memory; by default all
    pub name: Option<String>,
}

/// Prints all settings as in `docs/SETTINGS.md`, or one setting or section.
pub fn settings(arguments: &SettingsArguments) -> Result<(), Failure> {
    let text = match &arguments.name {
        None => markdown(),
        Some(name) => describe_settings(name).map_err(|nearest| {
            let nearest = nearest.map(|nearest| format!(", did you mean {nearest}?"));
            Failure::input(format!("there is no setting or section {name}{}", nearest.unwrap_or_default()))
        })?,
    };
    say!("{}", text.trim_end());
    Ok(())
}
