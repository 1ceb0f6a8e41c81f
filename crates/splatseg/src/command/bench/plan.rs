//! What a benchmark has to measure.

use super::arguments::BenchArguments;
use super::job::JobInputs;
use super::mesh_files::{MeshFiles, MeshOptions};
use super::store::job_key;
use crate::Settings;
use crate::command::Failure;
use crate::settings::{MethodName, SettingsError, SettingsLayers};
use splatseg_dataset::{DatasetSettings, open_scene};
use splatseg_input::MemoryLimit;
use splatseg_metrics::{Protocol, ScoreSettings};
use splatseg_report::paper::Reference;
use splatseg_settings::Allowed;
use std::collections::HashMap;
use std::path::PathBuf;

/// Most results of a benchmark: the scores of all are in memory for the report, 4 kB each.
const MAX_RESULTS: usize = 50_000;

/// A scene as it was given.
#[derive(Clone, Debug)]
pub struct SceneEntry {
    /// Its path.
    pub path: PathBuf,
    /// Its path as text.
    pub path_text: String,
    /// Its name in tables, different from all others'.
    pub name: String,
    /// Why it cannot be opened, if it cannot.
    pub error: Option<String>,
    /// Its mesh with true instances, if it has one.
    pub mesh: Option<MeshFiles>,
}

/// What is measured: everything of a plan that is not a setting of the methods.
#[derive(Clone, Debug)]
pub struct Subject {
    /// The scenes.
    pub scenes: Vec<SceneEntry>,
    /// The methods and their variants, in the order of the tables.
    pub variants: Vec<Variant>,
    /// How all are scored.
    pub score: ScoreSettings,
    /// The published rows that stand beside the measured ones.
    pub reference: Reference,
}

/// A method, and how its settings differ from the others'.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Variant {
    /// The method.
    pub method: MethodName,
    /// Settings that differ, e.g. `memory.feature_dim=14`; none for the method as it is.
    pub changes: Vec<String>,
}

/// One thing to run. Variants that come to the same settings share it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Job {
    /// Index of the scene.
    pub scene: usize,
    /// Index of the first variant with its settings.
    pub variant: usize,
    /// The seed.
    pub seed: u64,
}

/// One row of the results.
#[derive(Clone, Copy, Debug)]
pub struct Entry {
    /// Index of the scene.
    pub scene: usize,
    /// Index of the variant.
    pub variant: usize,
    /// The seed.
    pub seed: u64,
    /// Index of the job that measures it.
    pub job: usize,
}

/// All of a benchmark.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The scenes.
    pub scenes: Vec<SceneEntry>,
    /// The methods and their variants, in the order of the tables.
    pub variants: Vec<Variant>,
    /// The seeds.
    pub seeds: Vec<u64>,
    /// What to run.
    pub jobs: Vec<Job>,
    /// The rows.
    pub entries: Vec<Entry>,
    /// The settings of each variant; `seed` is that of the first, `threads` is 0.
    variant_settings: Vec<Settings>,
    /// How all are scored. Both protocols are computed.
    score: ScoreSettings,
    /// The settings that all share.
    pub settings: Settings,
    /// The protocol of the main tables.
    pub protocol: Protocol,
    /// The published rows that stand beside the measured ones.
    pub reference: Reference,
    /// Threads in all; 0: one per core.
    pub threads: usize,
}

impl Plan {
    /// What the command line asks for.
    pub fn new(arguments: &BenchArguments) -> Result<Self, Failure> {
        let layers = arguments.options.layers([])?;
        let variants = variants(&layers, &arguments.methods()?, &arguments.ablate)?;
        let settings = layers.resolve_shared().map_err(Failure::input)?;
        settings.run.memory_limit.enforce();
        let scenes = scenes(&arguments.scenes, &settings.dataset, &arguments.mesh)?;
        let (score, reference) = (arguments.score.settings()?, Reference::ScannetMv);
        Self::of(arguments, &layers, Subject { scenes, variants, score, reference })
    }

