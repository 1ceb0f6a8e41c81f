//! The files in which a session keeps its map.

use crate::LiveError;
use splatseg::Pipeline;
use splatseg::pipeline::MapPlaces;
use splatseg_objects::{ObjectList, SeenObjects};
use splatseg_output::write_atomically;
use std::io;
use std::path::{Path, PathBuf};

/// Files of a map: the map itself, `home.ply`, and its objects, `home.objects.json`. Each is replaced atomically, so a
/// session that is killed, or a power cut, leaves the files of the save before.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SavedMap {
    map: PathBuf,
}

impl SavedMap {
    /// Names the files of the map `map`, a PLY file.
    pub fn new(map: PathBuf) -> Self {
        Self { map }
    }

    /// The file of the map.
    pub fn map(&self) -> &Path {
        &self.map
    }

    /// The file of the objects.
    pub fn objects(&self) -> PathBuf {
        self.map.with_extension("objects.json")
    }

    /// True if both files exist.
    pub fn exists(&self) -> bool {
        self.map.is_file() && self.objects().is_file()
    }

    /// Saves a pipeline's map and objects, with rooms and relations if `places` has them.
    ///
    /// # Errors
    /// If a file cannot be written, or the method has no map.
    pub fn save(&self, pipeline: &Pipeline, seen: &SeenObjects, places: Option<&MapPlaces>) -> Result<(), LiveError> {
        if !pipeline.save_memory(&self.map)? {
            return Err(LiveError::NoMap(pipeline.method_name().to_owned()));
        }
        let path = self.objects();
        let failed = |source| LiveError::Objects { path: path.clone(), source };
        let text = objects(pipeline, seen, places).to_json().map_err(|error| failed(error.into()))?;
        write_atomically(&path, text.as_bytes()).map_err(|error| failed(io::Error::other(error)))
    }
}

/// Returns the objects of a pipeline with their sightings, and with rooms and relations as of the latest plan.
pub(crate) fn objects(pipeline: &Pipeline, seen: &SeenObjects, places: Option<&MapPlaces>) -> ObjectList {
    let mut list = pipeline.object_list();
    list.add_sightings(seen);
    if let Some(places) = places {
        places.add_to(&mut list);
    }
    list
}
