//! A part that settings choose by its name.

use super::section::AnySection;
use super::{PartFile, PartSection, values};
use splatseg_settings::{Field, SettingError};
use std::fmt;
use toml::Table;

/// Reads the settings of a part from a table of checked values.
pub(super) type ReadSection<T> = fn(&Table) -> Result<Box<dyn AnySection<T>>, SettingError>;

/// A row in the table of a kind of part. `T` is what is built, e.g. `dyn Segmenter`.
pub struct Part<T: ?Sized> {
    /// The name that chooses the part.
    pub name: &'static str,
    /// Description in one line.
    pub help: &'static str,
    /// The files and folders that the part reads.
    pub files: &'static [PartFile],
    /// True for a network that runs on the device of the settings.
    pub is_network: bool,
    /// True if the part is missing in a program without the feature `networks`.
    pub needs_networks: bool,
    /// The section of its settings; empty at the top level.
    pub section: &'static str,
    /// Its settings.
    pub fields: fn() -> Vec<Field>,
    /// Reads its settings from a table of checked values.
    pub(super) read: ReadSection<T>,
}

impl<T: ?Sized> Part<T> {
    /// The row of the part with these settings.
    pub const fn of<S: PartSection<T>>() -> Self {
        Self {
            name: S::NAME,
            help: S::HELP,
            files: S::FILES,
            is_network: S::IS_NETWORK,
            needs_networks: S::NEEDS_NETWORKS,
            section: S::SECTION,
            fields: S::fields,
            read: read::<T, S>,
        }
    }
}

fn read<T: ?Sized, S: PartSection<T>>(table: &Table) -> Result<Box<dyn AnySection<T>>, SettingError> {
    Ok(Box::new(values::section::<S>(table)?))
}

// Derived implementations would need `T: Copy`.
impl<T: ?Sized> Clone for Part<T> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<T: ?Sized> Copy for Part<T> {}

impl<T: ?Sized> fmt::Debug for Part<T> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_struct("Part").field("name", &self.name).field("help", &self.help).finish_non_exhaustive()
    }
}
