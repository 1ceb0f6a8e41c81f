//! What takes part in a run as one of its results.

use crate::OutputError;
use splatseg_geometry::{RgbdFrame, SegmentMap};
use splatseg_memory::SplatMemory;
use splatseg_objects::{ObjectList, ObjectSighting};
use std::path::PathBuf;

/// A frame with its result.
#[derive(Clone, Debug)]
pub struct FrameRecord {
    /// Position in the run, from 0: the number that [`ObjectList`] knows the frame by.
    pub number: usize,
    /// The name of its result files, without folder and extension. It holds no characters that lead out of a folder.
    pub file_name: String,
    /// The frame.
    pub frame: RgbdFrame<'static>,
    /// One lasting id per pixel, `[height, width]`; 0 where there is no segment.
    pub segments: SegmentMap,
    /// The objects in it, by increasing id.
    pub objects: Vec<ObjectSighting>,
}

/// A run after its last frame.
#[derive(Clone, Copy, Debug)]
pub struct RunEnd<'a> {
    /// The scene as it was given.
    pub scene: &'a str,
    /// Every object that a frame showed or the memory carries.
    pub objects: &'a ObjectList,
    /// The memory, if the method has one.
    pub memory: Option<&'a SplatMemory>,
}

/// The folder of a run's results.
pub trait ResultFolder {
    /// Writes a file, given by its path inside the folder with `/` between its parts, and lists it as one of the run's.
    ///
    /// # Errors
    /// If it cannot be written; then no part of it is left.
    fn write(&mut self, file: &str, bytes: &[u8]) -> Result<(), OutputError>;

    /// Where a file is that was written, given as in [`Self::write`].
    fn path_of(&self, file: &str) -> PathBuf;
}

/// A kind of result. Outputs see the frames in order, on one thread, while later frames are still processed.
///
/// A run can be stopped and go on later: [`Self::frame_state`] says what an output has kept of each frame and
/// [`Self::save`] what else, and [`Self::restore`] gives that to a new one, which is then shown only the frames after them.
/// What it writes must be the same, byte for byte, as without the stop. What grows with the number of frames belongs to the
/// frames: they are saved once, all else with every save.
pub trait RunOutput: Send {
    /// What it is called among the outputs of a run: lower-case letters.
    fn name(&self) -> &'static str;

    /// Takes in the next frame. Its id image and its overlay are in the folder: `segments/<file_name>.png`,
    /// `overlay/<file_name>.jpg`.
    ///
    /// # Errors
    /// If something cannot be written. The output is shown later frames all the same.
    fn add_frame(&mut self, record: &FrameRecord, folder: &mut dyn ResultFolder) -> Result<(), OutputError>;

    /// What it has kept of the frame that it was shown last, as one line of JSON.
    ///
    /// # Errors
    /// If it cannot be written. The output is shown later frames all the same.
    fn frame_state(&self, record: &FrameRecord) -> Result<Vec<u8>, OutputError>;

    /// What else it has kept so far, as JSON.
    ///
    /// # Errors
    /// If it cannot be written. The output is shown later frames all the same.
    fn save(&mut self, folder: &mut dyn ResultFolder) -> Result<Vec<u8>, OutputError>;

    /// Takes over what an output of the same name has saved: a line of each frame, and what else it has kept. Must come before
    /// the first frame.
    ///
    /// # Errors
    /// If this is not what such an output saves; the output is then as it was.
    fn restore(&mut self, frames: &[String], saved: &[u8]) -> serde_json::Result<()>;

    /// Writes what is known only after the last frame. A run that was interrupted has a last frame too.
    ///
    /// # Errors
    /// If something cannot be written.
    fn finish(&mut self, end: &RunEnd<'_>, folder: &mut dyn ResultFolder) -> Result<(), OutputError>;
}
