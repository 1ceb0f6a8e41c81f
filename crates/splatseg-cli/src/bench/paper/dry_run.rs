//! `--dry-run`: lists every row of the paper's tables with its inputs, the missing ones, and the estimated time.

use super::rows::PlannedRow;
use super::{DataSet, PaperBenchmark};
use crate::Failure;
use crate::bench::arguments::BenchArguments;
use crate::bench::plan::{BenchJob, Plan};
use crate::bench::store::stored_speed;
use crate::bench::{job, machine};
use crate::terminal::counted;
use splatseg::settings::MethodName;
use splatseg_dataset::{DatasetSettings, open_scene};
use splatseg_models::checkpoint::Architecture;
use splatseg_report::paper::PaperTable;
use std::path::Path;

/// The machine on which the times of [`reference_seconds`] were measured.
const REFERENCE_MACHINE: &str = "two cores of an AMD EPYC (Zen 3), networks on the CPU";
/// Number of frames of ScanNet's validation split as the benchmark reads it: every 20th frame of 312 scans of 1652 frames
/// (2.5 million frames in 1513 scans, according to its paper).
const SCANNET_MV_FRAMES: usize = 25_800;
/// Minimum number of frames of MVPd's test split: 1741 accepted videos of at least 100 frames.
const MVPD_FRAMES: usize = 174_100;

/// Returns a method's time per frame with the paper's networks, seconds, for use where no better estimate is known.
/// Measured by `tools/compare_onnxruntime.py` and `tools/compare_sam2.py`. FastSAM-x: 1.8 s at 640x640, times 1.92 for the
/// pixels of 1024x768. SAM 2.1 base_plus: 39 s with 20 objects; each further object adds 1.6 to 2.5 s. EdgeTAM: 8 s
/// with 20 objects, EfficientTAM-S: 30 s. The feature memory: 0.1 s.
fn reference_seconds(method: MethodName, has_detections: bool, tracker: Option<&Architecture>) -> f64 {
    let tracked = match tracker {
        None => 39.0,
        Some(Architecture::EdgeTam { .. }) => 8.0,
        Some(_) => 30.0,
    };
    let detections = if has_detections { 3.5 } else { 0.0 };
    match method {
        MethodName::Fastsam | MethodName::Fastspam => detections,
        MethodName::FastsamSplat => detections + 0.1,
        MethodName::Sam2 => detections + tracked,
        _ => detections + tracked + 0.1,
    }
}

/// Estimated time of a row.
struct Estimate {
    seconds: f64,
    /// Source of the time per frame.
    source: Source,
}

/// Source of the time per frame, best first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Source {
    /// Nothing is left to measure.
    Done,
    /// Existing results of the same row.
    Results,
    /// A measurement on the first frames of the first scene.
    Sample,
    /// Measurements on another machine.
    Reference,
}

impl Source {
    fn text(self) -> &'static str {
        match self {
            Self::Done => "nothing left to measure",
            Self::Results => "from existing results",
            Self::Sample => "from the sample",
            Self::Reference => "rough",
        }
    }
}

/// A data set's plan, and the number of frames of each of its scenes.
struct PlannedData {
    plan: Plan,
    frames: Vec<usize>,
}

