//! Objects of a session by words.

use crate::results::header;
use splatseg::names::{ClipNames, FoundObject, NamesError, Query, find_objects};
use splatseg_objects::{Object, ObjectList, ObjectNames};
use splatseg_output::ros_messages::detections;
use splatseg_ros::Detection3dArray;
use std::sync::Arc;
use std::time::Duration;

/// The objects of a session at a moment, to be found by words: see [`LiveSession::words`](crate::LiveSession::words).
#[derive(Debug)]
pub struct LiveWords {
    pub(crate) objects: ObjectList,
    pub(crate) names: ObjectNames,
    pub(crate) network: Option<Arc<ClipNames>>,
    pub(crate) stamp: Duration,
    /// Name of the world's coordinate frame.
    pub(crate) world: String,
}

impl LiveWords {
    /// Finds the objects that fit a text, best first: by label, colour and size, and with a network by their pictures; see
    /// [`find_objects`].
    ///
    /// # Errors
    /// [`NamesError`] if the embeddings of a loaded map are of another network.
    pub fn find(&self, text: &str) -> Result<Vec<FoundObject>, NamesError> {
        find_objects(&Query::new(text), &self.objects, &self.names, self.network.as_deref())
    }

    /// The same objects with their boxes, in the world frame. The score of the first class of each is how well the object
    /// fits the text; those without a box are left out.
    pub fn detections(&self, found: &[FoundObject]) -> Detection3dArray {
        let object = |found: &FoundObject| self.objects.objects.iter().find(|object| object.id == found.id);
        let chosen: Vec<&Object> = found.iter().filter_map(object).collect();
        let mut message = detections(&header(self.stamp, &self.world), chosen.into_iter());
        for detection in &mut message.detections {
            let score = found.iter().find(|found| found.id.to_string() == detection.id).map(|found| found.score);
            if let (Some(first), Some(score)) = (detection.results.first_mut(), score) {
                first.hypothesis.score = f64::from(score);
            }
        }
        message
    }
}
