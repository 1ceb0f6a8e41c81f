//! The map, loaded again when its file has changed.

use crate::places::{OpenPlaces, Places};
use crate::sightings::{add_map_sightings, add_sightings, file_beside, later_of};
use crate::{AssistantOptions, McpError};
use glam::{DQuat, DVec3};
use splatseg::pipeline::NamedMap;
use splatseg_geometry::SegmentId;
use splatseg_objects::{FrameStamp, Object, ObjectList, ObjectState};
use splatseg_odometry::{KeyframeView, PoseSourceError, keyframe_views};
use splatseg_places::PlanSettings;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// A map that was loaded, and what was found out about it.
pub struct LoadedMap {
    pub map: NamedMap,
    /// Its objects with their sightings.
    pub list: ObjectList,
    /// Unit vector pointing up, world coordinates.
    pub up: DVec3,
    /// The last frame that showed any object; `None` if nothing tells.
    pub last_frame: Option<FrameStamp>,
    /// Why sightings are not known.
    pub sightings_problem: Option<String>,
    pub places: Result<Box<dyn Places>, String>,
    /// The keyframe that shows the most of each object; found when it is first asked for.
    pub pictures: Option<BTreeMap<SegmentId, BestKeyframe>>,
}

/// The keyframe that shows the most of an object.
#[derive(Clone, Copy, Debug)]
pub struct BestKeyframe {
    /// Its position among the keyframes.
    pub index: usize,
    /// Number of pixels of its colour image that show the object.
    pub area: usize,
}

/// The map of a server.
pub struct OpenMap {
    path: PathBuf,
    objects: Option<PathBuf>,
    open_places: OpenPlaces,
    stamp: [FileStamp; 2],
    current: LoadedMap,
    /// The map as it was when the server started, if it has changed since.
    first: Option<LoadedMap>,
}

/// Detects changes of a file; `None` without a file.
type FileStamp = Option<(SystemTime, u64)>;

impl OpenMap {
    /// Loads the map.
    pub fn open(options: &AssistantOptions, open_places: OpenPlaces) -> Result<Self, McpError> {
        let (path, objects) = (options.map.clone(), options.objects.clone());
        let stamp = stamps(&path, objects.as_deref());
        let current = LoadedMap::load(&path, objects.as_deref(), &open_places)?;
        Ok(Self { path, objects, open_places, stamp, current, first: None })
    }

    /// The map, as it was loaded last.
    pub fn current(&mut self) -> &mut LoadedMap {
        &mut self.current
    }

    /// The map as it was when the server started, and the present one; `None` if that is the same.
    pub fn since_start(&self) -> Option<(&LoadedMap, &LoadedMap)> {
        self.first.as_ref().map(|first| (first, &self.current))
    }

    /// Loads the map again if its file has changed. A file that cannot be read changes nothing: the error says so.
    pub fn refresh(&mut self) -> Result<(), String> {
        let stamp = stamps(&self.path, self.objects.as_deref());
        if stamp == self.stamp {
            return Ok(());
        }
        let loaded = LoadedMap::load(&self.path, self.objects.as_deref(), &self.open_places).map_err(|error| {
            format!("The map's file has changed but cannot be read, so this is the map as it was before: {error}")
        })?;
        self.stamp = stamp;
        let before = std::mem::replace(&mut self.current, loaded);
        self.first.get_or_insert(before);
        Ok(())
    }

    /// Gives an object a label in the file, or takes its label away, as [`Self::change`].
    pub fn rename(&mut self, id: SegmentId, label: Option<&str>) -> Result<(), String> {
        self.change(|map| {
            if !map.memory.map().carried_ids().contains(&id) {
                return Err(format!("the map has no object {id} any more"));
            }
            map.names.set_by_hand(id, label).map_err(|error| error.to_string())
        })
    }

