//! Messages about the source of the camera's poses.

use crate::terminal::counted;
use splatseg::geometry::QuarterTurn;
use splatseg::odometry::{CameraPose, PoseEvent, PoseMode, PoseState};
use splatseg::summary::RunCounts;

/// From this many frames on, the residuals are judged.
const MIN_FRAMES: usize = 30;

/// Median deviation of the measured depth from the tracked surfaces, in units of the noise within a frame, above which the
/// camera's intrinsics or its depth are probably wrong. Videos of good and of noisy cameras have 1 to 2.4.
const MAX_RESIDUAL: f32 = 3.0;

/// Maximum number of messages about the camera.
const MAX_MESSAGES: usize = 30;

/// Describes the source of the poses of a scene, at the start of a run.
pub fn described(mode: PoseMode, has_poses: bool) -> &'static str {
    match (mode, has_poses) {
        (PoseMode::Auto, true) => "poses: given; frames without one are tracked",
        (PoseMode::Auto, false) => "poses: none given, the camera is tracked",
        (PoseMode::Given, _) => "poses: given; frames without one are skipped",
        (PoseMode::Refine, true) => "poses: given, refined by tracking",
        (PoseMode::Refine, false) => "poses: none given to refine, the camera is tracked",
        // `PoseMode` may get more values.
        _ => "poses: the camera is tracked",
    }
}

/// Follows the camera during a run.
#[derive(Debug, Default)]
pub struct CameraMessages {
    /// True if a map was loaded in which the camera has not been found yet.
    is_unplaced: bool,
    state: Option<PoseState>,
    turn: QuarterTurn,
    messages: usize,
}

impl CameraMessages {
    /// Creates messages for a run. `has_loaded_map` is true if it starts with a saved map. `turn` was told before it was
    /// resumed.
    pub fn new(has_loaded_map: bool, turn: QuarterTurn) -> Self {
        Self { is_unplaced: has_loaded_map, turn, ..Self::default() }
    }

    /// The turn that was told last.
    pub fn turn(&self) -> QuarterTurn {
        self.turn
    }

    /// Records a frame. Returns messages if tracking was lost or has resumed, and about what was found out with the frame.
    /// `remapped_ids` is the number of ids that turned out to be the same object as others.
    pub fn add(&mut self, frame: &str, pose: &CameraPose, events: &[PoseEvent], remapped_ids: usize) -> Vec<String> {
        let before = self.state.replace(pose.state);
        let mut messages: Vec<(&str, String)> =
            events.iter().filter_map(|event| Some(("", described_event(event, remapped_ids)?))).collect();
        match (before, pose.state) {
            (None, PoseState::Lost) if self.is_unplaced => {
                messages.push(("", "the camera's place in the loaded map is searched for".to_owned()));
            }
            (Some(PoseState::Lost), PoseState::Lost) => {}
            (_, PoseState::Lost) => {
                messages.push(("warning: ", "tracking of the camera is lost; the map does not change".to_owned()));
            }
            (Some(PoseState::Lost), _) if events.is_empty() => {
                messages.push(("", "the camera's pose is known again".to_owned()));
            }
            _ => {}
        }
        self.is_unplaced &= pose.state == PoseState::Lost;
        let left = MAX_MESSAGES.saturating_sub(self.messages);
        self.messages += messages.len();
        let is_last = messages.len() >= left && left > 0;
        let mut messages: Vec<String> =
            messages.into_iter().take(left).map(|(kind, message)| format!("{kind}frame {frame}: {message}")).collect();
        if is_last {
            messages.push("there are no further messages about the camera".to_owned());
        }
        messages
    }

    /// Records the turn of a frame for the segmenter. Returns a message if it is another than before.
    pub fn add_turn(&mut self, frame: &str, turn: QuarterTurn) -> Option<String> {
        if std::mem::replace(&mut self.turn, turn) == turn || self.messages >= MAX_MESSAGES {
            return None;
        }
        self.messages += 1;
        let how = match turn {
            QuarterTurn::None => "upright: frames are segmented as they are".to_owned(),
            QuarterTurn::Half => "upside down: frames are turned by 180 degrees for the segmenter".to_owned(),
            _ => format!("sideways: frames are turned clockwise by {} degrees for the segmenter", turn.degrees()),
        };
        Some(format!("frame {frame}: the camera is held {how}"))
    }

    /// A message for the end of the run: the camera was never found in the loaded map.
    pub fn at_end(&self) -> Option<&'static str> {
        let is_searching = self.is_unplaced && self.state == Some(PoseState::Lost);
        is_searching.then_some("the camera's place in the loaded map was not found in any frame")
    }
}

fn described_event(event: &PoseEvent, remapped_ids: usize) -> Option<String> {
    Some(match *event {
        PoseEvent::FoundAgain { lost_frames } => {
            format!("the camera was found again in the map, after {}", counted(lost_frames, "frame"))
        }
        PoseEvent::FoundInLoadedMap { lost_frames } => {
            format!("the camera's place in the loaded map was found, after {}", counted(lost_frames, "frame"))
        }
        PoseEvent::NewPart { lost_frames, was_loaded } => {
            let map = if was_loaded { "the loaded map" } else { "the map" };
            let frames = counted(lost_frames, "frame");
            format!("the camera was not found in {map} for {frames}: a new part of the map begins")
        }
        PoseEvent::LoopClosed { keyframes, joined_parts: true, .. } => {
            let (keyframes, ids) = (counted(keyframes, "keyframe"), remapped(remapped_ids));
            format!("a new part of the map was joined with the rest: {keyframes} moved{ids}")
        }
        PoseEvent::LoopClosed { moved, keyframes, joined_parts: false } => {
            let (keyframes, ids, moved) = (counted(keyframes, "keyframe"), remapped(remapped_ids), 100.0 * moved);
            format!("loop closed: the camera moved by {moved:.1} cm; {keyframes} corrected{ids}")
        }
        // `PoseEvent` may get more kinds.
        _ => return None,
    })
}

