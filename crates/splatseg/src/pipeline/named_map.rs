//! A saved memory with the names of its objects, without a pipeline.

use super::map_history::take_history;
use super::{MapHistory, PipelineError};
use crate::names::{ClipNames, NamesError, views_from_keyframes};
use crate::settings::SettingsLayers;
use splatseg_memory::{Attached, SplatFileError, SplatMemory};
use splatseg_objects::{DepthView, ObjectList, ObjectLog, ObjectName, ObjectNames};
use splatseg_odometry::{KeyframeView, PoseSourceError, StateScope, keyframe_views};
use std::path::{Path, PathBuf};

/// A saved memory and the names that [`Pipeline::name_objects`](super::Pipeline::name_objects) gave its objects.
pub struct NamedMap {
    /// The memory.
    pub memory: SplatMemory,
    /// The names of the objects in the memory; none if the file has none.
    pub names: ObjectNames,
    /// The camera's keyframes, as bytes for `splatseg_odometry`; `None` if the file has none.
    pub keyframes: Option<Vec<u8>>,
    /// When objects were seen, and the rooms so far; nothing is known in maps of earlier versions.
    pub history: MapHistory,
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
        let keyframes = memory.take_keyframes();
        let history = take_history(&mut memory, path)?;
        Ok(Self { memory, names, keyframes, history })
    }

    /// The objects of the map with their names, and when they were seen.
    pub fn object_list(&self) -> ObjectList {
        self.described(ObjectList::new(&ObjectLog::default(), Some(self.memory.map())))
    }

    /// Adds to a list of the map's objects their names, and when they were seen.
    pub(super) fn described(&self, mut list: ObjectList) -> ObjectList {
        list.add_names(&self.names);
        list.add_seen_times(&self.history.seen());
        list
    }

    /// Names all objects from the map's keyframes, with a network. Labels that a person gave stay. Returns the number of objects that a keyframe shows.
    ///
    /// The file is read once more, since the map is looked at as in a new session, but saved as it was.
    ///
    /// # Errors
    /// If the file or its keyframes cannot be read, or the network computes numbers that are not finite.
    pub fn name_from_keyframes(&mut self, path: impl AsRef<Path>, network: &ClipNames) -> Result<usize, PipelineError> {
        let path = path.as_ref();
        let Some(keyframes) = &self.keyframes else { return Ok(0) };
        let mut shown = Self::load(path)?.memory;
        shown.start_session();
        let views = views_from_keyframes(&shown, keyframes)?;
        let carried = self.memory.map().carried_ids();
        self.names.keep_by_hand();
        let mut count = 0;
        for id in carried {
            let Some(score) = views.score(id) else { continue };
            let failed =
                |source: NamesError| PipelineError::MapNames { path: path.to_owned(), source: Box::new(source) };
            let embedding = network.embed_views(&views.views(id)).map_err(|error| failed(error.into()))?;
            let name = ObjectName { embedding, ..ObjectName::default() };
            self.names.set(id, name, score).map_err(|error| failed(error.into()))?;
            count += 1;
        }
        let failed = |source| PipelineError::MapNames { path: path.to_owned(), source: Box::new(source) };
        network.label(&mut self.names).map_err(failed)?;
        Ok(count)
    }

    /// Saves the map with its names, keyframes and history.
    ///
    /// # Errors
    /// As [`SplatMemory::save`].
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), SplatFileError> {
        let names = (!self.names.is_empty()).then(|| self.names.to_bytes());
        let history = self.history.of_present(&self.memory, StateScope::Map);
        let (keyframes, names, history) = (self.keyframes.as_deref(), names.as_deref(), history.as_deref());
        let attached = Attached { keyframes, names, history };
        self.memory.save_with(path, attached)
    }
}

/// The camera's observations of a map, for [`ObservedMap`](splatseg_objects::ObservedMap): the depth of its keyframes, without
/// those that it has in common with an earlier map. Both are bytes as in [`NamedMap::keyframes`].
///
/// # Errors
/// As [`keyframe_views`].
pub fn depth_views(keyframes: &[u8], earlier: Option<&[u8]>) -> Result<Vec<DepthView>, PoseSourceError> {
    let view = |view: KeyframeView| DepthView {
        world_from_camera: view.world_from_camera,
        intrinsics: view.intrinsics,
        depth: view.depth,
    };
    Ok(keyframe_views(keyframes, earlier)?.into_iter().map(view).collect())
}

/// Takes the names of a memory that was loaded from `path`.
pub(super) fn take_names(memory: &mut SplatMemory, path: &Path) -> Result<ObjectNames, PipelineError> {
    let damaged = |source| PipelineError::Names { path: PathBuf::from(path), source };
    memory
        .take_names()
        .map_or_else(|| Ok(ObjectNames::default()), |bytes| ObjectNames::from_bytes(&bytes))
        .map_err(damaged)
}
