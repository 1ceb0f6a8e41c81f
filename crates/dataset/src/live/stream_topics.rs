//! The topics chosen for a stream.

use super::coordinate_frames::CoordinateFrames;
use super::undecoded_frame::STREAM;
use crate::ros_topics::choice::{Choice, Chooser, NoPoses, PoseChoice};
use crate::ros_topics::contents::{Content, Contents, Images, Topic};
use crate::ros_topics::frames::{FrameMaker, PoseSource};
use crate::ros_topics::reader::FrameReader;
use crate::{DatasetError, DatasetSettings};
use std::path::Path;
use std::sync::Arc;

/// The topics used, by index in the stream's contents.
#[derive(Debug)]
pub(super) struct StreamTopics {
    pub(super) color: usize,
    /// Equal to `color` if there is no depth.
    pub(super) depth: usize,
    infos: [Option<usize>; 2],
    pub(super) poses: PoseSource,
    pub(super) reader: Arc<FrameReader>,
    /// Descriptions of the sources, one line each.
    pub(super) sources: Vec<String>,
    pub(super) coordinate_frames: CoordinateFrames,
}

impl StreamTopics {
    /// Chooses among the topics seen so far.
    ///
    /// # Errors
    /// As for a recording with these topics.
    pub(super) fn new(contents: &Contents, settings: &DatasetSettings) -> Result<Self, DatasetError> {
        let path = Path::new(STREAM);
        let choice = Chooser { path, contents, settings }.choose()?;
        if choice.has_depth && std::ptr::eq(choice.color.0, choice.depth.0) {
            return Err(DatasetError::Field {
                path: path.to_owned(),
                field: "dataset.depth".to_owned(),
                found: format!("{:?}", choice.depth.0.name),
                expected: "another topic than that of the colour images".to_owned(),
            });
        }
        let maker = FrameMaker { path, contents, settings, choice };
        // First what may fail for lack of a message, so that nothing is warned of before topics are chosen.
        let reader = Arc::new(FrameReader::new(&maker)?);
        let (poses, pose_text) = maker.pose_source()?;
        maker.warn_of_quaternions();
        let camera = choice.color.1.frame.clone();
        let world = maker.world_frame().filter(|world| !world.is_empty()).map(str::to_owned);
        let coordinate_frames = CoordinateFrames { camera, world };
        let sources = reader.sources(&choice).into_iter().chain([format!("poses: {pose_text}")]).collect();
        let index = |topic: &Topic| contents.index_of(topic).unwrap_or(usize::MAX);
        let (color, depth) = (index(choice.color.0), index(choice.depth.0));
        let infos = [choice.color_info, choice.depth_info].map(|info| info.map(index));
        Ok(Self { color, depth, infos, poses, reader, sources, coordinate_frames })
    }

    /// Returns true if frames have depth.
    pub(super) fn has_depth(&self) -> bool {
        self.color != self.depth
    }

    /// Returns true if the messages of a topic are used.
    pub(super) fn uses(&self, index: usize, topic: &Topic) -> bool {
        match topic.content {
            Content::Images(_) => self.color == index || self.depth == index,
            Content::Calibrations { .. } => self.infos.contains(&Some(index)),
            Content::Poses(_) => matches!(self.poses, PoseSource::Topic(poses, _) if poses == index),
            Content::Transforms { .. } | Content::DepthUnit { .. } => true,
            Content::Path(_) | Content::Other => false,
        }
    }

    /// Prepares reading images with the cameras described now.
    ///
    /// # Errors
    /// If one of them is invalid.
    pub(super) fn renew_reader(&mut self, contents: &Contents, settings: &DatasetSettings) -> Result<(), DatasetError> {
        let topics = || Some((images(contents, self.color)?, images(contents, self.depth)?));
        let [color_info, depth_info] = self.infos.map(|index| contents.topics.get(index?));
        let Some((color, depth)) = topics() else { return Ok(()) };
        // Reading images does not depend on the poses.
        let pose = PoseChoice::None(NoPoses::Chosen);
        let choice = Choice { color, depth, has_depth: self.has_depth(), color_info, depth_info, pose };
        let maker = FrameMaker { path: Path::new(STREAM), contents, settings, choice };
        self.reader = Arc::new(FrameReader::new(&maker)?);
        Ok(())
    }
}

/// Returns the topic with an index, if it has images.
fn images(contents: &Contents, index: usize) -> Option<(&Topic, &Images)> {
    let topic = contents.topics.get(index)?;
    match &topic.content {
        Content::Images(images) => Some((topic, images)),
        _ => None,
    }
}
