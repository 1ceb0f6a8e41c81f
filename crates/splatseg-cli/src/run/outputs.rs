//! The outputs of a run besides the images of its frames.

use super::RunJob;
use splatseg_output::{CocoFile, McapFile, ObjectsFile, Page, PosesFile, RunOutput};

/// Returns the outputs of a run, in the order in which they process frames: the list of objects, the camera's poses,
/// the masks and the recording (if requested), and the page. The page is last, as it shows the others.
pub fn of(job: &RunJob) -> Vec<Box<dyn RunOutput>> {
    with_page(job, Page::new())
}

/// As [`of`], for the same frames once more.
pub fn again(job: &RunJob) -> Vec<Box<dyn RunOutput>> {
    with_page(job, Page::again())
}

fn with_page(job: &RunJob, page: Page) -> Vec<Box<dyn RunOutput>> {
    let mut outputs: Vec<Box<dyn RunOutput>> = vec![Box::new(ObjectsFile::default()), Box::new(PosesFile::default())];
    if let Some(path) = &job.save_coco {
        outputs.push(Box::new(CocoFile::new(path.clone())));
    }
    if let Some(path) = &job.save_mcap {
        outputs.push(Box::new(McapFile::new(path.clone())));
    }
    if job.settings.run.page {
        outputs.push(Box::new(page));
    }
    outputs
}
