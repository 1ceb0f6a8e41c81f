//! The interface of a run's outputs.

use crate::OutputError;
use splatseg_dataset::read_segments_png;
use splatseg_geometry::{CowImage, FrameAnchor, MapView, Pose, RemappedId, RgbdFrame, SegmentId, SegmentMap};
use splatseg_objects::{MapChanges, ObjectList, ObjectSighting, RemapLog};
use splatseg_odometry::PoseState;
use splatseg_places::FloorPlan;
use std::collections::BTreeSet;
use std::path::PathBuf;

/// A frame with its result.
#[derive(Clone, Debug)]
pub struct FrameRecord {
    /// Position in the run, from 0: the frame's number in [`ObjectList`].
    pub number: usize,
    /// Index of the frame in its source, from 0.
    pub index: usize,
    /// Name of the frame's result files, without folder and extension. It contains no characters that lead out of a
    /// folder.
    pub file_name: String,
    /// Whether the frame's pose is known. If it is lost, the frame has the last known one.
    pub pose_state: PoseState,
    /// The frame.
    pub frame: RgbdFrame<'static>,
    /// The persistent object id of each pixel, `[height, width]`; 0 where there is no segment.
    pub segments: SegmentMap,
    /// The segmenter's finer cut of the frame, `[height, width]`, 0 for none, if it has one.
    pub regions: Option<SegmentMap>,
    /// The objects in the frame, by increasing id.
    pub objects: Vec<ObjectSighting>,
    /// The keyframe to which the frame's pose is attached.
    pub anchor: FrameAnchor,
    /// Ids of earlier frames that turned out to be the same object before this frame.
    pub remapped: Vec<RemappedId>,
}

/// An earlier frame whose images were written again, because ids in it turned out to be the same object.
#[derive(Clone, Copy, Debug)]
pub struct UpdatedFrame<'a> {
    /// Its place among the frames passed to [`RunOutput::add_frame`], from 0.
    pub position: usize,
    /// Its number in the run, as in [`FrameRecord::number`].
    pub number: usize,
    /// Its colour image, sRGB, `[height, width]`.
    pub color: &'a CowImage<'a, [u8; 3]>,
    /// Its final ids, `[height, width]`.
    pub segments: &'a SegmentMap,
    /// The ids that other ids in this frame turned out to be.
    pub remapped: &'a BTreeSet<SegmentId>,
}

/// A run after its last frame.
#[derive(Clone, Copy, Debug)]
pub struct RunEnd<'a> {
    /// The scene as given by the user.
    pub scene: &'a str,
    /// Every object that was seen in a frame or is in the memory.
    pub objects: &'a ObjectList,
    /// The map, if the method has one.
    pub map: Option<MapView<'a>>,
    /// The plan of the map, if it has keyframes that show a floor.
    pub plan: Option<&'a FloorPlan>,
    /// For each frame passed to [`RunOutput::add_frame`], the correction of its pose since then: new world coordinates
    /// from old ones. `None` if the pose has not changed; frames past the end have not changed either.
    pub pose_corrections: &'a [Option<Pose>],
    /// The ids that turned out to be the same object. Frames are numbered by their place among those passed to
    /// [`RunOutput::add_frame`].
    pub remaps: &'a RemapLog,
    /// Changes since the map that the run has loaded, if it has loaded one.
    pub changes: Option<ChangesSince<'a>>,
}

/// Changes since an earlier map.
#[derive(Clone, Copy, Debug)]
pub struct ChangesSince<'a> {
    /// The earlier map, in the same world coordinates as [`RunEnd::map`].
    pub before: MapView<'a>,
    /// The changes.
    pub changes: &'a MapChanges,
}

impl RunEnd<'_> {
    /// The final pose of a frame that had the pose `world_from_camera`. `position` is its place among the frames passed
    /// to [`RunOutput::add_frame`].
    pub fn final_pose(&self, position: usize, world_from_camera: &Pose) -> Pose {
        match self.pose_corrections.get(position) {
            Some(Some(new_from_old)) => *new_from_old * *world_from_camera,
            _ => *world_from_camera,
        }
    }
}

