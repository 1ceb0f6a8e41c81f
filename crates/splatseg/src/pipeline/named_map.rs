//! A saved memory with the names of its objects, without a pipeline.

use super::PipelineError;
use crate::settings::SettingsLayers;
use splatseg_memory::SplatMemory;
use splatseg_objects::ObjectNames;
use std::path::{Path, PathBuf};

/// A saved memory and the names that [`Pipeline::name_objects`](super::Pipeline::name_objects) gave its objects.
pub struct NamedMap {
    /// The memory.
    pub memory: SplatMemory,
    /// The names of the objects in the memory; none if the file has none.
    pub names: ObjectNames,
}

impl NamedMap {
    /// Loads the file of a saved memory, of any kind. Needs no segmenter and no weights.
    ///
    /// # Errors
    /// If the file cannot be read, or it or its names are damaged.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, PipelineError> {
        let path = path.as_ref();
        let mut layers = SettingsLayers::default();
        layers.add_saved_memory(path)?;
        let settings = layers.resolve()?;
        let no_memory = || PipelineError::NoMemory { path: path.to_owned(), method: settings.method.name().name() };
        let memory_settings = settings.method.memory().ok_or_else(no_memory)?;
        let mut memory = SplatMemory::load(path, memory_settings.clone())?;
        let mut names = take_names(&mut memory, path)?;
        // The state of a stopped run also has the names of objects that it has forgotten.
        names.keep_only(&memory.map().carried_ids());
        Ok(Self { memory, names })
    }
}

/// Takes the names of a memory that was loaded from `path`.
pub(super) fn take_names(memory: &mut SplatMemory, path: &Path) -> Result<ObjectNames, PipelineError> {
    let damaged = |source| PipelineError::Names { path: PathBuf::from(path), source };
    memory
        .take_names()
        .map_or_else(|| Ok(ObjectNames::default()), |bytes| ObjectNames::from_bytes(&bytes))
        .map_err(damaged)
}
