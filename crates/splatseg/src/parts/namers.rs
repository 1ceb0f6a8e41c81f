//! Namers: they say what objects are. `clip` is built in; other crates register theirs.

use super::requirements::{Registry, choice};
use super::{Part, PartKind, PartSettings, PartTable};
use crate::names::{ClipNamerSettings, ClipNames};
use splatseg_geometry::SegmentId;
use splatseg_objects::{Object, ObjectName, ObjectView};
use splatseg_settings::SettingError;
use std::error::Error;
use std::sync::Arc;
use toml::Table;

pub use splatseg_models::clip::Pacer;

/// An object to be named.
#[derive(Clone, Copy, Debug)]
pub struct ObjectToName<'a> {
    /// Its id, its present label, and its shape if it is known; without best view and confidence. Beside the frames, only id
    /// and label are known.
    pub object: &'a Object,
    /// Its best view, with sides of at most [`KeptViews::MAX_SIDE`](splatseg_objects::KeptViews::MAX_SIDE) pixels.
    pub view: &'a ObjectView,
    /// A few views, the best first, then those that show the most other surface, each with its weight, as of
    /// [`KeptViews::views`](splatseg_objects::KeptViews::views).
    pub views: &'a [(&'a ObjectView, f64)],
}

/// Names objects, e.g. with a network for images and words.
///
/// A pipeline whose settings choose one names objects as [`Pipeline::name_objects`](crate::Pipeline::name_objects) does:
/// after every frame or, with a namer that is [slow](Self::cpu_share), beside the frames and when the program calls
/// [`Pipeline::finish_names`](crate::Pipeline::finish_names).
pub trait Namer: Send {
    /// A short name for messages, e.g. `clip`.
    fn name(&self) -> &str;

    /// Returns an object's label, its embedding, both or neither. It is asked about each object without a name, and
    /// again once the object's best views have become clearly better.
    ///
    /// # Errors
    /// Ends the run. Return a name without label and embedding for an object that is not recognised.
    fn name_object(&mut self, object: ObjectToName<'_>) -> Result<ObjectName, Box<dyn Error + Send + Sync>>;

    /// Returns labels of objects by their embeddings, all together: for namers that compare the objects of a map. It is
    /// called after objects were named. Without any, the labels of [`Self::name_object`] stay.
    ///
    /// # Errors
    /// Ends the run.
    fn label_objects(
        &mut self,
        objects: &[(SegmentId, &[f32])],
    ) -> Result<Vec<(SegmentId, ObjectName)>, Box<dyn Error + Send + Sync>> {
        let _ = objects;
        Ok(Vec::new())
    }

    /// [`Self::name_object`] beside the frames. `pacer` waits while a frame is processed: a namer that calls it before every few
    /// milliseconds of work is not in a frame's way. The result must be the same.
    ///
    /// # Errors
    /// As [`Self::name_object`].
    fn name_object_beside(
        &mut self,
        object: ObjectToName<'_>,
        pacer: &dyn Pacer,
    ) -> Result<ObjectName, Box<dyn Error + Send + Sync>> {
        let _ = pacer;
        self.name_object(object)
    }

    /// [`Self::label_objects`] beside the frames, as [`Self::name_object_beside`].
    ///
    /// # Errors
    /// As [`Self::label_objects`].
    fn label_objects_beside(
        &mut self,
        objects: &[(SegmentId, &[f32])],
        pacer: &dyn Pacer,
    ) -> Result<Vec<(SegmentId, ObjectName)>, Box<dyn Error + Send + Sync>> {
        let _ = pacer;
        self.label_objects(objects)
    }

    /// `None` for a namer that is fast enough to be asked after every frame. Otherwise the share of all cores that it may take
    /// beside the frames, 0 to 1: it is then asked on a thread of its own, in programs that call
    /// [`Pipeline::name_beside_frames`](crate::Pipeline::name_beside_frames), and about all that is left when the frames
    /// have ended.
    fn cpu_share(&self) -> Option<f64> {
        None
    }

    /// The network for images and words that it uses, for texts that are compared with objects.
    fn network(&self) -> Option<Arc<ClipNames>> {
        None
    }
}

/// A namer with its settings.
pub type NamerSettings = PartSettings<dyn Namer>;

static NAMERS: PartTable<dyn Namer> = PartTable::new(&[Part::of::<ClipNamerSettings>()]);

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
        let help = "The namer, which gives objects labels and embeddings. Without it they have none. `--names FILE` chooses \
                    `clip`.";
        registry.add(vec![choice("namer", None, NAMERS.names(), help)], &[]);
        NAMERS.add_settings(registry, &[]);
    }
}
