//! Results of a benchmark: the data behind every table and chart.

use crate::paper::Reference;
use serde::Serialize;
use splatseg_metrics::{DatasetScore, InstanceScorer, InstanceScores, Protocol, Scores, VideoScore};
use std::collections::BTreeMap;

/// A benchmark: the compared methods, the measurements and the missing results.
#[derive(Clone, Debug)]
pub struct Benchmark<'a> {
    /// Names of the scenes.
    pub scenes: Vec<String>,
    /// The methods and their variants, in the order of the tables; charts compare the others with the first.
    pub variants: Vec<Variant>,
    /// The seeds.
    pub seeds: Vec<u64>,
    /// The protocol of the main tables and of the charts.
    pub protocol: Protocol,
    /// Setup shared by all methods, for headings, e.g. `segmenter graph`.
    pub setup: String,
    /// The settings that all methods share, as text.
    pub settings: String,
    /// Version of the program that made the measurements.
    pub version: &'a str,
    /// The published rows shown beside the measured ones.
    pub reference: Reference,
    /// Names of the stages of all methods, in the order of the tables.
    pub stages: Vec<&'a str>,
    /// The measurements, sorted by scene, then by variant, then by seed.
    pub measurements: Vec<Measurement<'a>>,
    /// The missing results, with reasons.
    pub missing: Vec<MissingResult<'a>>,
}

/// A method with the settings in which it differs from the others.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Variant {
    /// Name of the method.
    pub method: String,
    /// The settings that differ, e.g. `memory.feature_dim=14`; empty for the unchanged method.
    pub changes: Vec<String>,
}

/// The result of one variant on one scene with one seed.
#[derive(Clone, Debug)]
pub struct Measurement<'a> {
    /// Index of the scene.
    pub scene: usize,
    /// Index of the variant.
    pub variant: usize,
    /// The seed.
    pub seed: u64,
    /// Name of the segmenter.
    pub segmenter: &'a str,
    /// Frames with a result.
    pub frames: usize,
    /// Frames that could not be read; they are not scored.
    pub skipped_frames: usize,
    /// Frames on which the segmenter failed; they are scored as empty.
    pub failed_frames: usize,
    /// Number of distinct ids in the results.
    pub segments: usize,
    /// Gaussians in the memory at the end.
    pub gaussians: usize,
    /// Numbers stored in the memory at the end.
    pub parameters: usize,
    /// Speed, without the time for scoring.
    pub frames_per_second: f64,
    /// Speed without the segmenter's time.
    pub frames_per_second_without_segmenter: f64,
    /// Mean time of each stage per frame, milliseconds.
    pub stage_ms: &'a BTreeMap<String, f64>,
    /// The processor or GPU of the measurement.
    pub machine: &'a str,
    /// Score under [`Protocol::Paper`].
    pub paper: &'a VideoScore,
    /// Score under [`Protocol::Strict`].
    pub strict: &'a VideoScore,
    /// Scores after the final pass, under [`Protocol::Paper`] and [`Protocol::Strict`]; `None` without it.
    pub final_pass: Option<[&'a VideoScore; 2]>,
    /// 3D instances on the vertices of the scene's mesh; `None` without a mesh or a memory.
    pub mesh: Option<&'a InstanceScorer>,
}

/// A result that could not be measured. Serialised to `failures.json`, so its keys are part of the interface.
#[derive(Clone, Debug, Serialize)]
pub struct MissingResult<'a> {
    /// Name of the scene.
    pub scene: &'a str,
    /// The scene as given on the command line.
    pub scene_path: &'a str,
    /// Name of the method.
    pub method: &'a str,
    /// The settings that differ from the other methods'.
    pub variant: Option<String>,
    /// The seed.
    pub seed: u64,
    /// The reason.
    pub error: &'a str,
}

impl Variant {
    /// The variant's name in tables.
    pub fn label(&self) -> String {
        self.change().map_or_else(|| self.method.clone(), |change| format!("{} {change}", self.method))
    }

    /// The settings that differ, as one text; `None` for the unchanged method.
    pub fn change(&self) -> Option<String> {
        (!self.changes.is_empty()).then(|| self.changes.join(" "))
    }
}

impl<'a> Benchmark<'a> {
    /// The benchmark with the scores after the final pass in place of those of the time; `None` if there was none. It has
    /// only the methods and scenes that have them.
    pub fn of_final_pass(&self) -> Option<Self> {
        let mut measurements: Vec<Measurement<'a>> = Vec::new();
        for measurement in &self.measurements {
            if let Some([paper, strict]) = measurement.final_pass {
                measurements.push(Measurement { paper, strict, mesh: None, ..measurement.clone() });
            }
        }
        let kept: Vec<usize> = (0..self.variants.len())
            .filter(|variant| measurements.iter().any(|measurement| measurement.variant == *variant))
            .collect();
        for measurement in &mut measurements {
            measurement.variant = kept.iter().position(|variant| *variant == measurement.variant)?;
        }
        let variants: Vec<Variant> = kept.iter().map(|variant| self.variants[*variant].clone()).collect();
        (!measurements.is_empty()).then(|| Self { variants, measurements, missing: Vec::new(), ..self.clone() })
    }
}