    /// These variants on these scenes, with the settings of `layers`.
    pub fn of(arguments: &BenchArguments, layers: &SettingsLayers, subject: Subject) -> Result<Self, Failure> {
        let Subject { scenes, variants, score, reference } = subject;
        check_that_all_are_used(layers, &variants)?;
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
                        self.jobs.push(Job { scene, variant: *first, seed: *seed });
                        self.jobs.len() - 1
                    });
                    self.entries.push(Entry { scene, variant, seed: *seed, job });
                }
            }
        }
        Ok(())
    }

    /// What decides a job's result, but for what its files hold, and the name of its file.
    pub fn inputs(&self, job: &Job) -> Result<(String, JobInputs), Failure> {
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

    /// What the methods build on, for headings.
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

    /// A benchmark without any scene that can be opened is a mistake of the command line.
    pub fn require_a_scene(&self) -> Result<(), Failure> {
        let errors: Option<Vec<&str>> = self.scenes.iter().map(|scene| scene.error.as_deref()).collect();
        match errors.as_deref() {
            Some([first, ..]) => Err(Failure::input(first)),
            _ => Ok(()),
        }
    }
}

/// Consecutive seeds.
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

/// The scenes at these paths, each once, opened to learn their names.
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

/// Each method as it is, then with each value of each ablation that it uses.
fn variants(layers: &SettingsLayers, methods: &[MethodName], ablations: &[String]) -> Result<Vec<Variant>, Failure> {
    let mut changes = vec![Vec::new()];
    for ablation in ablations {
        changes.extend(changes_of(ablation)?);
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
    // A method's own variants stay together.
    variants.sort_by_key(|variant| methods.iter().position(|method| *method == variant.method));
    Ok(variants)
}

/// What each value of an ablation changes: `KEY=V1,V2+OTHER=V3` is one change, and one of two settings.
fn changes_of(ablation: &str) -> Result<Vec<Vec<String>>, Failure> {
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
                    // A plus that no setting follows is part of the value.
                    *value = if index == 0 { part.to_owned() } else { format!("{value}+{part}") };
                }
            }
        }
        assignments.iter().map(|(key, value)| assignment(key, value)).collect()
    });
    changes.collect()
}

/// Why a method does not use the setting that makes a variant of it; `None` if it does.
fn unused_change(layers: &SettingsLayers, variant: &Variant) -> Result<Option<SettingsError>, Failure> {
    let is_changed = |error: &SettingsError| match error {
        SettingsError::Unused { key, .. } => {
            variant.changes.iter().any(|change| change.split('=').next().map(str::trim) == Some(key))
        }
        _ => false,
    };
    Ok(variant_layers(layers, variant)?.unused().into_iter().find(is_changed))
}

/// The layers of a variant.
fn variant_layers(layers: &SettingsLayers, variant: &Variant) -> Result<SettingsLayers, Failure> {
    let mut layers = layers.clone();
    for change in &variant.changes {
        layers.add_assignment(change).map_err(Failure::input)?;
    }
    layers.add("method", variant.method.name()).ok_or_else(|| Failure::work("method is a section in the settings"))?;
    Ok(layers)
}

/// A setting that no variant uses is a mistake of the command line.
fn check_that_all_are_used(layers: &SettingsLayers, variants: &[Variant]) -> Result<(), Failure> {
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
    // Results do not depend on them.
    settings.run.threads = 0;
    settings.run.memory_limit = MemoryLimit::Auto;
    settings.validate().map_err(Failure::input)?;
    Ok(settings)
}

#[cfg(test)]
mod tests {
    use super::changes_of;

    #[test]
    fn a_value_of_an_ablation_may_change_other_settings_too() {
        let changes = |ablation| changes_of(ablation).unwrap();
        assert_eq!(changes("a=1, 2"), [["a=1"], ["a=2"]]);
        assert_eq!(changes("a=1+b=3,2"), [vec!["a=1", "b=3"], vec!["a=2"]]);
        assert_eq!(changes("a=x+y+b=z+w"), [["a=x+y", "b=z+w"]]);
        for wrong in ["a", "=1", "a=1,", "a=1+=2", "a=1+b=", "a=1+seed=2"] {
            assert!(changes_of(wrong).is_err(), "{wrong}");
        }
    }
}
