//! Writes results on a separate thread while the next frame is processed.

use super::frame_history::FrameHistory;
use super::saved_run::{BegunRun, FOLDER, RunState, StateWriter};
use super::shown_frames::{self, SHOWN, ShownFile};
use crate::output_folder::OutputFolder;
use splatseg_geometry::RemappedId;
use splatseg_output::{FrameRecord, OutputError, ResultFolder, RunOutput};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

/// Maximum number of frames in the queue. A longer queue would only take memory.
const WAITING: usize = 2;

/// An item of the writer's queue.
enum Item {
    /// A frame whose images are to be written.
    Frame(Box<FrameRecord>),
    /// The state of the run, a file with the memory, and the state of the source of poses.
    State(Box<RunState>, PathBuf, Option<Vec<u8>>),
}

/// Writes frames in the order they are queued.
pub struct ResultWriter {
    sender: SyncSender<Item>,
    thread: JoinHandle<WriterOutcome>,
}

/// The results written so far, and the errors.
pub struct WriterOutcome {
    /// The folder.
    pub folder: OutputFolder,
    /// Number of frames with all their images.
    pub frames: usize,
    /// The frames with all their images.
    pub history: FrameHistory,
    /// Ids that turned out to be the same object before a frame without images.
    unreported: Vec<RemappedId>,
    /// The outputs besides the images.
    pub outputs: Vec<Box<dyn RunOutput>>,
    /// The first error writing an image.
    pub first_error: Option<OutputError>,
    /// The error of each output that failed, and of saving the state.
    pub output_errors: Vec<OutputError>,
    /// Saving of the run's state.
    pub saving: Saving,
    /// Where it is kept what frames show, for the final pass.
    pub shown: Shown,
}

/// Where it is kept what the frames of a run show.
#[derive(Debug)]
pub enum Shown {
    /// Nowhere: there is no final pass.
    Nowhere,
    /// With the state of the run.
    WithState,
    /// In a file of its own.
    File(ShownFile),
}

/// Status of saving the run's state, from which it can be resumed.
#[derive(Debug)]
pub enum Saving {
    /// Disabled: `save_every` is 0.
    Off,
    /// Starts when the first frame is written.
    Later(BegunRun),
    /// The state is saved periodically.
    On(StateWriter),
    /// Stopped after an error.
    Failed,
}

impl ResultWriter {
    /// Starts the thread.
    ///
    /// # Errors
    /// If the system has no more threads. Nothing was written then.
    pub fn start(written: WriterOutcome) -> std::io::Result<Self> {
        let (sender, receiver) = sync_channel(WAITING);
        let work = move || written.write_all(&receiver);
        let thread = std::thread::Builder::new().name("result writer".to_owned()).spawn(work)?;
        Ok(Self { sender, thread })
    }

    /// Queues a frame, and waits while the queue is full. Returns false if no more frames can be written.
    pub fn write(&self, frame: FrameRecord) -> bool {
        self.sender.send(Item::Frame(Box::new(frame))).is_ok()
    }

    /// Queues the state of the run after the frames queued so far, with a file that contains the memory, and the state of
    /// the source of poses.
    pub fn save_state(&self, state: RunState, memory: PathBuf, poses: Option<Vec<u8>>) {
        // If the writer has ended, it reports the reason itself.
        let _ = self.sender.send(Item::State(Box::new(state), memory, poses));
    }

    /// Waits until everything is written.
    pub fn finish(self) -> WriterOutcome {
        drop(self.sender);
        self.thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    }
}

impl WriterOutcome {
    /// Starts with no frames.
    pub fn new(folder: OutputFolder, outputs: Vec<Box<dyn RunOutput>>, saving: Saving, shown: Shown) -> Self {
        let (history, unreported) = (FrameHistory::default(), Vec::new());
        let (first_error, output_errors) = (None, Vec::new());
        Self { folder, frames: 0, history, unreported, outputs, first_error, output_errors, saving, shown }
    }

