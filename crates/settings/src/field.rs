//! The description of a setting, from which checks, help and `docs/SETTINGS.md` are made.

use crate::{Allowed, SettingError};

/// One setting of a section.
#[derive(Clone, Debug)]
pub struct Field {
    /// The section that it is in; empty at the top level.
    pub section: &'static str,
    /// Its name in the section.
    pub name: &'static str,
    /// Its default as TOML; `None` if it has none.
    pub default: Option<String>,
    /// Its allowed values.
    pub allowed: Allowed,
    /// Whether its type holds whole numbers only.
    pub whole: bool,
    /// Whether a text can be read as its value; only asked of settings that are written as text.
    pub is_text_of: fn(&str) -> bool,
    /// What it does.
    pub help: String,
    /// The choice that it needs, e.g. `memory.kind = features`; `None` if it needs no more than its section does.
    pub only: Option<&'static str>,
}

impl Field {
    /// Its full key, e.g. `memory.max_votes`.
    pub fn key(&self) -> String {
        full_key(self.section, self.name)
    }

    /// The error for the value `found`.
    pub fn error(&self, found: impl Into<String>) -> SettingError {
        let whole = if self.whole { "a whole number, " } else { "" };
        SettingError { key: self.key(), found: found.into(), expected: format!("{whole}{}", self.allowed) }
    }

    /// The help text of a doc comment: one paragraph, without links.
    #[doc(hidden)]
    pub fn help_of(doc: &str) -> String {
        let words: Vec<&str> = doc.split_whitespace().collect();
        words.join(" ").replace("[`", "`").replace("`]", "`")
    }
}

/// The key of a setting in a section; the section is empty at the top level.
pub fn full_key(section: &str, name: &str) -> String {
    if section.is_empty() { name.to_owned() } else { format!("{section}.{name}") }
}

/// A struct of settings, made by [`settings!`](crate::settings).
pub trait Section: Default {
    /// Its name, the first part of its keys; empty at the top level.
    const SECTION: &'static str;

    /// Its settings and those of the sections in it, in order of declaration.
    fn fields() -> Vec<Field>;
}
