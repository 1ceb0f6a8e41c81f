//! Settings of the synthetic room, and their form on a command line.

use super::{Layout, Noise, Speed, SyntheticError, Visit};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

const KEYS: &str = "width, height, frames, seed, objects, noise, moving, camera, speed, tour, corridor or visit";
const PREFIX: &str = "synthetic";
const SIDE: std::ops::RangeInclusive<usize> = 8..=4096;
const OBJECTS: std::ops::RangeInclusive<usize> = 0..=400;
const MOVING: std::ops::RangeInclusive<usize> = 0..=60;
const FRAMES: std::ops::RangeInclusive<usize> = 1..=1_000_000;

/// Settings of the synthetic room. Written as
/// `synthetic:frames=60,seed=3,width=320,height=240,objects=20,noise=kinect`, where everything has a default.
/// `moving=2`, `camera=static`, `speed=0.04`, `tour=4` or
/// `corridor=20`, and `visit=before` or `visit=after` may be added.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SyntheticSettings {
    /// Image width, pixels, 8 to 4096. Default: 320.
    pub width: usize,
    /// Image height, pixels, 8 to 4096. Default: 240.
    pub height: usize,
    /// Number of frames, 1 to 1,000,000. A round of the camera takes 48 / `speed` in the room, 1800 / `speed` in a tour of
    /// four rooms and 600 / `speed` in one of one room, whatever the number of frames. Default: 60.
    pub frames: usize,
    /// Random seed of the arrangement and appearance of things. Default: 0.
    pub seed: u64,
    /// Number of things in the room, 0 to 400, not counting floor, ceiling and four walls. More than 60 are made
    /// smaller so that they fit. In a tour, the number in each room; a corridor ignores it. Default: 20.
    pub objects: usize,
    /// Noise added to frames. Default: none.
    pub noise: Noise,
    /// Number of things that move, 0 to 60 and at most the number of things on which nothing else stands. In turn, the
    /// first slides, the second vanishes and the third appears, and so on. Vanishing and appearing happens after a
    /// third to half of the video. Clearly visible things are chosen first. In a tour, all of them slide if they have
    /// space; in a corridor, nothing moves. Default: 0.
    pub moving: usize,
    /// Motion of the camera. Default: walking.
    pub camera: CameraMotion,
    /// Speed of the camera and of sliding things. Default: 1.
    pub speed: Speed,
    /// Layout of the scene. Default: one room.
    pub layout: Layout,
    /// The scene before or after some of its things have changed; see
    /// [`SyntheticScene::changes`](super::SyntheticScene::changes). The two new things are among the `objects`, two
    /// fifths of which are twins. Not in a corridor, and not with moving things. Default: no change.
    pub visit: Option<Visit>,
}

/// Motion of the camera in the synthetic room.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum CameraMotion {
    /// Walks along the path of the [`Layout`], in the room a circle.
    #[default]
    Walk,
    /// Stays at the start of the walk.
    Static,
}

impl Default for SyntheticSettings {
    fn default() -> Self {
        let (noise, camera) = (Noise::None, CameraMotion::Walk);
        let speed = Speed::default();
        let (layout, visit) = (Layout::Room, None);
        Self {
            width: 320,
            height: 240,
            frames: 60,
            seed: 0,
            objects: 20,
            noise,
            moving: 0,
            camera,
            speed,
            layout,
            visit,
        }
    }
}

impl SyntheticSettings {
    /// Syntax of the text, for messages.
    pub const SYNTAX: &str = "the word synthetic, or synthetic:frames=60,seed=0,width=320,height=240,objects=20,noise=none \
                          with any of these settings (noise: none or kinect), moving=2 (the number of moving things), \
                          camera=static and speed=0.04 (of all motion, for a video at 30 frames per second), or \
                          tour=4 (rooms) or corridor=20 (doors) instead of one room, or visit=before \
                          or visit=after (a room or tour before and after seven things have changed)";

    /// Returns true if a text is meant as the settings of a synthetic scene: it begins like one.
    pub fn are_meant_by(text: &str) -> bool {
        text.strip_prefix(PREFIX).is_some_and(|rest| rest.is_empty() || rest.starts_with(':'))
    }