/// The folder of a run's results.
pub trait ResultFolder {
    /// Writes a file and lists it as one of the run's. `file` is a path relative to the folder, with `/` between its
    /// parts.
    ///
    /// # Errors
    /// If the file cannot be written; no partial file is left.
    fn write(&mut self, file: &str, bytes: &[u8]) -> Result<(), OutputError>;

    /// Removes a file if it exists; `file` is as in [`Self::write`]. It may stay listed as one of the run's.
    ///
    /// # Errors
    /// If the file cannot be removed.
    fn remove(&mut self, file: &str) -> Result<(), OutputError>;

    /// The path of a written file; `file` is as in [`Self::write`].
    fn path_of(&self, file: &str) -> PathBuf;
}

/// A kind of result. Outputs receive the frames in order, on one thread, while later frames are still being processed.
///
/// A run can be stopped and resumed. [`Self::frame_state`] returns the state that belongs to one frame, [`Self::save`]
/// the rest, and [`Self::restore`] loads both into a new output, which then receives only the later frames. The files
/// of a resumed run must equal those of an uninterrupted run byte for byte. State that grows with the number of frames
/// belongs in [`Self::frame_state`]: it is saved once per frame, whereas the rest is written with every save.
pub trait RunOutput: Send {
    /// The output's name, unique in a run: lower-case letters.
    fn name(&self) -> &'static str;

    /// Records the next frame. First, [`FrameRecord::remapped`] applies to all earlier frames. Its id image and its overlay are already in the folder: `segments/<file_name>.png`,
    /// `overlay/<file_name>.jpg`.
    ///
    /// # Errors
    /// If something cannot be written. The output is shown later frames all the same.
    fn add_frame(&mut self, record: &FrameRecord, folder: &mut dyn ResultFolder) -> Result<(), OutputError>;

    /// Returns the state of the latest frame, as one line of JSON.
    ///
    /// # Errors
    /// If it cannot be written. The output is shown later frames all the same.
    fn frame_state(&self, record: &FrameRecord) -> Result<Vec<u8>, OutputError>;

    /// Returns the state that does not belong to single frames, as JSON.
    ///
    /// # Errors
    /// If it cannot be written. The output is shown later frames all the same.
    fn save(&mut self, folder: &mut dyn ResultFolder) -> Result<Vec<u8>, OutputError>;

    /// Loads the state of an output of the same name: the line of each frame from [`Self::frame_state`], and the result
    /// of [`Self::save`]. Must be called before the first frame.
    ///
    /// # Errors
    /// If the state is invalid; the output is then unchanged.
    fn restore(&mut self, frames: &[String], saved: &[u8]) -> serde_json::Result<()>;

    /// Receives an earlier frame whose images in the folder were written again with the final ids: after the last frame and
    /// before [`Self::finish`], in the order of the frames.
    ///
    /// # Errors
    /// If something cannot be written.
    fn update_frame(&mut self, _frame: &UpdatedFrame<'_>, _folder: &mut dyn ResultFolder) -> Result<(), OutputError> {
        Ok(())
    }

    /// Writes the files that need the whole run. Also called at the end of an interrupted run.
    ///
    /// # Errors
    /// If something cannot be written.
    fn finish(&mut self, end: &RunEnd<'_>, folder: &mut dyn ResultFolder) -> Result<(), OutputError>;
}

/// Reads the id image of a frame back from the folder.
///
/// # Errors
/// [`OutputError::IdImage`].
pub(crate) fn written_ids(folder: &dyn ResultFolder, file_name: &str) -> Result<SegmentMap, OutputError> {
    Ok(read_segments_png(&folder.path_of(&format!("segments/{file_name}.png")))?)
}
