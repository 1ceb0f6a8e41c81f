//! `splatseg settings`: lists every setting.

use super::Failure;
use crate::settings::{describe_settings, markdown};
use clap::Args;

#[derive(Debug, Args)]
#[command(after_long_help = "Settings are given in a TOML file (--config), as options, or with --set KEY=VALUE.")]
pub struct SettingsArguments {
    /// A setting or a section, e.g. memory.max_votes or memory; all if left out
    pub name: Option<String>,
}

/// Prints settings as in `docs/SETTINGS.md`, or one of them.
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
