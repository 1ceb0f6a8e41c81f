//! Namers: they say what objects are. None is built in; other crates register theirs.

use super::requirements::{Registry, choice};
use super::{Part, PartKind, PartSettings, PartTable};
use splatseg_objects::{Object, ObjectName, ObjectView};
use splatseg_settings::SettingError;
use std::error::Error;
use toml::Table;

/// An object to be named.
#[derive(Clone, Copy, Debug)]
pub struct ObjectToName<'a> {
    /// Its id, its present label, and its shape if it is known; without best view and confidence.
    pub object: &'a Object,
    /// Its best view, with sides of at most [`KeptViews::MAX_SIDE`](splatseg_objects::KeptViews::MAX_SIDE) pixels.
    pub view: &'a ObjectView,
}

/// Names objects, e.g. with a network for images and words.
///
/// A pipeline whose settings choose one names objects after every frame, as
/// [`Pipeline::name_objects`](crate::Pipeline::name_objects) does.
pub trait Namer: Send {
    /// A short name for messages, e.g. `clip`.
    fn name(&self) -> &str;

    /// Returns an object's label, its embedding, both or neither. It is asked about each object without a name, and
    /// again once the object's best view has become clearly better.
    ///
    /// # Errors
    /// Ends the run. Return a name without label and embedding for an object that is not recognised.
    fn name_object(&mut self, object: ObjectToName<'_>) -> Result<ObjectName, Box<dyn Error + Send + Sync>>;
}

/// A namer with its settings.
pub type NamerSettings = PartSettings<dyn Namer>;

static NAMERS: PartTable<dyn Namer> = PartTable::new(&[]);

impl PartKind for dyn Namer {
    const KEY: &'static str = "namer";
    const DEFAULT: Option<Part<Self>> = None;

    fn table() -> &'static PartTable<Self> {
        &NAMERS
    }
}

impl NamerSettings {
    /// Reads the namer and its settings from a table of checked values; `None` without one.
    pub(crate) fn from_table(table: &Table) -> Result<Option<Self>, SettingError> {
        Self::chosen_in(table)
    }
}

/// Adds the choice of a namer, and the settings of each, if there is one to choose.
pub(crate) fn add_settings(registry: &mut Registry) {
    if !NAMERS.names().is_empty() {
        let help = "The namer, which gives objects labels and embeddings. Without it they have none.";
        registry.add(vec![choice("namer", None, NAMERS.names(), help)], &[]);
        NAMERS.add_settings(registry, &[]);
    }
}