impl PaperBenchmark {
    /// Prints the rows that a run would measure. Runs only the sample of `--sample-frames`.
    ///
    /// # Errors
    /// If a setting is wrong.
    pub fn dry_run(&self, arguments: &BenchArguments) -> Result<(), Failure> {
        let data = DataSet::ALL.map(|data| self.planned(data, arguments));
        let [scannet, mvpd] = data;
        let (scannet, mvpd) = (scannet?, mvpd?);
        say!("A dry run of the paper's tables: nothing is written.\n");
        self.inputs.notes.iter().for_each(|note| say!("{note}"));
        say!("{}", self.missing_list());
        let (mut total, mut unknown) = (0.0, 0);
        for table in PaperTable::ALL {
            let data = if table.is_of_mvpd() { &mvpd } else { &scannet };
            let frames: usize = data.as_ref().map_or(0, |data| data.frames.iter().sum());
            match data {
                Some(data) => {
                    say!("{}: {}, {}", table.title(), counted(data.frames.len(), "video"), counted(frames, "frame"))
                }
                None => say!("{}", table.title()),
            }
            for (row, _) in self.rows.iter().filter(|(row, _)| row.table == table) {
                let (line, seconds) = self.line(row, data.as_ref(), arguments)?;
                say!("{line}");
                match seconds {
                    Some(seconds) => total += seconds,
                    None => unknown += 1,
                }
            }
            say!("");
        }
        let efficiency =
            "Efficiency: the runs on ScanNet-MV also measure the frames per second and the memory's parameters";
        say!("{efficiency}");
        say!("of FastSAM, FastSPAM, SAM2, FastSAM-Splat and SAM2-Splat; the other systems' rows are the paper's.\n");
        let (time, machine) = (duration(total), machine::name(&self.settings()?));
        say!("The rows that can be measured take {time} in all, one result at a time, on this machine: {machine}.");
        if unknown > 0 {
            say!("{unknown} of the rows cannot be measured yet; their times are for the published data sets.");
        }
        say!(
            "Rough times are for {REFERENCE_MACHINE}, with FastSAM-x, SAM 2.1 base_plus (or the row's own tracker) and \
             20 objects in view: another machine, a GPU or other checkpoints can be many times faster or slower."
        );
        Ok(())
    }

    fn settings(&self) -> Result<splatseg::Settings, Failure> {
        self.scannet.layers.resolve_shared().map_err(Failure::input)
    }

    fn planned(&self, data: DataSet, arguments: &BenchArguments) -> Result<Option<PlannedData>, Failure> {
        let Some(plan) = self.plan(data, arguments)? else { return Ok(None) };
        let dataset = &plan.settings.dataset;
        let frames = match data {
            DataSet::ScannetMv => plan.scenes.iter().map(|scene| frames_of_scene(&scene.path, dataset)).collect(),
            DataSet::Mvpd => self.inputs.mvpd.videos.iter().map(|video| selected(video.frames, dataset)).collect(),
        };
        Ok(Some(PlannedData { plan, frames }))
    }

    /// Returns the line of a row, and its time in seconds: 0 for a row that is not ours, `None` for a row that cannot be
    /// measured.
    fn line(
        &self,
        row: &PlannedRow,
        data: Option<&PlannedData>,
        arguments: &BenchArguments,
    ) -> Result<(String, Option<f64>), Failure> {
        let name = format!("  {:<27} ", row.name);
        let Some(variant) = &row.variant else {
            let text = "the paper's row; score predictions with `splatseg eval`";
            return Ok((format!("{name}{text}"), Some(0.0)));
        };
        let needs = row.needs();
        let lacks: Vec<&str> = needs.iter().filter(|input| self.lacks(**input)).map(|input| input.name()).collect();
        let needed: Vec<&str> = needs.iter().map(|input| input.name()).collect();
        let needed = format!("needs {}", needed.join(", "));
        let index = data.and_then(|data| Some((data, data.plan.variants.iter().position(|other| other == variant)?)));
        let Some((data, index)) = index.filter(|_| lacks.is_empty()) else {
            let frames = if row.table.is_of_mvpd() { MVPD_FRAMES } else { SCANNET_MV_FRAMES };
            let tracker = row.tracker.as_ref().map(|tracker| &tracker.network);
            let has_detections = needs.contains(&super::Input::FastSam);
            let time = reference_seconds(variant.method, has_detections, tracker) * frames as f64;
            let time = format!("{} for the whole data set ({})", duration(time), Source::Reference.text());
            return Ok((format!("{name}{needed}; missing: {}; {time}", lacks.join(", ")), None));
        };
        let done = data.estimate(row, index, &arguments.out.join(DataSet::of(row.table).folder()), arguments)?;
        let shared = data.plan.entries.iter().filter(|entry| entry.variant == index);
        let is_shared = shared.clone().all(|entry| data.plan.jobs[entry.job].variant != index);
        let seconds = if is_shared { 0.0 } else { done.seconds };
        let time = match is_shared {
            true => "the same runs as a row above".to_owned(),
            false => format!("{} ({})", duration(done.seconds), done.source.text()),
        };
        Ok((format!("{name}{needed}; nothing missing; {time}"), Some(seconds)))
    }

    fn lacks(&self, input: super::Input) -> bool {
        self.inputs.missing.iter().any(|missing| missing.input == input)
    }
}