    /// Gives a room a name in the file, or takes its name away, as [`Self::change`].
    pub fn rename_room(&mut self, room: u32, name: Option<&str>) -> Result<(), String> {
        self.change(|map| {
            let mut plan = map.floor_plan(PlanSettings::default()).map_err(|error| error.to_string())?;
            map.name_room(&mut plan, room, name).map_err(|error| error.to_string())
        })
    }

    /// Reads the file once more, changes the names in it, and replaces it atomically; if somebody else writes it in the
    /// meantime, nothing is changed.
    fn change(&mut self, change: impl FnOnce(&mut NamedMap) -> Result<(), String>) -> Result<(), String> {
        let before = stamps(&self.path, self.objects.as_deref());
        let mut map = NamedMap::load(&self.path).map_err(|error| error.to_string())?;
        change(&mut map)?;
        if before != self.stamp || before != stamps(&self.path, self.objects.as_deref()) {
            return Err("the map's file has just been changed by another program, so nothing was written".to_owned());
        }
        map.save(&self.path).map_err(|error| error.to_string())?;
        self.stamp = stamps(&self.path, self.objects.as_deref());
        self.current.places = (self.open_places)(&map);
        self.current.take_names(map);
        Ok(())
    }

    /// The file of the map.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl LoadedMap {
    fn load(path: &Path, objects: Option<&Path>, open_places: &OpenPlaces) -> Result<Self, McpError> {
        let mut map = NamedMap::load(path)?;
        let mut list = map.object_list();
        let beside = file_beside(path);
        // The map first: the file has only what its run showed.
        let of_map = add_map_sightings(&mut list, &map);
        let (of_run, sightings_problem) = match objects {
            Some(objects) => (add_sightings(&mut list, objects)?, None),
            None if beside.is_file() => match add_sightings(&mut list, &beside) {
                Ok(last) => (last, None),
                Err(error) => (None, Some(error.to_string())),
            },
            None if of_map.is_some() => (None, None),
            None => (None, Some("the map does not tell; start the server with --objects objects.json".to_owned())),
        };
        let last_frame = later_of(of_run, of_map);
        let damaged = |error: PoseSourceError| McpError::File { path: path.to_owned(), problem: error.to_string() };
        let up = map.up().map_err(damaged)?.map_or(DVec3::Z, |up| up.as_dvec3().normalize_or(DVec3::Z));
        let places = open_places(&map);
        // Its keyframes are looked at, which are no continuation of the last frame.
        map.memory.start_session();
        Ok(Self { map, list, up, last_frame, sightings_problem, places, pictures: None })
    }

    /// The keyframes; none if the map has none.
    pub fn keyframes(&self) -> Result<Vec<KeyframeView>, String> {
        let Some(keyframes) = &self.map.keyframes else { return Ok(Vec::new()) };
        keyframe_views(keyframes, None).map_err(|error| error.to_string())
    }

    /// Rotates the world so that up is z.
    pub fn level_from_world(&self) -> DQuat {
        DQuat::from_rotation_arc(self.up, DVec3::Z)
    }

    /// An object of the list, unless it is forgotten.
    pub fn object(&self, id: SegmentId) -> Option<&Object> {
        self.list.get(id).filter(|object| object.state != Some(ObjectState::Forgotten))
    }

    /// Takes over the names of another load of the same map.
    fn take_names(&mut self, other: NamedMap) {
        self.map.names = other.names;
        for object in self.list.objects.iter_mut().chain(&mut self.list.not_counted) {
            (object.label, object.label_score, object.label_alternatives) = (None, None, Vec::new());
        }
        self.list.add_names(&self.map.names);
    }
}

/// When the map's and the objects' file were written.
fn stamps(map: &Path, objects: Option<&Path>) -> [FileStamp; 2] {
    let stamp = |path: &Path| {
        let metadata = fs::metadata(path).ok()?;
        Some((metadata.modified().ok()?, metadata.len()))
    };
    [stamp(map), stamp(objects.unwrap_or(&file_beside(map)))]
}
