//! Finds a camera that is lost: its place is recognised, or a new part of the map begins.

use crate::graph::Edge;
use crate::keyframe_map::KeyframeMap;
use crate::keyframes::{StoredKeyframe, apart};
use crate::loop_closing::edge;
use crate::relocalisation::{MIN_INLIERS_LOST, Query, Recognised};
use crate::tracked_frame::TrackedFrame;
use crate::{CameraPose, Odometry, PoseState};
use splatseg_geometry::Pose;
use std::time::Duration;

/// A place that was recognised once must be recognised again within this many frames.
const MAX_PROBATION: u32 = 15;

/// The second time, the place must be this close to where tracking from the first one leads, metres and radians.
const SAME_PLACE: (f64, f64) = (0.07, 0.07);

/// A place that is not recognised in this many frames with a view belongs to a new part of the map: three seconds of a
/// video.
const NEW_PART_AFTER: u32 = 90;

/// A lost camera may have moved this far, metres, at once and per second.
const REACH: (f64, f64) = (0.5, 1.5);

/// Time between frames without timestamps, seconds.
const FRAME_TIME: f64 = 1.0 / 30.0;

/// The search for a lost camera.
#[derive(Clone, Debug, Default)]
pub(crate) struct LostCamera {
    /// Tracking from a place that was recognised once.
    pub(crate) probation: Option<Probation>,
    /// Frames with a view since the camera was lost.
    pub(crate) views: u32,
    /// All frames since then.
    pub(crate) frames: u32,
    /// Time of the last frame with a known pose.
    pub(crate) since: Option<Duration>,
}

/// A place that is to be confirmed.
#[derive(Clone, Debug)]
pub(crate) struct Probation {
    pub(crate) odometry: Odometry,
    /// Keyframes made since then, with the relative pose of each.
    pub(crate) keyframes: Vec<(StoredKeyframe, Option<Edge>)>,
    pub(crate) frames: u32,
}

/// The outcome of a frame of a lost camera.
pub(crate) enum Search {
    /// Still lost.
    Lost,
    /// The camera has been found.
    Found(Box<Odometry>, CameraPose),
    /// A new part of the map begins with this frame.
    NewPart,
}

impl LostCamera {
    /// Searches for the place of a frame. `last` is the last known pose, if it belongs to the map.
    pub(crate) fn search(&mut self, map: &mut KeyframeMap, frame: &TrackedFrame<'_>, last: Option<&Pose>) -> Search {
        self.frames += 1;
        let query = Query::new(&frame.pyramid);
        if !query.has_view() {
            self.probation = None;
            return Search::Lost;
        }
        self.views += 1;
        let recognised = self.recognised(map, &query, frame.timestamp, last);
        let tracked = self.probation.take().and_then(|probation| probation.tracked(map, frame));
        match (recognised, tracked) {
            (Some(place), Some((probation, pose))) if is_same(&place, &pose) => {
                let Probation { odometry, keyframes, .. } = probation;
                keyframes.into_iter().for_each(|(keyframe, edge)| map.add(keyframe, edge));
                map.find_uncertain();
                *self = Self::default();
                return Search::Found(Box::new(odometry), pose);
            }
            (Some(place), _) => self.probation = Probation::start(map, frame, &place),
            (None, tracked) => {
                self.probation = tracked.map(|(probation, _)| probation).filter(|it| it.frames < MAX_PROBATION);
            }
        }
        if self.views > NEW_PART_AFTER && self.probation.is_none() {
            *self = Self::default();
            return Search::NewPart;
        }
        Search::Lost
    }

    fn recognised(
        &self,
        map: &KeyframeMap,
        query: &Query,
        timestamp: Option<Duration>,
        last: Option<&Pose>,
    ) -> Option<Recognised> {
        let elapsed = timestamp.zip(self.since).and_then(|(now, since)| now.checked_sub(since));
        let elapsed = elapsed.map_or(f64::from(self.frames) * FRAME_TIME, |elapsed| elapsed.as_secs_f64());
        let reach = REACH.0 + REACH.1 * elapsed;
        // How far away the other parts of the map are is not known.
        let is_near = |part: u32, pose: &Pose, reach: f64| {
            last.is_none_or(|last| part != map.part || apart(last, pose).0 <= reach)
        };
        // A keyframe shows the same place from up to a metre away.
        let found = query.recognise(
            &map.store,
            |keyframe| is_near(keyframe.part, &keyframe.world_from_key, reach + 1.0),
            u64::from(self.frames),
        )?;
        let part = map.store.get(found.keyframe)?.part;
        let is_clear = found.inliers >= MIN_INLIERS_LOST;
        (is_clear && is_near(part, &found.world_from_camera, reach)).then_some(found)
    }
}

fn is_same(place: &Recognised, pose: &CameraPose) -> bool {
    let (distance, angle) = apart(&place.world_from_camera, &pose.world_from_camera);
    distance <= SAME_PLACE.0 && angle <= SAME_PLACE.1
}

impl Probation {
    fn start(map: &KeyframeMap, frame: &TrackedFrame<'_>, place: &Recognised) -> Option<Self> {
        let mut odometry = Odometry { next_keyframe: map.store.next, ..Odometry::new() };
        odometry.set_frame(frame, &place.world_from_camera);
        let made = odometry.made.take()?;
        let part = map.store.get(place.keyframe)?.part;
        let keyframe = StoredKeyframe::new(made.id, frame, made.world_from_key, part, map.session);
        let edge = edge(place, made.id);
        Some(Self { odometry, keyframes: vec![(keyframe, Some(edge))], frames: 0 })
    }

    /// Tracks the next frame. `None` if that fails.
    fn tracked(mut self, map: &KeyframeMap, frame: &TrackedFrame<'_>) -> Option<(Self, CameraPose)> {
        let pose = self.odometry.track_frame(frame, &Pose::IDENTITY, None);
        if pose.state != PoseState::Tracked {
            return None;
        }
        self.frames += 1;
        if let Some(made) = self.odometry.made.take() {
            let part = self.keyframes.first()?.0.part;
            let keyframe = StoredKeyframe::new(made.id, frame, made.world_from_key, part, map.session);
            self.keyframes.push((keyframe, made.link));
        }
        Some((self, pose))
    }
}
