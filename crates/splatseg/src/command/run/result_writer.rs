//! Results are written on a separate thread while the next frame is processed.

use crate::command::output_folder::OutputFolder;
use splatseg_output::{FrameRecord, OutputError, ResultFolder, RunOutput};
use std::io::ErrorKind;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

/// Largest number of frames waiting to be written; more would only take memory.
const WAITING: usize = 2;

/// Writes frames in the given order.
pub struct ResultWriter {
    sender: SyncSender<FrameRecord>,
    thread: JoinHandle<Written>,
}

/// The folder after the last frame, and what could not be written.
pub struct Written {
    /// The folder.
    pub folder: OutputFolder,
    /// Frames with all their images.
    pub frames: usize,
    /// What else the run writes.
    pub outputs: Vec<Box<dyn RunOutput>>,
    /// The first error of an image.
    pub first_error: Option<OutputError>,
    /// The first error of each output that has failed.
    pub output_errors: Vec<OutputError>,
}

impl ResultWriter {
    /// Starts the thread.
    pub fn start(folder: OutputFolder, outputs: Vec<Box<dyn RunOutput>>) -> Self {
        let (sender, receiver) = sync_channel(WAITING);
        let written = Written { folder, frames: 0, outputs, first_error: None, output_errors: Vec::new() };
        let thread = std::thread::spawn(move || written.write_all(&receiver));
        Self { sender, thread }
    }

    /// Queues a frame, and waits while the queue is full. `false` means that no frame can be written any more.
    pub fn write(&self, frame: FrameRecord) -> bool {
        self.sender.send(frame).is_ok()
    }

    /// Waits until everything is written.
    pub fn finish(self) -> Written {
        drop(self.sender);
        self.thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    }
}

impl Written {
    /// Writes frames until there are no more. Goes on after an error that later frames need not have.
    fn write_all(mut self, receiver: &Receiver<FrameRecord>) -> Self {
        for frame in receiver {
            match self.folder.write_frame(&frame) {
                Ok(()) => {
                    self.frames += 1;
                    self.show_outputs(|output, folder| output.add_frame(&frame, folder));
                }
                Err(error) => {
                    let is_last = ends_all(&error);
                    self.first_error.get_or_insert(error);
                    if is_last {
                        break;
                    }
                }
            }
        }
        self
    }

    /// Shows something to every output. One that fails takes no further part.
    pub fn show_outputs(
        &mut self,
        mut show: impl FnMut(&mut dyn RunOutput, &mut dyn ResultFolder) -> Result<(), OutputError>,
    ) {
        let Self { outputs, folder, output_errors, .. } = self;
        outputs.retain_mut(|output| match show(output.as_mut(), folder) {
            Ok(()) => true,
            Err(error) => {
                output_errors.push(error);
                false
            }
        });
    }
}

/// Whether no later frame can be written either: the disk is full, or ids have run out.
fn ends_all(error: &OutputError) -> bool {
    match error {
        OutputError::Io { source, .. } => {
            matches!(source.kind(), ErrorKind::StorageFull | ErrorKind::QuotaExceeded | ErrorKind::ReadOnlyFilesystem)
        }
        OutputError::IdTooLarge { .. } => true,
        _ => false,
    }
}
