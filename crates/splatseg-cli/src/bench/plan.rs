//! The plan of a benchmark: scenes, variants, seeds and jobs.

use super::arguments::BenchArguments;
use super::job::JobInputs;
use super::mesh_files::{MeshFiles, MeshOptions};
use super::store::job_key;
use crate::Failure;
use splatseg::Settings;
use splatseg::settings::{MethodName, SettingsError, SettingsLayers};
use splatseg_dataset::{DatasetSettings, open_scene};
use splatseg_files::MemoryLimit;
use splatseg_metrics::{Protocol, ScoreSettings};
use splatseg_report::paper::Reference;
use splatseg_settings::Allowed;
use std::collections::HashMap;
use std::path::PathBuf;

/// Maximum number of results of a benchmark. The report needs the scores of all of them in memory, 4 kB each.
const MAX_RESULTS: usize = 50_000;

/// A scene of a benchmark.
#[derive(Clone, Debug)]
pub struct SceneEntry {
    /// Path of the scene.
    pub path: PathBuf,
    /// Path as text.
    pub path_text: String,
    /// Unique name in tables.
    pub name: String,
    /// Error message if the scene cannot be opened.
    pub error: Option<String>,
    /// Mesh with true instances, if there is one.
    pub mesh: Option<MeshFiles>,
}

/// The parts of a plan that are not settings of the methods.
#[derive(Clone, Debug)]
pub struct Subject {
    /// The scenes.
    pub scenes: Vec<SceneEntry>,
    /// The methods and their variants, in the order of the tables.
    pub variants: Vec<Variant>,
    /// Score settings.
    pub score: ScoreSettings,
    /// The published rows to show beside the measured ones.
    pub reference: Reference,
}

/// A method with changed settings.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Variant {
    /// The method.
    pub method: MethodName,
    /// Changed settings, e.g. `memory.feature_dim=14`; empty for the unchanged method.
    pub changes: Vec<String>,
}

/// A run to measure. Variants with identical settings share a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BenchJob {
    /// Index of the scene.
    pub scene: usize,
    /// Index of the first variant with the job's settings.
    pub variant: usize,
    /// The seed.
    pub seed: u64,
}

/// A row of the results.
#[derive(Clone, Copy, Debug)]
pub struct ResultEntry {
    /// Index of the scene.
    pub scene: usize,
    /// Index of the variant.
    pub variant: usize,
    /// The seed.
    pub seed: u64,
    /// Index of the job that measures the row.
    pub job: usize,
}

/// The plan of a benchmark.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The scenes.
    pub scenes: Vec<SceneEntry>,
    /// The methods and their variants, in the order of the tables.
    pub variants: Vec<Variant>,
    /// The seeds.
    pub seeds: Vec<u64>,
    /// The runs to measure.
    pub jobs: Vec<BenchJob>,
    /// The rows.
    pub entries: Vec<ResultEntry>,
    /// Settings of each variant. `seed` is the first seed and `threads` is 0.
    variant_settings: Vec<Settings>,
    /// Score settings. Scores in both protocols are computed.
    score: ScoreSettings,
    /// Settings shared by all variants.
    pub settings: Settings,
    /// The protocol of the main tables.
    pub protocol: Protocol,
    /// The published rows to show beside the measured ones.
    pub reference: Reference,
    /// Total number of threads; 0: one per core.
    pub threads: usize,
}

impl Plan {
    /// Plans the benchmark of a command line.
    pub fn new(arguments: &BenchArguments) -> Result<Self, Failure> {
        let (options, ablations) = arguments.options_and_ablations();
        let layers = options.layers([])?;
        let variants = variants(&layers, &arguments.methods()?, &ablations)?;
        let settings = layers.resolve_shared().map_err(Failure::input)?;
        settings.run.memory_limit.enforce();
        let scenes = scenes(&arguments.scenes, &settings.dataset, &arguments.mesh)?;
        let (score, reference) = (arguments.score.settings()?, Reference::ScannetMv);
        Self::of(arguments, &layers, Subject { scenes, variants, score, reference })
    }

    /// Plans a benchmark of the subject's variants and scenes, with the settings of `layers`.
    pub fn of(arguments: &BenchArguments, layers: &SettingsLayers, subject: Subject) -> Result<Self, Failure> {
        let Subject { scenes, variants, score, reference } = subject;
        check_all_used(layers, &variants)?;
        let settings = layers.resolve_shared().map_err(Failure::input)?;
        let variant_settings: Vec<Settings> =
            variants.iter().map(|variant| variant_settings(layers, variant)).collect::<Result<_, _>>()?;
        let mut plan = Self {
            scenes,
            variants,
            seeds: seeds(settings.run.seed, arguments.seeds)?,
            jobs: Vec::new(),
            entries: Vec::new(),
            variant_settings,
            score: ScoreSettings { protocol: Protocol::Paper, ..score },
            threads: settings.run.threads,
            protocol: score.protocol,
            reference,
            settings,
        };
        plan.add_entries()?;
        Ok(plan)
    }

