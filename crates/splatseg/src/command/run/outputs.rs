//! What a run writes besides the images of its frames.

use super::Job;
use super::extra_file::ExtraFile;
use crate::command::Failure;
use splatseg_output::{CocoFile, McapFile, ObjectsFile, Page, RunOutput};

/// The outputs of a run, in the order in which they are shown frames: the list of objects, all masks and the recording
/// for viewers if there are files for them, and the page to look at. The page comes last, as it shows the others.
///
/// # Errors
/// If one of them cannot be written where it should be.
pub fn of(job: &Job, coco: Option<&ExtraFile>, mcap: Option<&ExtraFile>) -> Result<Vec<Box<dyn RunOutput>>, Failure> {
    let mut outputs: Vec<Box<dyn RunOutput>> = vec![Box::new(ObjectsFile::default())];
    if let Some(file) = coco {
        outputs.push(Box::new(CocoFile::create(file.path()).map_err(Failure::input)?));
    }
    if let Some(file) = mcap {
        outputs.push(Box::new(McapFile::create(file.path()).map_err(Failure::input)?));
    }
    if job.settings.run.page {
        outputs.push(Box::new(Page::new()));
    }
    Ok(outputs)
}