    /// Checks that every setting is in its range.
    ///
    /// # Errors
    /// [`SyntheticError`] names the setting, the value found and the value expected.
    pub fn validate(&self) -> Result<(), SyntheticError> {
        let checks = [
            ("width", self.width, SIDE, "8 to 4096"),
            ("height", self.height, SIDE, "8 to 4096"),
            ("frames", self.frames, FRAMES, "1 to 1000000"),
            ("objects", self.objects, OBJECTS, "0 to 400"),
            ("moving", self.moving, MOVING, "0 to 60"),
            ("moving", self.moving, 0..=self.objects, "at most the number of objects"),
        ];
        let out_of_range = checks.into_iter().find(|(_, found, range, _)| !range.contains(found));
        let out_of_range = out_of_range.map(|(field, found, _, expected)| (field, found, expected));
        let wrong = out_of_range.or(self.layout.wrong_count()).or(self.contradiction());
        let Some((field, found, expected)) = wrong else { return Ok(()) };
        Err(SyntheticError {
            text: self.to_string(),
            field: field.to_owned(),
            found: found.to_string(),
            expected: expected.to_owned(),
        })
    }

    /// Returns a setting that others exclude, its value, and the values they allow.
    fn contradiction(&self) -> Option<(&'static str, usize, &'static str)> {
        match (self.layout, self.visit) {
            (Layout::Corridor(_), _) if self.moving > 0 => {
                Some(("moving", self.moving, "0: nothing moves in a corridor"))
            }
            (Layout::Corridor(doors), Some(_)) => {
                Some(("corridor", doors, "a room or a tour with visit=before or after"))
            }
            (_, Some(_)) if self.moving > 0 => Some(("moving", self.moving, "0 with visit=before or after")),
            _ => None,
        }
    }
}

impl fmt::Display for SyntheticSettings {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let noise = match self.noise {
            Noise::None => "none",
            Noise::Kinect => "kinect",
        };
        let Self { width, height, frames, seed, objects, .. } = self;
        write!(
            formatter,
            "{PREFIX}:frames={frames},seed={seed},width={width},height={height},objects={objects},noise={noise}"
        )?;
        // Only when set, so that static rooms keep their names.
        if self.moving > 0 {
            write!(formatter, ",moving={}", self.moving)?;
        }
        match self.camera {
            CameraMotion::Walk => {}
            CameraMotion::Static => write!(formatter, ",camera=static")?,
        }
        if self.speed != Speed::default() {
            write!(formatter, ",speed={}", self.speed)?;
        }
        if self.layout != Layout::default() {
            write!(formatter, ",{}", self.layout)?;
        }
        self.visit.map_or(Ok(()), |visit| write!(formatter, ",visit={}", visit.name()))
    }
}

impl FromStr for SyntheticSettings {
    type Err = SyntheticError;

