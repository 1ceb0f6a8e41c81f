//! What a run writes besides the images of its frames.

use super::Job;
use crate::command::Failure;
use splatseg_output::{Page, RunOutput};

/// The outputs that a job asks for, in the order in which they are shown frames.
///
/// # Errors
/// If one of them cannot be written where it should be.
pub fn of(job: &Job) -> Result<Vec<Box<dyn RunOutput>>, Failure> {
    let mut outputs: Vec<Box<dyn RunOutput>> = Vec::new();
    if job.settings.run.page {
        outputs.push(Box::new(Page::new()));
    }
    Ok(outputs)
}
