//! Results are written on a separate thread while the next frame is processed.

use super::saved_run::{FOLDER, RunState, StateWriter};
use crate::command::output_folder::OutputFolder;
use splatseg_output::{FrameRecord, OutputError, ResultFolder, RunOutput};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

/// Largest number of frames waiting to be written; more would only take memory.
const WAITING: usize = 2;

/// What is written.
enum Item {
    /// The images of a frame.
    Frame(Box<FrameRecord>),
    /// How far the run is, and a file with the memory.
    State(Box<RunState>, PathBuf),
}

/// Writes frames in the given order.
pub struct ResultWriter {
    sender: SyncSender<Item>,
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
    /// Saves how far the run is, if that is asked for.
    pub saving: Saving,
}

/// Whether the run can be continued later.
#[derive(Debug)]
pub enum Saving {
    /// `save_every` is 0.
    Off,
    /// It can be as soon as its first frame is written.
    Later,
    /// It is saved from time to time.
    On(StateWriter),
    /// It could not be saved any more.
    Failed,
}

impl ResultWriter {
    /// Starts the thread.
    pub fn start(written: Written) -> Self {
        let (sender, receiver) = sync_channel(WAITING);
        let thread = std::thread::spawn(move || written.write_all(&receiver));
        Self { sender, thread }
    }

    /// Queues a frame, and waits while the queue is full. `false` means that no frame can be written any more.
    pub fn write(&self, frame: FrameRecord) -> bool {
        self.sender.send(Item::Frame(Box::new(frame))).is_ok()
    }

    /// Queues how far the run is after the frames before, with a file that holds the memory.
    pub fn save_state(&self, state: RunState, memory: PathBuf) {
        // A writer that has ended says why.
        let _ = self.sender.send(Item::State(Box::new(state), memory));
    }

    /// Waits until everything is written.
    pub fn finish(self) -> Written {
        drop(self.sender);
        self.thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    }
}

impl Written {
    /// Nothing yet.
    pub fn nothing(folder: OutputFolder, outputs: Vec<Box<dyn RunOutput>>, saving: Saving) -> Self {
        Self { folder, frames: 0, outputs, first_error: None, output_errors: Vec::new(), saving }
    }

    /// Writes frames until there are no more. Goes on after an error that later frames need not have.
    fn write_all(mut self, receiver: &Receiver<Item>) -> Self {
        for item in receiver {
            let frame = match item {
                Item::Frame(frame) => frame,
                Item::State(state, memory) => {
                    self.save_state(&state, &memory);
                    continue;
                }
            };
            match self.folder.write_frame(&frame) {
                Ok(()) => {
                    self.frames += 1;
                    self.show_outputs(|output, folder| output.add_frame(&frame, folder));
                    self.save_frame(&frame);
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

    /// Saves that a frame has its images, and what outputs have kept of it.
    fn save_frame(&mut self, frame: &FrameRecord) {
        if matches!(self.saving, Saving::Later) {
            let started = StateWriter::start(self.folder.path(), None);
            self.saving = self.saved(started).map_or(Saving::Failed, Saving::On);
        }
        if !matches!(self.saving, Saving::On(_)) {
            return;
        }
        let mut kept = Vec::new();
        self.show_outputs(|output, _| output.frame_state(frame).map(|line| kept.push((output.name(), line))));
        if let Saving::On(writer) = &mut self.saving {
            let added = writer.add_frame(frame, kept);
            self.saved(added);
        }
    }

    /// Saves how far the run is, unless a frame before has lost its images.
    fn save_state(&mut self, state: &RunState, memory: &Path) {
        if self.first_error.is_some() || !matches!(self.saving, Saving::On(_)) {
            return;
        }
        let mut kept = Vec::new();
        self.show_outputs(|output, folder| output.save(folder).map(|state| kept.push((output.name(), state))));
        if let Saving::On(writer) = &mut self.saving {
            let saved = writer.save(state, memory, &kept);
            self.saved(saved);
        }
    }

    /// Notes an error of saving, after which nothing more is saved.
    fn saved<T>(&mut self, result: std::io::Result<T>) -> Option<T> {
        result
            .inspect_err(|_| self.saving = Saving::Failed)
            .map_err(|source| {
                self.output_errors.push(OutputError::Io { path: self.folder.path().join(FOLDER), source })
            })
            .ok()
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

/// Whether no later frame can be written either, as the disk is full.
fn ends_all(error: &OutputError) -> bool {
    match error {
        OutputError::Io { source, .. } => {
            matches!(source.kind(), ErrorKind::StorageFull | ErrorKind::QuotaExceeded | ErrorKind::ReadOnlyFilesystem)
        }
        _ => false,
    }
}