    /// Writes frames until there are no more. Continues after errors that need not affect later frames.
    fn write_all(mut self, receiver: &Receiver<Item>) -> Self {
        for item in receiver {
            let mut frame = match item {
                Item::Frame(frame) => frame,
                Item::State(state, memory, poses) => {
                    self.save_state(&state, &memory, poses);
                    continue;
                }
            };
            self.unreported.append(&mut frame.remapped);
            match self.folder.write_frame(&frame) {
                Ok(()) => {
                    frame.remapped = std::mem::take(&mut self.unreported);
                    self.frames += 1;
                    self.history.add(&frame);
                    self.for_each_output(|output, folder| output.add_frame(&frame, folder));
                    self.keep_shown(&frame);
                    self.save_frame(&frame);
                }
                Err(error) => {
                    let is_last = is_permanent(&error);
                    self.first_error.get_or_insert(error);
                    if is_last {
                        break;
                    }
                }
            }
        }
        self
    }

    /// The file with what the frames show, if there is to be a final pass.
    pub fn shown_path(&self) -> Option<PathBuf> {
        match &self.shown {
            Shown::Nowhere => None,
            Shown::WithState => Some(self.folder.path().join(FOLDER).join(format!("{SHOWN}.jsonl"))),
            Shown::File(file) => Some(file.path().to_owned()),
        }
    }

    /// Keeps what a frame shows in a file of its own, if that is where.
    fn keep_shown(&mut self, frame: &FrameRecord) {
        let Shown::File(file) = &mut self.shown else { return };
        let kept = shown_frames::line(&frame.segments, frame.regions.as_ref()).and_then(|line| file.add(line));
        if let Err(source) = kept {
            self.output_errors.push(OutputError::Io { path: file.path().to_owned(), source });
            self.shown = Shown::Nowhere;
        }
    }

    /// Records that a frame's images are written, with each output's state for the frame.
    fn save_frame(&mut self, frame: &FrameRecord) {
        if let Saving::Later(begun) = &self.saving {
            let started = StateWriter::start(self.folder.path(), begun);
            self.saving = self.saved(started).map_or(Saving::Failed, Saving::On);
        }
        if !matches!(self.saving, Saving::On(_)) {
            return;
        }
        let mut kept = Vec::new();
        self.for_each_output(|output, _| output.frame_state(frame).map(|line| kept.push((output.name(), line))));
        if let Shown::WithState = self.shown {
            let line = shown_frames::line(&frame.segments, frame.regions.as_ref());
            kept.extend(self.saved(line).map(|line| (SHOWN, line)));
        }
        if let Saving::On(writer) = &mut self.saving {
            let added = writer.add_frame(frame, kept);
            self.saved(added);
        }
    }

    /// Saves the state of the run, unless the images of an earlier frame were lost.
    fn save_state(&mut self, state: &RunState, memory: &Path, poses: Option<Vec<u8>>) {
        if self.first_error.is_some() || !matches!(self.saving, Saving::On(_)) {
            return;
        }
        let mut kept = Vec::new();
        self.for_each_output(|output, folder| output.save(folder).map(|state| kept.push((output.name(), state))));
        if let Saving::On(writer) = &mut self.saving {
            let saved = writer.save(state, memory, poses.as_deref(), &kept);
            self.saved(saved);
        }
    }

    /// Records an error saving the state, and stops saving.
    fn saved<T>(&mut self, result: std::io::Result<T>) -> Option<T> {
        result
            .inspect_err(|_| {
                self.saving = Saving::Failed;
                if matches!(self.shown, Shown::WithState) {
                    self.shown = Shown::Nowhere;
                }
            })
            .map_err(|source| {
                self.output_errors.push(OutputError::Io { path: self.folder.path().join(FOLDER), source })
            })
            .ok()
    }

    /// Calls a function for every output. Outputs that fail are dropped.
    pub fn for_each_output(
        &mut self,
        mut call: impl FnMut(&mut dyn RunOutput, &mut dyn ResultFolder) -> Result<(), OutputError>,
    ) {
        let Self { outputs, folder, output_errors, .. } = self;
        outputs.retain_mut(|output| match call(output.as_mut(), folder) {
            Ok(()) => true,
            Err(error) => {
                output_errors.push(error);
                false
            }
        });
    }
}

/// Returns true if later frames cannot be written either, e.g. because the disk is full.
fn is_permanent(error: &OutputError) -> bool {
    match error {
        OutputError::Io { source, .. } => {
            matches!(source.kind(), ErrorKind::StorageFull | ErrorKind::QuotaExceeded | ErrorKind::ReadOnlyFilesystem)
        }
        _ => false,
    }
}
