//! What a run writes besides the images of its frames.

use super::Job;
use crate::command::Failure;
use splatseg_output::RunOutput;

/// The outputs that a job asks for, in the order in which they are shown frames.
///
/// # Errors
/// If one of them cannot be written where it should be.
pub fn of(_job: &Job) -> Result<Vec<Box<dyn RunOutput>>, Failure> {
    Ok(Vec::new())
}