impl Measurement<'_> {
    /// The score under a protocol.
    pub fn score(&self, protocol: Protocol) -> &VideoScore {
        match protocol {
            Protocol::Paper => self.paper,
            Protocol::Strict => self.strict,
        }
    }
}

impl<'a> Benchmark<'a> {
    /// The protocol not used by the main tables.
    pub(crate) fn other_protocol(&self) -> Protocol {
        match self.protocol {
            Protocol::Paper => Protocol::Strict,
            Protocol::Strict => Protocol::Paper,
        }
    }

    /// Measurements of one variant, on all scenes.
    pub(crate) fn of_variant(&self, variant: usize) -> Vec<&Measurement<'a>> {
        self.measurements.iter().filter(|measurement| measurement.variant == variant).collect()
    }

    /// Measurements on one scene, by variant and seed.
    pub(crate) fn of_scene(&self, scene: usize) -> &[Measurement<'a>] {
        let start = self.measurements.partition_point(|measurement| measurement.scene < scene);
        let count = self.measurements[start..].partition_point(|measurement| measurement.scene == scene);
        &self.measurements[start..start + count]
    }

    /// Measurements of one variant on one scene, by seed.
    pub(crate) fn of(&self, scene: usize, variant: usize) -> &[Measurement<'a>] {
        let of_scene = self.of_scene(scene);
        let start = of_scene.partition_point(|measurement| measurement.variant < variant);
        let count = of_scene[start..].partition_point(|measurement| measurement.variant == variant);
        &of_scene[start..start + count]
    }

    /// The machines of the measurements, without duplicates.
    pub(crate) fn machines(&self) -> Vec<&'a str> {
        let mut machines: Vec<&str> = Vec::new();
        for measurement in &self.measurements {
            if !machines.contains(&measurement.machine) {
                machines.push(measurement.machine);
            }
        }
        machines
    }

    /// The 3D scores over the scenes of these measurements, one per seed that has any.
    pub(crate) fn mesh_totals_by_seed(&self, measurements: &[&Measurement]) -> Vec<InstanceScores> {
        let mut totals = Vec::new();
        for seed in &self.seeds {
            let mut total: Option<InstanceScorer> = None;
            for measurement in measurements.iter().filter(|measurement| measurement.seed == *seed) {
                if let Some(scorer) = measurement.mesh {
                    total.get_or_insert_default().merge(scorer);
                }
            }
            totals.extend(total.map(|total| total.scores()));
        }
        totals
    }

    /// The frames per second over the scenes of these measurements, one per seed: frames and times are summed before
    /// dividing. Scenes without frames have no speed.
    pub(crate) fn speeds_by_seed(&self, measurements: &[&Measurement]) -> Vec<f64> {
        let of_seed = |seed: &u64| {
            let (mut frames, mut seconds) = (0.0, 0.0);
            let timed = |measurement: &&&Measurement| measurement.seed == *seed && measurement.frames_per_second > 0.0;
            for measurement in measurements.iter().filter(timed) {
                frames += measurement.frames as f64;
                seconds += measurement.frames as f64 / measurement.frames_per_second;
            }
            (seconds > 0.0).then(|| frames / seconds)
        };
        self.seeds.iter().filter_map(of_seed).collect()
    }

    /// The scores over the scenes of these measurements, one per seed: counts are summed before dividing.
    pub(crate) fn totals_by_seed(&self, measurements: &[&Measurement], protocol: Protocol) -> Vec<Scores> {
        let mut totals = Vec::new();
        for seed in &self.seeds {
            let mut of_seed = measurements.iter().filter(|measurement| measurement.seed == *seed).peekable();
            let Some(first) = of_seed.peek() else { continue };
            let mut total = DatasetScore::new(*first.score(protocol).settings());
            for measurement in of_seed {
                // All results of a benchmark are scored with the same settings, so `add` never fails.
                let _ = total.add(measurement.score(protocol));
            }
            totals.push(total.total());
        }
        totals
    }
}

/// Describes missing results and failed frames of a row that should have `expected` measurements.
pub(crate) fn missing_note(measurements: &[&Measurement], expected: usize) -> Option<String> {
    let skipped: usize = measurements.iter().map(|measurement| measurement.skipped_frames).sum();
    let failed: usize = measurements.iter().map(|measurement| measurement.failed_frames).sum();
    let mut notes = Vec::new();
    if measurements.len() < expected {
        notes.push(format!("{} of {expected} results", measurements.len()));
    }
    if skipped > 0 {
        notes.push(format!("{skipped} frames could not be read"));
    }
    if failed > 0 {
        notes.push(format!("the segmenter failed on {failed} frames"));
    }
    (!notes.is_empty()).then(|| notes.join("; "))
}

impl MissingResult<'_> {
    /// Names the result and the reason.
    pub(crate) fn text(&self) -> String {
        let variant = self.variant.as_ref().map(|variant| format!(" {variant}")).unwrap_or_default();
        format!("{}, {}{variant}, seed {}: {}", self.scene, self.method, self.seed, self.error)
    }
}
