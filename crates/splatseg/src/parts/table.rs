//! The table of the parts of a kind, to which other crates can add theirs.

use super::requirements::{Registry, file};
use super::{Part, PartSection};
use std::sync::{Mutex, MutexGuard, PoisonError};
use thiserror::Error;

/// A kind of part with a table: `dyn Segmenter`, `dyn Tracker` or `dyn Namer`.
pub trait PartKind: 'static {
    /// The setting that chooses a part, e.g. `segmenter`.
    const KEY: &'static str;
    /// The part that is used if none is chosen.
    const DEFAULT: Option<Part<Self>>;

    /// The parts that can be chosen.
    fn table() -> &'static PartTable<Self>;
}

impl<T: PartKind + ?Sized> Part<T> {
    /// Returns all parts of the kind that can be chosen: those built in, then those that were registered.
    pub fn all() -> Vec<Self> {
        T::table().parts()
    }
}

/// An error registering a part.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum RegisterError {
    /// Another part of the kind has the name.
    #[error("there is already a {kind} named {name}")]
    Taken {
        /// The kind, e.g. `segmenter`.
        kind: &'static str,
        /// The name.
        name: &'static str,
    },
    /// The name cannot be written in settings and on the command line.
    #[error("the name of a {kind} is {name:?}, expected lower-case letters, digits, - and _")]
    Name {
        /// The kind, e.g. `segmenter`.
        kind: &'static str,
        /// The name.
        name: &'static str,
    },
    /// A setting of the part has the key or the section of another setting.
    #[error("the {kind} {name} has the setting {key}, but there is {other} already")]
    Setting {
        /// The kind, e.g. `segmenter`.
        kind: &'static str,
        /// The name.
        name: &'static str,
        /// The setting.
        key: String,
        /// The other setting.
        other: String,
    },
}

/// The parts of a kind that can be chosen.
pub struct PartTable<T: ?Sized + 'static> {
    built_in: &'static [Part<T>],
    added: Mutex<Added<T>>,
}

struct Added<T: ?Sized + 'static> {
    parts: Vec<Part<T>>,
    /// The names of all parts, the default first; empty before the first use.
    names: &'static [&'static str],
}

impl<T: ?Sized> PartTable<T> {
    /// Creates a table of the built-in parts.
    pub const fn new(built_in: &'static [Part<T>]) -> Self {
        Self { built_in, added: Mutex::new(Added { parts: Vec::new(), names: &[] }) }
    }

    /// Returns all parts: those built in, then those that were added.
    pub(crate) fn parts(&self) -> Vec<Part<T>> {
        [self.built_in, &self.added().parts].concat()
    }

    fn added(&self) -> MutexGuard<'_, Added<T>> {
        self.added.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<T: PartKind + ?Sized> PartTable<T> {
    /// Returns the names of all parts, the default first.
    pub(crate) fn names(&self) -> &'static [&'static str] {
        let mut added = self.added();
        let parts = self.built_in.iter().chain(&added.parts).map(|part| part.name);
        if added.names.len() != self.built_in.len() + added.parts.len() {
            let mut names: Vec<&'static str> = parts.collect();
            names.sort_by_key(|name| T::DEFAULT.is_none_or(|default| *name != default.name));
            // Descriptions of settings hold names forever. There are only a few lists: one per part that is added.
            added.names = names.leak();
        }
        added.names
    }

    /// Checks the name of a part that is to be added.
    ///
    /// # Errors
    /// If the name is taken or cannot be written.
    pub(crate) fn check_name<S: PartSection<T>>(&self) -> Result<(), RegisterError> {
        let (kind, name) = (T::KEY, S::NAME);
        if !splatseg_settings::is_name(name) {
            return Err(RegisterError::Name { kind, name });
        }
        if self.parts().iter().any(|part| part.name == name) {
            return Err(RegisterError::Taken { kind, name });
        }
        Ok(())
    }

    /// Adds a part, whose name and settings have been checked.
    pub(crate) fn add<S: PartSection<T>>(&self) {
        self.added().parts.push(Part::of::<S>());
    }

    /// Adds the settings of all parts to the list of settings. `needs` are choices without which no part is used.
    pub(super) fn add_settings(&self, registry: &mut Registry, needs: &[(&'static str, &[&'static str])]) {
        for part in self.parts() {
            let chosen = [part.name];
            let needs = [needs, &[(T::KEY, &chosen[..])]].concat();
            registry.add(part.files.iter().map(|own| file(own.key, own.help)).collect(), &needs);
            registry.add((part.fields)(), &needs);
        }
    }
}