impl PlannedData {
    /// Estimates the remaining time of a variant, for the results that are not in its folder.
    fn estimate(
        &self,
        row: &PlannedRow,
        variant: usize,
        folder: &Path,
        arguments: &BenchArguments,
    ) -> Result<Estimate, Failure> {
        let entries = self.plan.entries.iter().filter(|entry| entry.variant == variant);
        let (mut left, mut speeds) = (0, Vec::new());
        let mut first: Option<&BenchJob> = None;
        for entry in entries {
            let job = &self.plan.jobs[entry.job];
            let (key, _) = self.plan.inputs(job)?;
            match stored_speed(folder, &key).filter(|speed| *speed > 0.0) {
                Some(speed) if !arguments.overwrite => speeds.push(speed),
                _ => {
                    left += self.frames[job.scene];
                    first.get_or_insert(job);
                }
            }
        }
        let Some(job) = first else { return Ok(Estimate { seconds: 0.0, source: Source::Done }) };
        let of_frame = |seconds: f64, source| Estimate { seconds: seconds * left as f64, source };
        if !speeds.is_empty() {
            let seconds = speeds.iter().map(|speed| 1.0 / speed).sum::<f64>() / speeds.len() as f64;
            return Ok(of_frame(seconds, Source::Results));
        }
        if let Some(frames) = arguments.sample_frames {
            let speed = self.sample(job, usize::try_from(frames).unwrap_or(1))?;
            return Ok(of_frame(1.0 / speed, Source::Sample));
        }
        let settings = &self.plan.variant_settings(variant);
        let tracker = row.tracker.as_ref().map(|tracker| &tracker.network);
        let seconds = reference_seconds(settings.method.name(), settings.method.uses_segmenter(), tracker);
        Ok(of_frame(seconds, Source::Reference))
    }

    /// Measures the speed on the first frames of a job's scene, frames per second.
    fn sample(&self, job: &BenchJob, frames: usize) -> Result<f64, Failure> {
        let (_, mut inputs) = self.plan.inputs(job)?;
        inputs.mesh = None;
        let dataset = &mut inputs.settings.dataset;
        dataset.max_frames = Some(dataset.max_frames.map_or(frames, |most| most.min(frames)));
        let scene = &self.plan.scenes[job.scene].path;
        job::run(scene, &inputs).map(|result| result.fps.total.max(f64::MIN_POSITIVE)).map_err(Failure::runtime)
    }
}

/// Returns the number of frames to read of a scene, or 0 if it cannot be opened.
fn frames_of_scene(path: &Path, settings: &DatasetSettings) -> usize {
    open_scene(path, settings).map_or(0, |scene| selected(scene.frame_count(), settings))
}

/// Returns the number of frames to read of a scene with `frames` frames.
fn selected(frames: usize, settings: &DatasetSettings) -> usize {
    settings.selected_frames(frames).map_or(0, |selected| selected.len())
}

/// Formats a time: `3 min`, `5.2 h`, `12 days`.
fn duration(seconds: f64) -> String {
    match seconds {
        seconds if seconds < 90.0 => format!("{seconds:.0} s"),
        seconds if seconds < 90.0 * 60.0 => format!("{:.0} min", seconds / 60.0),
        seconds if seconds < 48.0 * 3600.0 => format!("{:.1} h", seconds / 3600.0),
        seconds => format!("{:.0} days", seconds / 86_400.0),
    }
}

#[cfg(test)]
mod tests {
    use super::super::rows::by_name;
    use super::*;

    #[test]
    fn times_have_suitable_units() {
        let texts = [0.0, 89.0, 300.0, 7200.0, 3.0 * 86_400.0].map(duration);
        assert_eq!(texts, ["0 s", "89 s", "5 min", "2.0 h", "3 days"]);
    }

    #[test]
    fn the_slowest_rows_are_those_of_sam2() {
        let seconds = |name: &str, detections| reference_seconds(by_name(name).unwrap().0, detections, None);
        assert!(seconds("FastSAM", true) < seconds("FastSAM-Splat", true));
        assert!(seconds("FastSAM-Splat", true) < seconds("SAM2, ground truth", false));
        assert!(seconds("SAM2, detections", true) < seconds("SAM2-Splat, detections", true));
    }
}
