//! The description of a setting: the source of its checks, its help and `docs/SETTINGS.md`.

use crate::{Allowed, SettingError};

/// One setting of a section.
#[derive(Clone, Debug)]
pub struct Field {
    /// Section that contains the setting; empty at the top level.
    pub section: &'static str,
    /// Name within the section.
    pub name: &'static str,
    /// Default value as TOML; `None` without a default.
    pub default: Option<String>,
    /// Allowed values.
    pub allowed: Allowed,
    /// True if the type holds whole numbers only.
    pub whole: bool,
    /// Returns true if a text can be parsed as a value. Called only for settings written as text.
    pub is_text_of: fn(&str) -> bool,
    /// Doc comment, from which [`help`](Self::help) is made.
    pub doc: &'static str,
    /// The choice without which the setting is unused, e.g. `kettle.electric = true`; several are joined by ` or `.
    pub only: Option<&'static str>,
}

impl Field {
    /// Returns the full key, e.g. `memory.max_votes`.
    pub fn key(&self) -> String {
        full_key(self.section, self.name)
    }

    /// Returns the error for the invalid value `found`.
    pub fn error(&self, found: impl Into<String>) -> SettingError {
        let whole = if self.whole { "a whole number, " } else { "" };
        SettingError { key: self.key(), found: found.into(), expected: format!("{whole}{}", self.allowed) }
    }

    /// Returns the help text: the doc comment as one paragraph, without links.
    pub fn help(&self) -> String {
        let words: Vec<&str> = self.doc.split_whitespace().collect();
        words.join(" ").replace("[`", "`").replace("`]", "`")
    }
}

/// Returns the full key of a setting. The section is empty at the top level.
pub fn full_key(section: &str, name: &str) -> String {
    if section.is_empty() { name.to_owned() } else { format!("{section}.{name}") }
}

/// A struct of settings, declared with [`settings!`](crate::settings).
pub trait Section: Default {
    /// Name of the section, the first part of its keys; empty at the top level.
    const SECTION: &'static str;

    /// Returns the settings of this section and of the sections in it, in order of declaration.
    fn fields() -> Vec<Field>;

    /// Checks every setting.
    ///
    /// # Errors
    /// Names the first setting that is out of range.
    fn validate(&self) -> Result<(), SettingError>;
}
