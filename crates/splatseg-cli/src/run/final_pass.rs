//! The final pass: after the last frame, the map decides the ids of all frames again.
//!
//! It reads the recording once more, and needs no segmenter. The outputs are made anew from the frames with their final ids,
//! so that names, boxes, masks, recording and page agree with the images. All images are replaced together, once the last is
//! decided: until then, the results are those of the time. An id means the same object in both.

use super::RunJob;
use super::frame_history::{EarlierFrame, FrameHistory};
use super::frame_loop::{EarlyEnd, LoopOutcome};
use super::outputs;
use super::progress::Progress;
use super::result_writer::WriterOutcome;
use super::shown_frames;
use super::stop_signals::StopSignals;
use super::{name_objects, tell_changes, write_changes};
use crate::map_changes::MapBefore;
use crate::output_folder::result_files;
use rayon::current_num_threads;
use rayon::prelude::*;
use splatseg::Pipeline;
use splatseg::summary::needs_rgb;
use splatseg_dataset::{FrameStream, GroundTruth, Scene, StreamedFrame};
use splatseg_geometry::{FrameAnchor, SegmentId};
use splatseg_objects::{KeptViews, ObjectLog, RemapLog, SeenTimes, ViewedFrame};
use splatseg_odometry::PoseState;
use splatseg_output::{ChangesSince, FrameRecord, ObjectsFile, OutputError, ResultFolder, RunEnd, RunOutput};
use splatseg_places::FloorPlan;
use splatseg_tracking::{FrameOutput, Hindsight, TrackingError};
use std::collections::BTreeSet;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Most frames that are decided at the same time. They take memory.
const MOST_AT_ONCE: usize = 8;

/// A run whose frames are decided again.
pub struct FinalPass<'a> {
    /// The run.
    pub job: &'a RunJob,
    /// Its scene.
    pub scene: &'a Arc<dyn Scene>,
    /// Signals that stop the pass.
    pub signals: &'a StopSignals,
    /// The map that the run was started with.
    pub before: Option<&'a MapBefore>,
}

/// The frames decided so far.
struct Decided {
    outputs: Vec<Box<dyn RunOutput>>,
    objects: ObjectLog,
    seen: SeenTimes,
    ids: BTreeSet<SegmentId>,
    rgb_id_images: usize,
    /// Views of the objects with their final ids, if they are to be named.
    views: Option<KeptViews>,
}

impl FinalPass<'_> {
    /// Decides the frames of `history` again and writes their results, with the plan of the map. Returns false if the results
    /// stay as they are: after an error, which is among the output errors, or if a signal has stopped the pass.
    pub fn run(
        &self,
        pipeline: &mut Pipeline,
        (history, plan): (&FrameHistory, Option<FloorPlan>),
        ended: &mut LoopOutcome,
    ) -> bool {
        let LoopOutcome { counts, written, early } = ended;
        let Some(shown) = written.shown_path() else { return false };
        let mut decided = Decided {
            outputs: outputs::again(self.job),
            objects: ObjectLog::default(),
            seen: SeenTimes::default(),
            ids: BTreeSet::new(),
            rgb_id_images: 0,
            views: pipeline.has_namer().then(KeptViews::default),
        };
        written.folder.begin_replacing();
        let ended = self.decide_all(pipeline, (history, &shown), written, &mut decided);
        let replaced = ended.and_then(|stopped| match stopped {
            None => written.folder.replace_all().map(|()| None),
            stopped => Ok(stopped),
        });
        written.folder.keep_all();
        match replaced {
            Ok(None) => {}
            Ok(Some(stopped)) => {
                counts.interrupted = true;
                *early = Some(stopped);
                return false;
            }
            Err(error) => {
                written.output_errors.push(error);
                return false;
            }
        }
        pipeline.set_objects(decided.objects, decided.seen);
        if let Some(views) = decided.views {
            pipeline.set_views(views);
            if let Err(failure) = name_objects(pipeline) {
                say_error!("the objects have no names: {failure}");
            }
        }
        written.outputs = decided.outputs;
        // The final ids are what the map shows.
        let changes = self.before.and_then(|before| write_changes(before, pipeline, written));
        changes.iter().for_each(tell_changes);
        let since = self.before.zip(changes.as_ref());
        let since = since.map(|(before, changes)| ChangesSince { before: before.map(), changes });
        self.finish(pipeline, plan, written, since);
        for id in counts.ids.difference(&decided.ids) {
            let removed = written.folder.remove(&ObjectsFile::crop(*id));
            written.output_errors.extend(removed.err());
        }
        counts.ids = decided.ids;
        counts.rgb_id_images = decided.rgb_id_images;
        true
    }

    /// Returns what has stopped the pass, if anything has.
    fn decide_all(
        &self,
        pipeline: &mut Pipeline,
        (history, path): (&FrameHistory, &Path),
        written: &mut WriterOutcome,
        decided: &mut Decided,
    ) -> Result<Option<EarlyEnd>, OutputError> {
        let unreadable = |source| OutputError::Read { path: path.to_owned(), source };
        // Opened first, so that frames are read while the map settles.
        let stream = FrameStream::open(Arc::clone(self.scene), &self.job.settings.dataset, GroundTruth::Skip)?;
        pipeline.settle();
        let mut depth = pipeline.take_depth_again();
        let Some(hindsight) = pipeline.hindsight() else { return Ok(None) };
        let corrections = history.pose_corrections(&pipeline.keyframes());
        let mut lines = shown_frames::read(path).map_err(unreadable)?;
        let mut frames = history.written().iter().enumerate().peekable();
        let mut progress = Progress::again(history.written().len());
        let at_once = current_num_threads().clamp(1, MOST_AT_ONCE);
        let (mut waiting, mut before) = (Vec::new(), Vec::new());
        for streamed in stream {
            if let Some(signal) = self.signals.received() {
                progress.finish();
                return Ok(Some(EarlyEnd::Signal(signal)));
            }
            // A frame that could not be used then has no result.
            let Ok(StreamedFrame { index, frame, .. }) = streamed else { continue };
            let Some((position, _)) = frames.next_if(|(_, frame)| frame.index == index) else { continue };
            let line = lines.next().unwrap_or_else(|| Err(io::ErrorKind::UnexpectedEof.into()));
            let earlier = line.and_then(|line| history.earlier(position, (frame, &line), &corrections));
            let mut earlier = earlier.map_err(unreadable)?;
            if let Some(depth) = &mut depth {
                earlier.frame = depth.frame(earlier.frame).map_err(|error| unreadable(io::Error::other(error)))?;
            }
            waiting.push(earlier);
            if waiting.len() == at_once {
                before = step(&hindsight, std::mem::take(&mut waiting), before, written, decided)?;
            }
            progress.frame_done();
        }
        before = step(&hindsight, waiting, before, written, decided)?;
        step(&hindsight, Vec::new(), before, written, decided)?;
        progress.finish();
        match frames.next() {
            None => Ok(None),
            Some((_, frame)) => {
                let lost = format!("the frame {} cannot be read again: the final pass ended there", frame.file_name);
                Err(unreadable(io::Error::other(lost)))
            }
        }
    }

    /// Writes the outputs that need the whole run, in place of those of before.
    fn finish(
        &self,
        pipeline: &Pipeline,
        mut plan: Option<FloorPlan>,
        written: &mut WriterOutcome,
        changes: Option<ChangesSince<'_>>,
    ) {
        // Surfaces are where they were, but may show other objects.
        let objects = pipeline.objects_with_places(plan.as_mut());
        let end = RunEnd {
            scene: &self.job.scene.display().to_string(),
            objects: &objects,
            map: pipeline.map(),
            plan: plan.as_ref(),
            pose_corrections: &[],
            remaps: &RemapLog::default(),
            changes,
        };
        written.for_each_output(|output, folder| output.finish(&end, folder));
    }
}

