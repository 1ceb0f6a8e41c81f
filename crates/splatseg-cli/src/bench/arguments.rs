//! The command line of `splatseg bench`.

use super::mesh_files::MeshOptions;
use crate::Failure;
use crate::options::{PresetName, ScoreOptions, SettingsOptions};
use clap::Args;
use splatseg::settings::MethodName;
use splatseg_settings::Choice;
use std::path::PathBuf;

#[derive(Debug, Args)]
#[command(
    after_long_help = "Every result is saved under DIR/results as soon as it is measured. A stopped benchmark resumes when \
    it is started again. A result is measured again if the program, a setting, or the content of an input file has changed: \
    scene, ground truth, masks, weights. DIR/input_hashes.json caches the hashes of these files; a file is read again only \
    if its size or time has changed. A scene that cannot be used is listed in DIR/failures.json; the benchmark continues \
    with the others, and the exit code is 1.\n\n\
    DIR/report.html has pictures and curves of at most 12 scenes, evenly spaced, and the scores of all. To see another scene, \
    copy DIR and start again there with the same options but --scenes SCENE: nothing is measured twice.\n\n\
    Examples:\n  \
    splatseg bench --scenes dev-a dev-b --methods fastsam,fastspam,fastsam-splat --segmenter oracle \\\n    \
    --set oracle.preset=fastsam-like --seeds 5 --out bench\n  \
    splatseg bench --scenes dev-a --methods fastsam-splat --poses given,track --out poses\n  \
    splatseg bench --scenes dev-a --methods fastsam-splat --ablate memory.feature_dim=1,4,7,14,28 \\\n    \
    --ablate memory.num_steps=0,1,5,20,50 --out ablations\n  \
    splatseg bench --preset paper --scannet ScanNet --mvpd MVPd --weights-dir weights --out paper --dry-run"
)]
pub struct BenchArguments {
    /// Scenes with ground truth
    #[arg(long, value_name = "SCENE", num_args = 1.., required_unless_present = "preset")]
    pub scenes: Vec<PathBuf>,
    /// Methods; the report compares the others with the first
    #[arg(long, value_name = "METHOD,…", value_delimiter = ',', required_unless_present = "preset")]
    pub methods: Vec<String>,
    /// For --preset paper: ScanNet's folder, with scenes (.sens or exported) in it or in `scans`; if it contains
    /// scannetv2_val.txt, only the scenes listed there
    #[arg(long, value_name = "DIR")]
    pub scannet: Option<PathBuf>,
    /// For --preset paper: MVPd's folder: a split (panoptic_<split>.json and images), scenes' archives (.tar.gz), or folders
    /// of splits, of which `test` is used; if the split contains the authors' empty_videos.json, only the videos it accepts
    #[arg(long, value_name = "DIR")]
    pub mvpd: Option<PathBuf>,
    /// For --preset paper: folder with the checkpoints of FastSAM and SAM 2.1, under any name; checkpoints
    /// of EdgeTAM and EfficientTAM add rows
    #[arg(long, value_name = "DIR")]
    pub weights_dir: Option<PathBuf>,
    /// For --preset paper: only list every row with its inputs, missing inputs and their sources, and the estimated time
    #[arg(long)]
    pub dry_run: bool,
    /// With --dry-run: measure each method on the first N frames of the first scene, for a better estimate of the time
    #[arg(long, value_name = "N", requires = "dry_run", value_parser = clap::value_parser!(u64).range(1..=1000))]
    pub sample_frames: Option<u64>,
    /// Folder for results.json, results.csv, failures.json, tables.md, report.html and results/; with --preset paper, these
    /// are in scannet-mv/ and mvpd/, beside paper.md, paper.csv and paper.html
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    #[command(flatten)]
    pub mesh: MeshOptions,
    /// Measure everything again, even results in DIR/results
    #[arg(long)]
    pub overwrite: bool,
    /// Number of results measured at a time; they share the threads. Only 1 gives undisturbed speeds
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=256))]
    pub jobs: u64,
    /// Number of seeds, at most 1000, starting with --seed
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=1000))]
    pub seeds: u64,
    /// Vary one setting, e.g. memory.feature_dim=1,4,7,14,28: each value is a variant of every method, with its own row.
    /// If given several times, settings are varied one after the other, not together. +OTHER=V2 after a value changes
    /// another setting with it, e.g. segmenter=affinity,fastsam+weights=FastSAM-x.pt
    #[arg(long, value_name = "KEY=V1,V2,…")]
    pub ablate: Vec<String>,
    #[command(flatten)]
    pub score: ScoreOptions,
    #[command(flatten)]
    pub options: SettingsOptions,
}

impl BenchArguments {
    /// Parses the methods' names.
    pub fn methods(&self) -> Result<Vec<MethodName>, Failure> {
        let names = MethodName::NAMES.join(", ");
        let method = |name: &String| {
            MethodName::from_name(name)
                .ok_or_else(|| Failure::input(format!("--methods: found {name}, expected any of {names}")))
        };
        self.methods.iter().map(method).collect()
    }

    /// Returns the options and the ablations. `--poses given,track` stands for `--poses given --ablate poses=track`.
    pub fn options_and_ablations(&self) -> (SettingsOptions, Vec<String>) {
        let (mut options, mut ablations) = (self.options.clone(), self.ablate.clone());
        let others = options.poses.split_off(options.poses.len().min(1));
        if !others.is_empty() {
            ablations.push(format!("poses={}", others.join(",")));
        }
        (options, ablations)
    }

    /// Refuses options that have no effect with, or without, `--preset paper`.
    pub fn check_all_used(&self) -> Result<(), Failure> {
        let paper = self.runs_the_paper();
        for (option, is_given, is_used) in [
            ("--scannet", self.scannet.is_some(), paper),
            ("--mvpd", self.mvpd.is_some(), paper),
            ("--weights-dir", self.weights_dir.is_some(), paper),
            ("--dry-run", self.dry_run, paper),
            ("--methods", !self.methods.is_empty(), !paper),
            ("--ablate", !self.ablate.is_empty(), !paper),
        ] {
            if is_given && !is_used {
                let needs = if paper { "the paper's tables define the methods" } else { "it needs --preset paper" };
                return Err(Failure::input(format!("{option} is not used here: {needs}")));
            }
        }
        Ok(())
    }

    /// Returns true for `--preset paper`.
    pub fn runs_the_paper(&self) -> bool {
        self.options.dataset.preset == Some(PresetName::Paper)
    }
}
