//! The names of the kinds of memory.

use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use splatseg_settings::{Allowed, SettingValue};
use std::fmt;
use std::sync::{Mutex, MutexGuard, PoisonError};
use thiserror::Error;

/// How Gaussians remember segments.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum MemoryKind {
    /// Votes for the segments that each Gaussian was predicted as.
    #[default]
    Evidence,
    /// The paper's feature vectors, learnt by gradient descent.
    Features,
    /// A kind that another crate has added; see [`register_memory_kind`](crate::register_memory_kind).
    Registered(RegisteredKind),
}

/// The name of a kind of memory that another crate has added.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RegisteredKind(&'static str);

/// An error registering a kind of memory.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum RegisterKindError {
    /// Another kind has the name.
    #[error("there is already a kind of memory named {0}")]
    Taken(&'static str),
    /// The name cannot be written in settings.
    #[error("the name of a kind of memory is {0:?}, expected lower-case letters, digits, - and _")]
    Name(&'static str),
}

/// The names of all kinds, the built-in ones first.
static NAMES: Mutex<&'static [&'static str]> = Mutex::new(&[MemoryKind::Evidence.name(), MemoryKind::Features.name()]);

fn all_names() -> MutexGuard<'static, &'static [&'static str]> {
    NAMES.lock().unwrap_or_else(PoisonError::into_inner)
}

impl MemoryKind {
    /// Returns the names of all kinds.
    pub fn names() -> &'static [&'static str] {
        *all_names()
    }

    /// Returns the kind with this name, if there is one.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::names().iter().find(|known| **known == name).map(|known| Self::of(known))
    }

    /// Returns the name used in settings and files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Evidence => "evidence",
            Self::Features => "features",
            Self::Registered(RegisteredKind(name)) => name,
        }
    }

    /// Returns the name of a kind that another crate has added, `None` for a built-in one.
    pub(crate) const fn registered_name(self) -> Option<&'static str> {
        match self {
            Self::Registered(RegisteredKind(name)) => Some(name),
            _ => None,
        }
    }

    /// Adds a name.
    ///
    /// # Errors
    /// If it is taken or cannot be written.
    pub(crate) fn add(name: &'static str) -> Result<Self, RegisterKindError> {
        if !splatseg_settings::is_name(name) {
            return Err(RegisterKindError::Name(name));
        }
        let mut names = all_names();
        if names.contains(&name) {
            return Err(RegisterKindError::Taken(name));
        }
        // Descriptions of settings hold the names forever. There is one list per kind that is added.
        *names = [*names, &[name]].concat().leak();
        Ok(Self::Registered(RegisteredKind(name)))
    }

    fn of(name: &'static str) -> Self {
        let built_in = [Self::Evidence, Self::Features].into_iter().find(|kind| kind.name() == name);
        built_in.unwrap_or(Self::Registered(RegisteredKind(name)))
    }
}

impl fmt::Display for MemoryKind {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.name())
    }
}

impl SettingValue for MemoryKind {
    fn text(&self) -> Option<String> {
        Some(format!("\"{self}\""))
    }

    fn is_allowed(&self, _: &Allowed) -> bool {
        true
    }
}

impl Serialize for MemoryKind {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

impl<'de> Deserialize<'de> for MemoryKind {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let name = String::deserialize(deserializer)?;
        Self::from_name(&name).ok_or_else(|| D::Error::unknown_variant(&name, Self::names()))
    }
}