/// Decides the frames of `next` while the results of `before` are written. Returns the former with their results.
fn step<'h>(
    hindsight: &dyn Hindsight,
    next: Vec<EarlierFrame<'h>>,
    before: Vec<(EarlierFrame<'h>, FrameOutput)>,
    written: &mut WriterOutcome,
    decided: &mut Decided,
) -> Result<Vec<(EarlierFrame<'h>, FrameOutput)>, OutputError> {
    let decide = |frame: EarlierFrame<'h>| {
        let output = frame.decided(hindsight);
        (frame, output)
    };
    let write_all = || before.into_iter().try_for_each(|(frame, output)| write(frame, output, written, decided));
    let (now, wrote) = rayon::join(|| next.into_par_iter().map(decide).collect::<Vec<_>>(), write_all);
    wrote?;
    let known = |(frame, output): (EarlierFrame<'h>, Result<FrameOutput, TrackingError>)| match output {
        Ok(output) => Ok((frame, output)),
        Err(source) => {
            Err(OutputError::Io { path: PathBuf::from(&frame.written.file_name), source: io::Error::other(source) })
        }
    };
    now.into_iter().map(known).collect()
}

/// Writes the results of a frame.
fn write(
    EarlierFrame { written: place, frame, .. }: EarlierFrame<'_>,
    output: FrameOutput,
    written: &mut WriterOutcome,
    decided: &mut Decided,
) -> Result<(), OutputError> {
    let objects = decided.objects.record(&output);
    if let Some(stamp) = frame.timestamp() {
        decided.seen.record(stamp.as_secs_f64(), &objects);
    }
    decided.ids.extend(objects.iter().map(|object| object.id));
    if let Some(views) = &mut decided.views {
        let known = (place.pose_state != PoseState::Lost).then(|| frame.world_from_camera());
        views.record(&ViewedFrame::new(&frame, &output.segments, known), &objects);
    }
    decided.rgb_id_images += usize::from(needs_rgb(&objects));
    let record = FrameRecord {
        number: place.number,
        index: place.index,
        file_name: place.file_name.clone(),
        pose_state: place.pose_state,
        frame,
        segments: output.segments,
        regions: None,
        objects,
        anchor: FrameAnchor::default(),
        remapped: Vec::new(),
    };
    let [segments, overlay] = result_files(&record.file_name);
    written.folder.write_segments(&segments, &record.segments)?;
    written.folder.write_overlay(&overlay, record.frame.color(), &record.segments)?;
    let WriterOutcome { folder, output_errors, .. } = written;
    decided.outputs.retain_mut(|output| match output.add_frame(&record, folder) {
        Ok(()) => true,
        Err(error) => {
            output_errors.push(error);
            false
        }
    });
    Ok(())
}
