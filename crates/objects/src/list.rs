//! The content of `objects.json`: every object of a run. `docs/OBJECTS.md` describes each key for users.

use crate::{
    BoundingBox, LabelScore, ListedRoom, ObjectLog, ObjectNames, ObjectShape, ObjectSurfaces, Relation, SeenObjects,
};
use serde::{Deserialize, Serialize};
use serde_json::ser::Formatter;
use splatseg_geometry::{MapView, SegmentId};
use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::io::{self, Write};

/// Every object that a run has seen or that is in its memory.
///
/// Programs read `objects.json` with `serde_json::from_str::<ObjectList>`. Unknown keys, added by later versions, are
/// ignored.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ObjectList {
    /// [`ObjectList::FORMAT`].
    pub format: String,
    /// [`ObjectList::VERSION`]: it changes when the meaning of a key changes, not when a key is added.
    pub version: u32,
    /// The scene as given by the user; null if unknown.
    pub scene: Option<String>,
    /// Number of frames with a result.
    pub frames: usize,
    /// Units and coordinate frames of the objects' numbers.
    pub conventions: Conventions,
    /// The objects that count ([`Object::counts`]), those that most frames show first, then by id. Their number is the
    /// number of objects, wherever one is given.
    pub objects: Vec<Object>,
    /// The others, in the same order: tentative and forgotten ones.
    #[serde(default)]
    pub not_counted: Vec<Object>,
    /// The relations between those that count which are certain; see [`ObjectList::set_relations`].
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub relations: Vec<Relation>,
    /// The rooms, by increasing number; see [`ObjectList::set_rooms`]. Empty if they are not known.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub rooms: Vec<ListedRoom>,
}

/// Numbers of objects by their state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ObjectCounts {
    /// Objects that count: [`Object::counts`].
    pub objects: usize,
    /// Tentative ones: seen in one frame only, so each may be a mistake.
    pub tentative: usize,
    /// Forgotten ones: no longer in the memory.
    pub forgotten: usize,
}

/// Units and conventions of an [`ObjectList`].
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Conventions {
    /// Unit of positions and sizes.
    pub length: String,
    /// Unit of areas of surfaces.
    pub area: String,
    /// Unit and origin of times.
    pub time: String,
    /// Unit and origin of positions in images.
    pub image: String,
    /// The coordinate frame of centroids and boxes.
    pub coordinates: String,
    /// Representation of rotations.
    pub rotation: String,
    /// Representation of colours.
    pub color: String,
}

/// An object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Object {
    /// Its id: the value of its pixels in `segments/*.png`.
    pub id: SegmentId,
    /// Its label, if it was named; see [`ObjectList::add_names`].
    pub label: Option<String>,
    /// How clearly the label fits, if its namer said so: see `docs/NAMES.md`.
    #[serde(default)]
    pub label_score: Option<f32>,
    /// Other labels that fit, best first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub label_alternatives: Vec<LabelScore>,
    /// Its state in the final memory; null if the method has no memory.
    pub state: Option<ObjectState>,
    /// Number of frames that showed it. 0 for an object of a loaded memory that was not seen again.
    pub frames: usize,
    /// The first frame that showed it.
    pub first_frame: Option<FrameStamp>,
    /// The last frame that showed it.
    pub last_frame: Option<FrameStamp>,
    /// The earliest stamp of a frame that showed it, seconds, over all runs of the map; see
    /// [`ObjectList::add_seen_times`]. Null if the frames had none, or the map does not tell.
    #[serde(default)]
    pub first_seen_s: Option<f64>,
    /// The latest one.
    #[serde(default)]
    pub last_seen_s: Option<f64>,
    /// Number of the room that it is in, of [`ObjectList::rooms`]; null if it is in none, or rooms are not known.
    #[serde(default)]
    pub room: Option<u32>,
    /// Confidence of its id, from 0 to 1: the mean over the frames that showed it of the mean over its pixels.
    pub confidence: Option<f32>,
    /// Mean sRGB colour: of its Gaussians by area or, without any, of the pixels of its best view.
    pub color: Option<[u8; 3]>,
    /// Its shape in the world; null if it has no Gaussians, e.g. because it never had depth.
    pub shape: Option<ObjectShape>,
    /// Its best view.
    pub best_view: Option<BestView>,
}