    fn from_str(text: &str) -> Result<Self, SyntheticError> {
        let wrong = |field: &str, found: &str, expected: &str| SyntheticError {
            text: text.to_owned(),
            field: field.to_owned(),
            found: found.to_owned(),
            expected: expected.to_owned(),
        };
        let rest = text.strip_prefix(PREFIX).ok_or_else(|| wrong("scene", text, Self::SYNTAX))?;
        let list = match rest.strip_prefix(':') {
            Some(list) => list,
            None if rest.is_empty() => "",
            None => return Err(wrong("scene", text, Self::SYNTAX)),
        };
        let mut settings = Self::default();
        for item in list.split(',').filter(|item| !item.is_empty()) {
            let (key, value) = item.split_once('=').ok_or_else(|| wrong("setting", item, "key=value"))?;
            let number = || value.parse::<usize>().map_err(|_| wrong(key, value, "a whole number"));
            match key {
                "width" => settings.width = number()?,
                "height" => settings.height = number()?,
                "frames" => settings.frames = number()?,
                "objects" => settings.objects = number()?,
                "moving" => settings.moving = number()?,
                "seed" => settings.seed = value.parse().map_err(|_| wrong(key, value, "a whole number"))?,
                "noise" => {
                    settings.noise = match value {
                        "none" => Noise::None,
                        "kinect" => Noise::Kinect,
                        _ => return Err(wrong(key, value, "none or kinect")),
                    }
                }
                "camera" => {
                    settings.camera = match value {
                        "walk" => CameraMotion::Walk,
                        "static" => CameraMotion::Static,
                        _ => return Err(wrong(key, value, "walk or static")),
                    }
                }
                "tour" | "corridor" if settings.layout != Layout::Room => {
                    return Err(wrong(key, value, "one of tour and corridor, once"));
                }
                "tour" => settings.layout = Layout::Tour(number()?),
                "corridor" => settings.layout = Layout::Corridor(number()?),
                "visit" => {
                    settings.visit = match value {
                        "before" => Some(Visit::Before),
                        "after" => Some(Visit::After),
                        _ => return Err(wrong(key, value, "before or after")),
                    }
                }
                "speed" => settings.speed = value.parse().map_err(|_| wrong(key, value, Speed::EXPECTED))?,
                _ => return Err(wrong("setting", key, KEYS)),
            }
        }
        settings.validate()?;
        Ok(settings)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_and_settings_agree() {
        assert_eq!("synthetic".parse::<SyntheticSettings>().unwrap(), SyntheticSettings::default());
        let text = "synthetic:frames=7,seed=3,width=64,height=48,objects=5,noise=kinect";
        assert_eq!(text.parse::<SyntheticSettings>().unwrap().to_string(), text);
        let moving = format!("{text},moving=2,camera=static");
        assert_eq!(moving.parse::<SyntheticSettings>().unwrap().to_string(), moving);
        assert_eq!(format!("{text},moving=0,camera=walk").parse::<SyntheticSettings>().unwrap().to_string(), text);
        let slow = format!("{moving},speed=0.04");
        assert_eq!(slow.parse::<SyntheticSettings>().unwrap().to_string(), slow);
        assert_eq!(format!("{moving},speed=1.0").parse::<SyntheticSettings>().unwrap().to_string(), moving);
        for layout in ["tour=4", "tour=1", "corridor=20", "visit=before", "tour=4,visit=after"] {
            let tour = format!("{text},speed=0.5,{layout}");
            let settings: SyntheticSettings = tour.parse().unwrap();
            assert_eq!(settings.to_string(), tour);
            let json = serde_json::to_string(&settings).unwrap();
            assert_eq!(serde_json::from_str::<SyntheticSettings>(&json).unwrap(), settings);
        }
        let is_meant = SyntheticSettings::are_meant_by;
        assert!(is_meant(text) && is_meant("synthetic") && !is_meant("./synthetic") && !is_meant("synthetic-rooms"));
    }

    #[test]
    fn mistakes_are_named() {
        let error = |text: &str| text.parse::<SyntheticSettings>().unwrap_err().to_string();
        assert!(error("synthetic:frames=x").contains("frames: found \"x\", expected a whole number"));
        assert!(error("synthetic:frames=0").contains("expected 1 to 1000000"));
        assert!(error("synthetic:colour=1").contains("found \"colour\""));
        assert!(error("synthetic:noise=loud").contains("none or kinect"));
        assert!(error("synthetic:camera=drone").contains("camera: found \"drone\", expected walk or static"));
        for speed in ["0", "1.5", "-0.1", "0.0004", "0.0405", "nan", "fast", ""] {
            let message = format!("speed: found \"{speed}\", expected 0.001 to 1, with at most three decimals");
            assert!(error(&format!("synthetic:speed={speed}")).contains(&message), "{speed}");
        }
        assert!(error("synthetic:moving=-1").contains("moving: found \"-1\", expected a whole number"));
        assert!(error("synthetic:moving=61").contains("moving: found \"61\", expected 0 to 60"));
        let few = error("synthetic:objects=3,moving=4");
        assert!(few.contains("moving: found \"4\", expected at most the number of objects"), "{few}");
        assert!(error("synthetic:noise").contains("key=value"));
        assert!(error("synthetic:tour=3").contains("tour: found \"3\", expected 1 or 4 rooms"));
        assert!(error("synthetic:corridor=0").contains("corridor: found \"0\", expected 1 to 100 doors"));
        assert!(error("synthetic:corridor=9,tour=4").contains("tour: found \"4\", expected one of tour and corridor"));
        assert!(error("synthetic:corridor=9,moving=1").contains("moving: found \"1\", expected 0: nothing moves"));
        assert!(error("synthetic:visit=now").contains("visit: found \"now\", expected before or after"));
        assert!(error("synthetic:visit=after,moving=1").contains("moving: found \"1\", expected 0 with visit"));
        assert!(error("synthetic:visit=after,corridor=9").contains("corridor: found \"9\", expected a room or a tour"));
    }
}