fn remapped(ids: usize) -> String {
    if ids == 0 { String::new() } else { format!(", {} remapped to older ones", counted(ids, "id")) }
}

/// Returns a warning if the depth fits the tracked camera badly in most frames.
pub fn misfit(counts: &RunCounts) -> Option<String> {
    let residual = counts.pose_residual().filter(|_| counts.pose_residuals.len() >= MIN_FRAMES)?;
    (residual > MAX_RESIDUAL).then(|| {
        format!(
            "the depth of consecutive frames differs by {residual:.1} times the noise within a frame: check the focal length, \
             the unit of the depth, and whether it is registered to the colour"
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use splatseg_geometry::Pose;

    fn pose(state: PoseState) -> CameraPose {
        CameraPose { world_from_camera: Pose::IDENTITY, state, quality: None }
    }

    #[test]
    fn each_event_has_a_line() {
        let mut messages = CameraMessages::new(false, QuarterTurn::None);
        let mut add = |state, events: &[PoseEvent]| messages.add("7", &pose(state), events, 3);
        assert!(add(PoseState::Tracked, &[]).is_empty());
        assert_eq!(
            add(PoseState::Lost, &[]),
            ["warning: frame 7: tracking of the camera is lost; the map does not change"]
        );
        assert!(add(PoseState::Lost, &[]).is_empty());
        assert_eq!(add(PoseState::Tracked, &[]), ["frame 7: the camera's pose is known again"]);
        add(PoseState::Lost, &[]);
        let found = add(PoseState::Tracked, &[PoseEvent::FoundAgain { lost_frames: 12 }]);
        assert_eq!(found, ["frame 7: the camera was found again in the map, after 12 frames"]);
        let closed = |joined_parts| PoseEvent::LoopClosed { moved: 0.034, keyframes: 41, joined_parts };
        assert_eq!(
            add(PoseState::Tracked, &[closed(false)]),
            ["frame 7: loop closed: the camera moved by 3.4 cm; 41 keyframes corrected, 3 ids remapped to older ones"]
        );
        assert_eq!(
            add(PoseState::Tracked, &[closed(true)]),
            [
                "frame 7: a new part of the map was joined with the rest: 41 keyframes moved, 3 ids remapped to older ones"
            ]
        );
        assert_eq!(
            add(PoseState::Tracked, &[PoseEvent::NewPart { lost_frames: 90, was_loaded: false }]),
            ["frame 7: the camera was not found in the map for 90 frames: a new part of the map begins"]
        );
        assert_eq!(messages.at_end(), None);
    }

    #[test]
    fn a_camera_that_is_turned_is_told_once() {
        let mut messages = CameraMessages::new(false, QuarterTurn::None);
        let turns = [QuarterTurn::None, QuarterTurn::Right, QuarterTurn::Right, QuarterTurn::None];
        let told: Vec<String> = turns.iter().filter_map(|turn| messages.add_turn("7", *turn)).collect();
        assert_eq!(
            told,
            [
                "frame 7: the camera is held sideways: frames are turned clockwise by 90 degrees for the segmenter",
                "frame 7: the camera is held upright: frames are segmented as they are"
            ]
        );
    }

    #[test]
    fn a_turn_is_not_told_again_after_a_stop() {
        let mut messages = CameraMessages::new(false, QuarterTurn::Right);
        assert_eq!((messages.add_turn("7", QuarterTurn::Right), messages.turn()), (None, QuarterTurn::Right));
        assert!(messages.add_turn("8", QuarterTurn::None).is_some_and(|text| text.contains("upright")));
    }

    #[test]
    fn a_camera_that_is_not_found_in_a_loaded_map_is_reported_at_the_end() {
        let mut messages = CameraMessages::new(true, QuarterTurn::None);
        let first = messages.add("0", &pose(PoseState::Lost), &[], 0);
        assert!(first.len() == 1 && first[0].contains("is searched for"), "{first:?}");
        assert!(messages.at_end().unwrap().contains("was not found"));
        let found = messages.add("1", &pose(PoseState::Tracked), &[PoseEvent::FoundInLoadedMap { lost_frames: 1 }], 0);
        assert_eq!(found, ["frame 1: the camera's place in the loaded map was found, after 1 frame"]);
        assert_eq!(messages.at_end(), None);
    }

    #[test]
    fn messages_end_and_say_so() {
        let mut messages = CameraMessages::new(false, QuarterTurn::None);
        let states = [PoseState::Tracked, PoseState::Lost];
        let all: Vec<String> = (0..100).flat_map(|k| messages.add("0", &pose(states[k % 2]), &[], 0)).collect();
        assert!(all.len() == MAX_MESSAGES + 1 && all.last().unwrap().contains("no further messages"), "{all:?}");
    }
}