/// State of an object in the memory at the end of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ObjectState {
    /// It is in the memory and was seen in two frames or more.
    Remembered,
    /// It is in the memory but was seen in one frame only, so it may be a mistake.
    Tentative,
    /// No Gaussian has its id any more: it was removed from the scene, was part of another object, or was a mistake.
    Forgotten,
}

/// A frame of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameStamp {
    /// Its position in the run, from 0.
    pub number: usize,
    /// Its name in the scene.
    pub name: Option<String>,
    /// Name of its result files: `segments/<file>.png`, `overlay/<file>.jpg`.
    pub file: Option<String>,
    /// Its timestamp in the scene, seconds; null if the scene has none.
    pub time_s: Option<f64>,
}

/// A frame that shows an object well.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BestView {
    /// The frame.
    pub frame: FrameStamp,
    /// The smallest box around the object's pixels.
    pub bounding_box: BoundingBox,
    /// Number of its pixels.
    pub area_px: usize,
    /// Confidence of the id in this frame, from 0 to 1.
    pub confidence: f32,
    /// Mean sRGB colour of its pixels.
    pub color: Option<[u8; 3]>,
    /// Path of its crop in the folder of the run.
    pub crop: Option<String>,
}

impl Object {
    /// True if the object counts: it is in the memory and was seen in two frames or more. Of a method without a memory,
    /// everything that it has seen counts.
    pub fn counts(&self) -> bool {
        matches!(self.state, None | Some(ObjectState::Remembered))
    }

    /// An object of which only the id is known.
    pub fn unknown(id: SegmentId) -> Self {
        Self {
            id,
            label: None,
            label_score: None,
            label_alternatives: Vec::new(),
            state: None,
            frames: 0,
            first_frame: None,
            last_frame: None,
            first_seen_s: None,
            last_seen_s: None,
            room: None,
            confidence: None,
            color: None,
            shape: None,
            best_view: None,
        }
    }
}

impl ObjectList {
    /// The value of the key `format`.
    pub const FORMAT: &'static str = "splatseg-objects";
    /// The value of the key `version`. Version 1 had all objects under `objects`, by increasing id.
    pub const VERSION: u32 = 2;

    /// The objects in a log or a map. Without a map, shapes and states are unknown.
    ///
    /// Names, times, confidences and best views are unknown until [`Self::add_sightings`] is called.
    pub fn new(log: &ObjectLog, map: Option<MapView<'_>>) -> Self {
        let surfaces = map.as_ref().map(ObjectSurfaces::of).unwrap_or_default();
        Self::with_surfaces(log, map, &surfaces)
    }

    /// As [`Self::new`], with the surfaces of the map's objects.
    pub fn with_surfaces(log: &ObjectLog, map: Option<MapView<'_>>, surfaces: &ObjectSurfaces) -> Self {
        let mut shapes = surfaces.shapes().clone();
        let carried = map.map(|map| map.carried_ids());
        let ids: BTreeSet<SegmentId> =
            log.records().keys().chain(shapes.keys()).chain(carried.iter().flatten()).copied().collect();
        let stamp = |number| FrameStamp { number, name: None, file: None, time_s: None };
        let object = |id: SegmentId| {
            let record = log.records().get(&id);
            let shape = shapes.remove(&id);
            Object {
                state: map.zip(carried.as_ref()).map(|(map, carried)| state_of(id, &map, carried)),
                frames: record.map_or(0, |record| record.frames),
                first_frame: record.map(|record| stamp(record.first_frame)),
                last_frame: record.map(|record| stamp(record.last_frame)),
                color: shape.as_ref().map(|shape| shape.color),
                shape,
                ..Object::unknown(id)
            }
        };
        let (objects, not_counted) = ids.into_iter().map(object).partition(Object::counts);
        let mut list = Self {
            format: Self::FORMAT.to_owned(),
            version: Self::VERSION,
            scene: None,
            frames: log.frames(),
            conventions: Conventions::default(),
            objects,
            not_counted,
            relations: Vec::new(),
            rooms: Vec::new(),
        };
        list.sort();
        list
    }

