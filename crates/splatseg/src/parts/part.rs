//! A part that settings choose by its name.

use super::{PartContext, PartError, PartFile, PartFiles, PartTable};
use super::{part_settings::AnySection, values};
use serde::Serialize;
use serde::de::DeserializeOwned;
use splatseg_settings::{Field, Section, SettingError};
use std::fmt;
use toml::Table;

/// The settings of a part, with its name and its construction. `T` is what is built, e.g. `dyn Segmenter`.
///
/// ```
/// use splatseg::parts::{PartContext, PartError, PartFiles, PartSection};
/// use splatseg::segmenter::{Segmenter, SegmenterError};
/// use splatseg::{CameraFrame, Mask, ScoredMask};
/// use splatseg_settings::{Allowed, settings};
///
/// settings! {
///     /// Settings of a segmenter that finds what is near.
///     pub struct NearSettings in "near" {
///         /// Largest distance, metres.
///         distance: f32 = 1.0, Allowed::above_up_to(0.0, 100.0);
///     }
/// }
///
/// struct Near(f32);
///
/// impl Segmenter for Near {
///     fn name(&self) -> &str {
///         "near"
///     }
///
///     fn segment(&mut self, frame: &CameraFrame) -> Result<Vec<ScoredMask>, SegmenterError> {
///         let is_near = |column, row| (0.0..self.0).contains(&frame.depth()[(column, row)]);
///         let mask = Mask::from_fn(frame.width(), frame.height(), is_near);
///         Ok(vec![ScoredMask { mask, score: 1.0 }])
///     }
/// }
///
/// impl PartSection<dyn Segmenter> for NearSettings {
///     const NAME: &'static str = "near";
///     const HELP: &'static str = "One mask of everything that is near";
///
///     fn build(&self, _: &PartFiles, _: &PartContext<'_>) -> Result<Box<dyn Segmenter>, PartError> {
///         Ok(Box::new(Near(self.distance)))
///     }
/// }
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use splatseg::settings::{SettingsLayers, register_segmenter};
///
/// register_segmenter::<NearSettings>()?;
/// let mut layers = SettingsLayers::default();
/// layers.add_assignment("segmenter=near")?;
/// layers.add_assignment("near.distance=2.5")?;
/// let settings = layers.resolve()?;
/// assert_eq!(settings.segmenter.section::<NearSettings>().map(|near| near.distance), Some(2.5));
/// # Ok(())
/// # }
/// ```
pub trait PartSection<T: ?Sized>:
    Section + Clone + PartialEq + fmt::Debug + Serialize + DeserializeOwned + Send + Sync + 'static
{
    /// The name that chooses the part: lower-case letters, digits, `-` and `_`.
    const NAME: &'static str;
    /// Description in one line, for `--help`.
    const HELP: &'static str;
    /// The files and folders that the part reads.
    const FILES: &'static [PartFile] = &[];
    /// True for a network that runs on the device of the settings.
    const IS_NETWORK: bool = false;
    /// True if the part is missing in a program without the feature `networks`.
    const NEEDS_NETWORKS: bool = false;

    /// Builds the part.
    ///
    /// # Errors
    /// If a file cannot be read, or the part cannot be built with these settings.
    fn build(&self, files: &PartFiles, context: &PartContext<'_>) -> Result<Box<T>, PartError>;
}

/// A kind of part with a table: `dyn Segmenter`, `dyn Tracker` or `dyn Namer`.
pub trait PartKind: 'static {
    /// The setting that chooses a part, e.g. `segmenter`.
    const KEY: &'static str;
    /// The part that is used if none is chosen.
    const DEFAULT: Option<Part<Self>>;

    /// The parts that can be chosen.
    fn table() -> &'static PartTable<Self>;
}

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
    pub(super) read: fn(&Table) -> Result<Box<dyn AnySection<T>>, SettingError>,
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

impl<T: PartKind + ?Sized> Part<T> {
    /// Returns all parts of the kind that can be chosen: those built in, then those that were registered.
    pub fn all() -> Vec<Self> {
        T::table().parts()
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