    fn add_entries(&mut self) -> Result<(), Failure> {
        let results = self.scenes.len().saturating_mul(self.variants.len()).saturating_mul(self.seeds.len());
        if results > MAX_RESULTS {
            return Err(Failure::input(format!(
                "{} scenes, {} methods and variants and {} seeds come to {results} results, expected at most \
                 {MAX_RESULTS}",
                self.scenes.len(),
                self.variants.len(),
                self.seeds.len()
            )));
        }
        // Variants with the same settings share their jobs.
        let same = |settings| self.variant_settings.iter().position(|other| other == settings);
        let first_same: Vec<usize> = self.variant_settings.iter().filter_map(same).collect();
        for scene in 0..self.scenes.len() {
            let mut job_of = HashMap::new();
            for (variant, first) in first_same.iter().enumerate() {
                for seed in &self.seeds {
                    let job = *job_of.entry((first, seed)).or_insert_with(|| {
                        self.jobs.push(BenchJob { scene, variant: *first, seed: *seed });
                        self.jobs.len() - 1
                    });
                    self.entries.push(ResultEntry { scene, variant, seed: *seed, job });
                }
            }
        }
        Ok(())
    }

    /// Returns the name of a job's file, and the job's inputs without the hashes of files.
    pub fn inputs(&self, job: &BenchJob) -> Result<(String, JobInputs), Failure> {
        let scene = &self.scenes[job.scene];
        let mut settings = self.variant_settings[job.variant].clone();
        settings.run.seed = job.seed;
        let inputs = JobInputs {
            scene: scene.path_text.clone(),
            settings,
            score: self.score,
            mesh: scene.mesh.clone(),
            files: Vec::new(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
        };
        Ok((job_key(&scene.name, &inputs)?, inputs))
    }

    /// The settings of a variant.
    pub fn variant_settings(&self, variant: usize) -> &Settings {
        &self.variant_settings[variant]
    }

    /// Describes the segmenter and the tracker of the methods, for headings.
    pub fn parts(&self) -> String {
        let with_segmenter = self.variant_settings.iter().find(|settings| settings.method.uses_segmenter());
        let segmenter = with_segmenter.map(|settings| format!("segmenter {}", settings.segmenter.name()));
        let tracked = self.variant_settings.iter().find_map(|Settings { method, .. }| {
            let (source, _) = method.prompts()?;
            let source = source.name().replace('-', " ");
            Some(format!("tracker {}, prompted with {source}", method.tracker()?.name()))
        });
        [segmenter, tracked].into_iter().flatten().collect::<Vec<_>>().join(", ")
    }

    /// Checks that at least one scene can be opened. Otherwise, the command line is wrong.
    pub fn require_a_scene(&self) -> Result<(), Failure> {
        let errors: Option<Vec<&str>> = self.scenes.iter().map(|scene| scene.error.as_deref()).collect();
        match errors.as_deref() {
            Some([first, ..]) => Err(Failure::input(first)),
            _ => Ok(()),
        }
    }
}

/// Returns `count` consecutive seeds.
fn seeds(first: u64, count: u64) -> Result<Vec<u64>, Failure> {
    let last = first.saturating_add(count.saturating_sub(1));
    if last > Allowed::MAX_WHOLE {
        return Err(Failure::input(format!(
            "--seeds {count} from --seed {first}: the last is beyond {}",
            Allowed::MAX_WHOLE
        )));
    }
    Ok((first..=last).collect())
}

/// Returns the scenes at these paths without duplicates. Each scene is opened to get its name.
///
/// # Errors
/// If a scene has true instances of a mesh, but no mesh.
pub fn scenes(paths: &[PathBuf], settings: &DatasetSettings, mesh: &MeshOptions) -> Result<Vec<SceneEntry>, Failure> {
    let mut scenes: Vec<SceneEntry> = Vec::new();
    for path in paths {
        if scenes.iter().any(|scene| scene.path == *path) {
            continue;
        }
        let opened = open_scene(path, settings);
        let path_text = path.display().to_string();
        let of_path = || path.file_name().map_or(path_text.clone(), |name| name.to_string_lossy().into_owned());
        let name = opened.as_ref().map_or_else(|_| of_path(), |scene| scene.name().to_owned());
        let taken = scenes.iter().any(|scene| scene.name == name);
        scenes.push(SceneEntry {
            path: path.clone(),
            mesh: mesh.of_scene(path, &name)?,
            name: if taken { path_text.clone() } else { name },
            path_text,
            error: opened.err().map(|error| error.to_string()),
        });
    }
    Ok(scenes)
}

/// Returns each method unchanged, and with each value of the ablated settings that it uses.
fn variants(layers: &SettingsLayers, methods: &[MethodName], ablations: &[String]) -> Result<Vec<Variant>, Failure> {
    let mut changes = vec![Vec::new()];
    for ablation in ablations {
        changes.extend(parse_ablation(ablation)?);
    }
    let mut variants: Vec<Variant> = Vec::new();
    for change in &changes {
        let mut refused = None;
        let before = variants.len();
        for method in methods {
            let variant = Variant { method: *method, changes: change.clone() };
            match unused_change(layers, &variant)? {
                Some(error) => refused = Some(error),
                None if variants.contains(&variant) => refused = None,
                None => variants.push(variant),
            }
        }
        if let (Some(error), true) = (refused, variants.len() == before) {
            return Err(Failure::input(error));
        }
    }
    // Variants of the same method stay together.
    variants.sort_by_key(|variant| methods.iter().position(|method| *method == variant.method));
    Ok(variants)
}

/// Returns the changed settings for each value of an ablation. `KEY=V1,V2+OTHER=V3` has two values: the first changes one
/// setting, the second changes two.
fn parse_ablation(ablation: &str) -> Result<Vec<Vec<String>>, Failure> {
    let malformed = || Failure::input(format!("--ablate {ablation}: expected KEY=V1,V2,… or KEY=V1+OTHER=V2,…"));
    let (key, values) = ablation.split_once('=').ok_or_else(malformed)?;
    let assignment = |key: &str, value: &str| {
        let (key, value) = (key.trim(), value.trim());
        if key.is_empty() || value.is_empty() {
            return Err(malformed());
        }
        if matches!(key, "seed" | "method" | "threads") {
            return Err(Failure::input(format!("--ablate {ablation}: use --seeds and --methods for these")));
        }
        Ok(format!("{key}={value}"))
    };
    let changes = values.split(',').map(|value| {
        let mut assignments: Vec<(&str, String)> = vec![(key, String::new())];
        for (index, part) in value.split('+').enumerate() {
            match part.split_once('=') {
                Some((key, value)) if index > 0 => assignments.push((key, value.to_owned())),
                _ => {
                    let (_, value) = assignments.last_mut().ok_or_else(malformed)?;
                    // A plus without a setting after it is part of the value.
                    *value = if index == 0 { part.to_owned() } else { format!("{value}+{part}") };
                }
            }
        }
        assignments.iter().map(|(key, value)| assignment(key, value)).collect()
    });
    changes.collect()
}

/// Returns an error if a variant's method does not use a changed setting.
fn unused_change(layers: &SettingsLayers, variant: &Variant) -> Result<Option<SettingsError>, Failure> {
    let is_changed = |error: &SettingsError| match error {
        SettingsError::Unused { key, .. } => {
            variant.changes.iter().any(|change| change.split('=').next().map(str::trim) == Some(key))
        }
        _ => false,
    };
    Ok(variant_layers(layers, variant)?.unused().into_iter().find(is_changed))
}

/// Returns the settings layers of a variant.
fn variant_layers(layers: &SettingsLayers, variant: &Variant) -> Result<SettingsLayers, Failure> {
    let mut layers = layers.clone();
    for change in &variant.changes {
        layers.add_assignment(change).map_err(Failure::input)?;
    }
    layers
        .add("method", variant.method.name())
        .ok_or_else(|| Failure::runtime("method is a section in the settings"))?;
    Ok(layers)
}

/// Checks that every setting is used by at least one variant. Otherwise, the command line is wrong.
fn check_all_used(layers: &SettingsLayers, variants: &[Variant]) -> Result<(), Failure> {
    let mut unused_by_all: Option<Vec<SettingsError>> = None;
    for variant in variants {
        let unused = variant_layers(layers, variant)?.unused();
        let is_unused = |error: &SettingsError| unused.iter().any(|other| other.key() == error.key());
        unused_by_all = Some(match unused_by_all {
            None => unused,
            Some(before) => before.into_iter().filter(is_unused).collect(),
        });
    }
    match unused_by_all.unwrap_or_default().into_iter().next() {
        Some(error) => Err(Failure::input(layers.with_place(error))),
        None => Ok(()),
    }
}

fn variant_settings(layers: &SettingsLayers, variant: &Variant) -> Result<Settings, Failure> {
    let mut settings = variant_layers(layers, variant)?.resolve_shared().map_err(Failure::input)?;
    // Results do not depend on these two.
    settings.run.threads = 0;
    settings.run.memory_limit = MemoryLimit::Auto;
    settings.validate().map_err(Failure::input)?;
    Ok(settings)
}

#[cfg(test)]
mod tests {
    use super::parse_ablation;

    #[test]
    fn a_value_of_an_ablation_may_change_other_settings_too() {
        let changes = |ablation| parse_ablation(ablation).unwrap();
        assert_eq!(changes("a=1, 2"), [["a=1"], ["a=2"]]);
        assert_eq!(changes("a=1+b=3,2"), [vec!["a=1", "b=3"], vec!["a=2"]]);
        assert_eq!(changes("a=x+y+b=z+w"), [["a=x+y", "b=z+w"]]);
        for wrong in ["a", "=1", "a=1,", "a=1+=2", "a=1+b=", "a=1+seed=2"] {
            assert!(parse_ablation(wrong).is_err(), "{wrong}");
        }
    }
}