    /// All objects, first those that count.
    pub fn all(&self) -> impl Iterator<Item = &Object> {
        self.objects.iter().chain(&self.not_counted)
    }

    fn all_mut(&mut self) -> impl Iterator<Item = &mut Object> {
        self.objects.iter_mut().chain(&mut self.not_counted)
    }

    /// The object with this id.
    pub fn get(&self, id: SegmentId) -> Option<&Object> {
        self.all().find(|object| object.id == id)
    }

    /// The list with the tentative objects among those that count, for users who ask for them.
    #[must_use]
    pub fn with_tentative(mut self) -> Self {
        let (tentative, rest) =
            self.not_counted.into_iter().partition(|object: &Object| object.state == Some(ObjectState::Tentative));
        self.objects.extend::<Vec<Object>>(tentative);
        self.not_counted = rest;
        self.sort();
        self
    }

    /// The numbers of objects.
    pub fn counts(&self) -> ObjectCounts {
        let of = |state| self.not_counted.iter().filter(|object| object.state == Some(state)).count();
        ObjectCounts {
            objects: self.objects.len(),
            tentative: of(ObjectState::Tentative),
            forgotten: of(ObjectState::Forgotten),
        }
    }

    /// Sets the number of frames that show some objects.
    pub fn set_frames(&mut self, frames: &BTreeMap<SegmentId, usize>) {
        for object in self.all_mut() {
            if let Some(frames) = frames.get(&object.id) {
                object.frames = *frames;
            }
        }
        self.sort();
    }

    /// Puts the objects that most frames show first.
    fn sort(&mut self) {
        for objects in [&mut self.objects, &mut self.not_counted] {
            objects.sort_by_key(|object| (Reverse(object.frames), object.id));
        }
    }

    /// Adds the first and last frame, confidence and best view of each object.
    pub fn add_sightings(&mut self, seen: &SeenObjects) {
        for object in self.all_mut() {
            let Some(sightings) = seen.objects().get(&object.id) else { continue };
            object.first_frame = Some(sightings.first_frame.clone());
            object.last_frame = Some(sightings.last_frame.clone());
            object.confidence = Some(sightings.confidence());
            object.color = object.color.or(sightings.best_view.color);
            object.best_view = Some(sightings.best_view.clone());
        }
    }

    /// Adds the label of each object that has one, with its score and alternatives.
    pub fn add_names(&mut self, names: &ObjectNames) {
        for object in self.all_mut().filter(|_| !names.is_empty()) {
            let Some(name) = names.name(object.id) else { continue };
            object.label.clone_from(&name.label);
            object.label_score = name.score;
            object.label_alternatives.clone_from(&name.alternatives);
        }
    }

    /// Sets the relations to those of `found` between objects that count: see [`relations`](crate::relations).
    pub fn set_relations(&mut self, found: &[Relation]) {
        let counted: BTreeSet<SegmentId> = self.objects.iter().map(|object| object.id).collect();
        let is_counted = |one: &&Relation| counted.contains(&one.subject) && counted.contains(&one.object);
        self.relations = found.iter().filter(is_counted).copied().collect();
    }

    /// The JSON text, with one line for each object.
    ///
    /// # Errors
    /// No known cause: every value can be serialised.
    pub fn to_json(&self) -> serde_json::Result<String> {
        outer_lines(self)
    }
}

/// JSON text that breaks lines only at the two outer levels.
pub(crate) fn outer_lines(value: &impl Serialize) -> serde_json::Result<String> {
    let mut bytes = Vec::new();
    value.serialize(&mut serde_json::Serializer::with_formatter(&mut bytes, OuterLines::default()))?;
    bytes.push(b'\n');
    String::from_utf8(bytes).map_err(serde::ser::Error::custom)
}

impl ObjectCounts {
    /// The numbers of [`ObjectList::new`], without the shapes, which take longer.
    pub fn new(log: &ObjectLog, map: Option<MapView<'_>>) -> Self {
        let Some(map) = map else { return Self { objects: log.records().len(), ..Self::default() } };
        let carried = map.carried_ids();
        let ids: BTreeSet<SegmentId> = log.records().keys().chain(&carried).copied().collect();
        let mut counts = Self::default();
        for id in ids {
            match state_of(id, &map, &carried) {
                ObjectState::Remembered => counts.objects += 1,
                ObjectState::Tentative => counts.tentative += 1,
                ObjectState::Forgotten => counts.forgotten += 1,
            }
        }
        counts
    }
}

