//! Facts about an object in answers, as data and in words.

use crate::boxes::SolidBox;
use crate::open_map::LoadedMap;
use chrono::{DateTime, SecondsFormat};
use glam::DVec3;
use rmcp::schemars::{self, JsonSchema};
use serde::Serialize;
use splatseg::names::color_word;
use splatseg_geometry::SegmentId;
use splatseg_objects::{FrameStamp, Object, ObjectShape, ObjectState};

/// True if a time is seconds since 1970 for sure: no recording that begins at 0 is so long. Only such times of different
/// recordings can be compared.
pub(crate) fn is_date(time_s: f64) -> bool {
    time_s > 1e9
}

/// A number of things: `1 room`, `2 rooms`.
pub(crate) fn counted(count: usize, thing: &str) -> String {
    format!("{count} {thing}{}", if count == 1 { "" } else { "s" })
}

/// An object in a few lines.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct ObjectFacts {
    /// Its id, which stays the same. Use it in other calls.
    pub id: SegmentId,
    /// Its name; null if nobody has named it.
    pub name: Option<String>,
    /// How clearly the name fits, 0 to 1, if a network gave it.
    pub name_score: Option<f32>,
    /// Its mean colour in a word.
    pub color: Option<String>,
    /// Centre of its box, metres; null if it never had depth.
    pub center_m: Option<[f64; 3]>,
    /// Sides of its box, the longest first, metres.
    pub size_m: Option<[f64; 3]>,
    /// The room it is in; null if that is not known.
    pub room: Option<String>,
    /// Number of frames that showed it; null if that is not known.
    pub frames: Option<usize>,
    /// When it was last seen; null if that is not known.
    pub last_seen: Option<LastSeen>,
    /// True if it was seen in one frame only, so it may be a mistake.
    pub tentative: bool,
}

/// When an object was last seen.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct LastSeen {
    /// Number of the frame in the recording, from 0; in all recordings of the map together if only the map tells.
    pub frame: usize,
    /// Its time, seconds since 1970, or by the clock of the recording. Null if it has none, or if only the map tells and its
    /// clock did not count from 1970.
    pub time_s: Option<f64>,
    /// Its time as a date (UTC), if the recording has real times.
    pub date: Option<String>,
    /// Seconds from then to the last frame that showed any object; null if their times cannot be compared.
    pub seconds_before_end: Option<f64>,
}

impl ObjectFacts {
    /// Facts about an object of the map.
    pub fn new(object: &Object, map: &LoadedMap) -> Self {
        let shape = object.shape.as_ref();
        Self {
            id: object.id,
            name: object.label.clone(),
            name_score: object.label_score,
            color: object.color.map(|color| color_word(color).to_owned()),
            center_m: shape.map(|shape| rounded(shape.oriented_box.center)),
            size_m: shape.map(sides),
            room: map.places.as_ref().ok().and_then(|places| places.room_of(object.id)),
            frames: map.last_frame.as_ref().filter(|_| object.first_frame.is_some()).map(|_| object.frames),
            last_seen: object.last_frame.as_ref().map(|frame| LastSeen::new(frame, map.last_frame.as_ref())),
            tentative: object.state == Some(ObjectState::Tentative),
        }
    }

    /// A line, e.g. `15 mug, red, 0.12 x 0.10 x 0.09 m at (1.20, 0.40, 0.75)`.
    pub fn line(&self) -> String {
        let mut line = format!("{} {}", self.id, self.name.as_deref().unwrap_or("(no name)"));
        if let Some(color) = &self.color {
            line += &format!(", {color}");
        }
        match (self.size_m, self.center_m) {
            (Some([long, middle, short]), Some(center)) => {
                line += &format!(", {long:.2} x {middle:.2} x {short:.2} m at {}", place(center));
            }
            _ => line += ", without depth",
        }
        if let Some(room) = &self.room {
            line += &format!(", in {room}");
        }
        if let Some(seen) = &self.last_seen {
            line += &format!(", last seen {}", seen.words());
        }
        if self.tentative {
            line += ", tentative";
        }
        line
    }
}

impl LastSeen {
    fn new(frame: &FrameStamp, last: Option<&FrameStamp>) -> Self {
        let end = last.and_then(|last| last.time_s);
        let date = |time: f64| {
            DateTime::from_timestamp_secs(time as i64).map(|time| time.to_rfc3339_opts(SecondsFormat::Secs, true))
        };
        Self {
            frame: frame.number,
            time_s: frame.time_s,
            date: frame.time_s.filter(|time| is_date(*time)).and_then(date),
            // Of different clocks, one tells nothing about the other.
            seconds_before_end: frame
                .time_s
                .zip(end)
                .filter(|(time, end)| is_date(*time) == is_date(*end))
                .map(|(time, end)| thousandths(end - time)),
        }
    }

    /// E.g. `in frame 120 at 12.0 s, 3.1 s before its end`.
    pub fn words(&self) -> String {
        let when = match (&self.date, self.time_s) {
            (Some(date), _) => format!("on {date}"),
            (None, Some(time)) => format!("at {time:.1} s"),
            (None, None) => String::new(),
        };
        let ago = self.seconds_before_end.map_or_else(String::new, |ago| match ago {
            ago if ago <= 0.0 => ", to the end of the recording".to_owned(),
            ago => format!(", {ago:.1} s before the recording's end"),
        });
        format!("in frame {} {when}", self.frame).trim_end().to_owned() + &ago
    }
}

/// An object by id and name, e.g. `mug (15)` or `object 15`.
pub fn called(object: &Object) -> String {
    match &object.label {
        Some(label) => format!("{label} ({})", object.id),
        None => format!("object {}", object.id),
    }
}

/// The box of an object.
pub fn solid(object: &Object) -> Option<SolidBox> {
    object.shape.as_ref().map(|shape| SolidBox::new(&shape.oriented_box))
}

/// A place to the millimetre.
pub fn rounded(place: DVec3) -> [f64; 3] {
    place.to_array().map(thousandths)
}

/// A number to three decimals.
pub fn thousandths(number: f64) -> f64 {
    // Without a zero that has a sign.
    (number * 1e3).round() / 1e3 + 0.0
}

/// A place in words: `(1.20, 0.40, 0.75)`.
pub fn place([x, y, z]: [f64; 3]) -> String {
    format!("({x:.2}, {y:.2}, {z:.2})")
}

/// Sides of an object's box, the longest first, metres.
fn sides(shape: &ObjectShape) -> [f64; 3] {
    let mut sides = shape.oriented_box.size.to_array().map(|side| thousandths(f64::from(side)));
    sides.sort_by(|one, other| other.total_cmp(one));
    sides
}
