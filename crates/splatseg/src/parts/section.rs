//! The settings of a part, from which it is built.

use super::{PartContext, PartError, PartFile, PartFiles};
use serde::Serialize;
use serde::de::DeserializeOwned;
use splatseg_settings::{Section, SettingError};
use std::any::Any;
use std::fmt;
use toml::Table;

/// The settings of a part, with its name and its construction. `T` is what is built, e.g. `dyn Segmenter`.
///
/// ```
/// use splatseg::parts::{PartContext, PartError, PartFiles, PartSection};
/// use splatseg::segmenter::{Segmenter, SegmenterError};
/// use splatseg::{CameraFrame, Mask, ScoredMask, Segmentation};
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
///     fn segment(&mut self, frame: &CameraFrame) -> Result<Segmentation, SegmenterError> {
///         let mask = Mask::from_fn(frame.width(), frame.height(), |column, row| {
///             let depth = frame.depth()[(column, row)];
///             depth > 0.0 && depth < self.0
///         });
///         Ok(vec![ScoredMask { mask, score: 1.0 }].into())
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

/// A [`PartSection`] without its type.
pub(super) trait AnySection<T: ?Sized>: fmt::Debug + Send + Sync {
    fn as_any(&self) -> &dyn Any;
    fn as_any_mut(&mut self) -> &mut dyn Any;
    fn cloned(&self) -> Box<dyn AnySection<T>>;
    fn equals(&self, other: &dyn AnySection<T>) -> bool;
    fn validate(&self) -> Result<(), SettingError>;
    fn to_table(&self) -> Result<Table, String>;
    fn build(&self, files: &PartFiles, context: &PartContext<'_>) -> Result<Box<T>, PartError>;
}

impl<T: ?Sized, S: PartSection<T>> AnySection<T> for S {
    fn as_any(&self) -> &dyn Any {
        self
    }

    fn as_any_mut(&mut self) -> &mut dyn Any {
        self
    }

    fn cloned(&self) -> Box<dyn AnySection<T>> {
        Box::new(self.clone())
    }

    fn equals(&self, other: &dyn AnySection<T>) -> bool {
        other.as_any().downcast_ref::<S>() == Some(self)
    }

    fn validate(&self) -> Result<(), SettingError> {
        splatseg_settings::Section::validate(self)
    }

    fn to_table(&self) -> Result<Table, String> {
        // Converted through text, in which the `f32` 0.3 stays 0.3.
        let text = toml::to_string(self).map_err(|error| error.to_string())?;
        text.parse().map_err(|error: toml::de::Error| error.to_string())
    }

    fn build(&self, files: &PartFiles, context: &PartContext<'_>) -> Result<Box<T>, PartError> {
        PartSection::build(self, files, context)
    }
}