impl fmt::Display for ObjectCounts {
    /// `62 objects`, and in brackets what is not counted: `62 objects (12 tentative and 3 forgotten ones not counted)`.
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let plural = if self.objects == 1 { "" } else { "s" };
        write!(formatter, "{} object{plural}", self.objects)?;
        let others = [(self.tentative, "tentative"), (self.forgotten, "forgotten")];
        let others: Vec<String> =
            others.iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}")).collect();
        match (others.as_slice(), self.tentative + self.forgotten) {
            ([], _) => Ok(()),
            (others, 1) => write!(formatter, " ({} one not counted)", others.join(" and ")),
            (others, _) => write!(formatter, " ({} ones not counted)", others.join(" and ")),
        }
    }
}

impl Default for Conventions {
    fn default() -> Self {
        Self {
            length: "metres".to_owned(),
            area: "square metres".to_owned(),
            time: "seconds, from the same instant as the scene's timestamps".to_owned(),
            image:
                "pixels of the images in segments/; x to the right and y down from the top left pixel, which is (0, 0)"
                    .to_owned(),
            coordinates: "the world of the scene's camera poses".to_owned(),
            rotation: "quaternion [x, y, z, w] that turns the oriented box's axes into the world's".to_owned(),
            color: "sRGB, [red, green, blue], 0 to 255".to_owned(),
        }
    }
}

fn state_of(id: SegmentId, map: &MapView<'_>, carried: &BTreeSet<SegmentId>) -> ObjectState {
    match (carried.contains(&id), map.is_tentative(id)) {
        (false, _) => ObjectState::Forgotten,
        (true, true) => ObjectState::Tentative,
        (true, false) => ObjectState::Remembered,
    }
}

/// JSON formatter that breaks lines only at the two outer levels.
#[derive(Debug, Default)]
struct OuterLines {
    depth: usize,
}

impl OuterLines {
    const LEVELS: usize = 2;

    fn open<W: Write + ?Sized>(&mut self, writer: &mut W, bracket: &[u8]) -> io::Result<()> {
        self.depth += 1;
        writer.write_all(bracket)
    }

    fn close<W: Write + ?Sized>(&mut self, writer: &mut W, bracket: &[u8]) -> io::Result<()> {
        self.depth -= 1;
        if self.depth < Self::LEVELS {
            self.new_line(writer)?;
        }
        writer.write_all(bracket)
    }

    fn next<W: Write + ?Sized>(&self, writer: &mut W, is_first: bool) -> io::Result<()> {
        if self.depth > Self::LEVELS {
            return writer.write_all(if is_first { b"" } else { b", " });
        }
        writer.write_all(if is_first { b"" } else { b"," })?;
        self.new_line(writer)
    }

    fn new_line<W: Write + ?Sized>(&self, writer: &mut W) -> io::Result<()> {
        write!(writer, "\n{:1$}", "", 2 * self.depth)
    }
}

impl Formatter for OuterLines {
    fn begin_array<W: Write + ?Sized>(&mut self, writer: &mut W) -> io::Result<()> {
        self.open(writer, b"[")
    }

    fn end_array<W: Write + ?Sized>(&mut self, writer: &mut W) -> io::Result<()> {
        self.close(writer, b"]")
    }

    fn begin_array_value<W: Write + ?Sized>(&mut self, writer: &mut W, first: bool) -> io::Result<()> {
        self.next(writer, first)
    }

    fn begin_object<W: Write + ?Sized>(&mut self, writer: &mut W) -> io::Result<()> {
        self.open(writer, b"{")
    }

    fn end_object<W: Write + ?Sized>(&mut self, writer: &mut W) -> io::Result<()> {
        self.close(writer, b"}")
    }

    fn begin_object_key<W: Write + ?Sized>(&mut self, writer: &mut W, first: bool) -> io::Result<()> {
        self.next(writer, first)
    }

    fn begin_object_value<W: Write + ?Sized>(&mut self, writer: &mut W) -> io::Result<()> {
        writer.write_all(b": ")
    }
}
