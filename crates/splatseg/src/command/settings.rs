//! `splatseg settings`: lists every setting.

use super::Failure;
use clap::Args;
use splatseg::settings::markdown;

#[derive(Debug, Args)]
#[command(after_long_help = "Settings are given in a TOML file (--config), as options, or with --set KEY=VALUE.")]
pub struct SettingsArguments {
    /// List only settings whose key contains this, e.g. memory
    pub key: Option<String>,
}

/// Prints settings as in `docs/SETTINGS.md`.
pub fn settings(arguments: &SettingsArguments) -> Result<(), Failure> {
    let text = markdown(arguments.key.as_deref().unwrap_or_default());
    match text {
        Some(text) => {
            say!("{}", text.trim_end());
            Ok(())
        }
        None => Err(Failure::input(format!(
            "no setting has a key that contains {}",
            arguments.key.as_deref().unwrap_or_default()
        ))),
    }
}
