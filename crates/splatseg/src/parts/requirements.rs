//! Settings, and the choices of parts without which they are not used.

use splatseg_settings::{Allowed, Field};
use std::fmt;

/// A setting and its requirements.
#[derive(Clone, Debug)]
pub struct Entry {
    /// The setting.
    pub field: Field,
    /// The requirements, all of which must be met; empty for settings that are always used.
    pub needs: Vec<Requirement>,
}

/// The values of settings that name a file or folder.
const PATH: &str = "a path";

impl Entry {
    /// Returns true if the setting names a file or folder.
    pub fn names_a_file(&self) -> bool {
        matches!(self.field.allowed, Allowed::Text(PATH))
    }
}

/// A requirement for using a setting.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Requirement {
    /// One of these choices.
    OneOf(Vec<ChosenValues>),
    /// Any choice but this one.
    Not(ChosenValues),
}

/// A choice and some of its values.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChosenValues {
    /// The setting that makes the choice, e.g. `method`.
    pub key: &'static str,
    /// The values.
    pub values: Vec<&'static str>,
}

impl Requirement {
    /// Returns the choices in the requirement.
    pub fn choices(&self) -> &[ChosenValues] {
        match self {
            Self::OneOf(choices) => choices,
            Self::Not(choice) => std::slice::from_ref(choice),
        }
    }

    fn one(key: &'static str, values: &[&'static str]) -> Self {
        Self::OneOf(vec![ChosenValues { key, values: values.to_vec() }])
    }
}

impl fmt::Display for Requirement {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OneOf(choices) => {
                let choices: Vec<String> = choices.iter().map(ToString::to_string).collect();
                formatter.write_str(&choices.join(" or "))
            }
            Self::Not(ChosenValues { key, values }) => {
                write!(formatter, "{key} other than {}", values.join(" or "))
            }
        }
    }
}

impl fmt::Display for ChosenValues {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{} = {}", self.key, self.values.join(" or "))
    }
}

/// Collects the settings of all parts.
#[derive(Default)]
pub(crate) struct Registry {
    pub(crate) entries: Vec<Entry>,
}

impl Registry {
    /// Adds settings that need the choices `needs`. A setting shared by several methods is one entry.
    pub(crate) fn add(&mut self, fields: Vec<Field>, needs: &[(&'static str, &[&'static str])]) {
        for field in fields {
            let known = self
                .entries
                .iter_mut()
                .find(|entry| entry.field.section == field.section && entry.field.name == field.name);
            if let Some(known) = known {
                for (need, (_, values)) in known.needs.iter_mut().zip(needs) {
                    if let Requirement::OneOf(choices) = need {
                        for choice in choices {
                            let new = values.iter().filter(|value| !choice.values.contains(value));
                            choice.values.extend(new.copied().collect::<Vec<_>>());
                        }
                    }
                }
                continue;
            }
            let mut needs: Vec<Requirement> = needs.iter().map(|(key, values)| Requirement::one(key, values)).collect();
            let choices = |only: &'static str| {
                let choice = |(key, value)| ChosenValues { key, values: vec![value] };
                Requirement::OneOf(only.split(" or ").filter_map(|one| one.split_once(" = ")).map(choice).collect())
            };
            needs.extend(field.only.map(choices));
            self.entries.push(Entry { field, needs });
        }
    }

    /// Adds a requirement to a top-level setting.
    pub(crate) fn require(&mut self, name: &str, need: Requirement) {
        let is_named = |entry: &&mut Entry| entry.field.section.is_empty() && entry.field.name == name;
        if let Some(entry) = self.entries.iter_mut().find(is_named) {
            entry.needs.push(need);
        }
    }
}

/// Describes a setting that chooses a part.
pub(crate) fn choice(
    name: &'static str,
    default: Option<&str>,
    names: &'static [&'static str],
    doc: &'static str,
) -> Field {
    Field {
        section: "",
        name,
        default: default.map(|default| format!("\"{default}\"")),
        allowed: Allowed::Names(names),
        whole: false,
        is_text_of: |_| true,
        doc,
        only: None,
    }
}

/// Describes a setting that names a file or folder.
pub(crate) fn file(name: &'static str, doc: &'static str) -> Field {
    Field {
        section: "",
        name,
        default: None,
        allowed: Allowed::Text(PATH),
        whole: false,
        is_text_of: |_| true,
        doc,
        only: None,
    }
}
