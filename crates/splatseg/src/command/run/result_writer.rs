//! Results are written on a separate thread while the next frame is processed.

use super::output_folder::OutputFolder;
use splatseg_dataset::{OutputError, write_overlay_jpeg, write_segments_png};
use splatseg_geometry::{Image, SegmentMap};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

/// Largest number of frames waiting to be written; more would only take memory.
const WAITING: usize = 2;

/// The results of one frame.
pub struct FrameResult {
    /// Name of the frame.
    pub name: String,
    /// Its colour image.
    pub color: Image<[u8; 3]>,
    /// Its ids.
    pub segments: SegmentMap,
}

/// Writes frames in the given order.
pub struct ResultWriter {
    sender: Option<SyncSender<FrameResult>>,
    thread: Option<JoinHandle<Result<(), OutputError>>>,
}

impl ResultWriter {
    /// Starts the thread.
    pub fn start(folder: OutputFolder) -> Self {
        let (sender, receiver) = sync_channel(WAITING);
        let thread = std::thread::spawn(move || write_all(&folder, &receiver));
        Self { sender: Some(sender), thread: Some(thread) }
    }

    /// Queues a frame, and waits while the queue is full. An error is that of an earlier frame.
    pub fn write(&mut self, result: FrameResult) -> Result<(), OutputError> {
        match &self.sender {
            Some(sender) if sender.send(result).is_ok() => Ok(()),
            // The thread ends early only on an error.
            _ => self.finish(),
        }
    }

    /// Waits until everything is written.
    pub fn finish(&mut self) -> Result<(), OutputError> {
        self.sender = None;
        match self.thread.take().map(JoinHandle::join) {
            Some(Ok(result)) => result,
            Some(Err(panic)) => std::panic::resume_unwind(panic),
            None => Ok(()),
        }
    }
}

fn write_all(folder: &OutputFolder, receiver: &Receiver<FrameResult>) -> Result<(), OutputError> {
    for result in receiver {
        write_segments_png(&folder.segments(&result.name), &result.segments)?;
        write_overlay_jpeg(&folder.overlay(&result.name), &result.color, &result.segments)?;
    }
    Ok(())
}
