//! What a run writes besides the images of its frames.

use super::Job;
use splatseg_output::{CocoFile, McapFile, ObjectsFile, Page, RunOutput};

/// The outputs of a run, in the order in which they are shown frames: the list of objects, all masks and the recording
/// for viewers if there are files for them, and the page to look at. The page comes last, as it shows the others.
pub fn of(job: &Job) -> Vec<Box<dyn RunOutput>> {
    let mut outputs: Vec<Box<dyn RunOutput>> = vec![Box::new(ObjectsFile::default())];
    if let Some(path) = &job.save_coco {
        outputs.push(Box::new(CocoFile::new(path.clone())));
    }
    if let Some(path) = &job.save_mcap {
        outputs.push(Box::new(McapFile::new(path.clone())));
    }
    if job.settings.run.page {
        outputs.push(Box::new(Page::new()));
    }
    outputs
}
