//! `splatseg bench`: every method on every scene with every seed.
//!
//! `plan.rs` says what to measure, `job.rs` measures one result, `pool.rs` runs several at a time, `input_files.rs` finds out what its files hold, `store.rs` keeps
//! results on disk, so that a run that was stopped can go on, and `results.rs` writes what came out. `paper/` makes the
//! plan for the paper's tables. The tables and the page themselves are the crate `splatseg-report`'s.

mod arguments;
mod input_files;
mod job;
mod paper;
mod pictures;
mod plan;
mod pool;
mod results;
mod store;

pub use arguments::BenchArguments;

use super::Failure;
use super::input_paths::InputPaths;
use super::output_folder::Existing;
use super::terminal::counted;
use input_files::InputHashes;
use job::JobResult;
use paper::PaperBenchmark;
use plan::{Job, Plan};
use pool::Workers;
use results::Results;
use splatseg_output::write_atomically;
use splatseg_report::ScoreTable;
use store::{Program, ResultStore, Stored};

/// Does what `splatseg bench` asks for.
pub fn bench(arguments: &BenchArguments) -> Result<(), Failure> {
    arguments.check_that_all_are_used()?;
    let paper = arguments.runs_the_paper().then(|| PaperBenchmark::prepare(arguments)).transpose()?;
    let plan = match &paper {
        Some(paper) => paper.plan(arguments)?,
        None => Plan::new(arguments)?,
    };
    plan.require_a_scene()?;
    let mut inputs = InputPaths::of(&plan.settings);
    plan.scenes.iter().for_each(|scene| inputs.add_scene(&scene.path));
    inputs.check_output_folder(&arguments.out)?;
    let existing = Existing::from_flag(arguments.overwrite);
    let store = ResultStore::open(&arguments.out, existing, Program::running())?;
    let hashes = InputHashes::open(&arguments.out);
    let workers = Workers { jobs: usize::try_from(arguments.jobs).unwrap_or(1), threads: plan.threads };
    say!(
        "{} (scenes: {}, methods and variants: {}, seeds: {})",
        counted(plan.jobs.len(), "result"),
        plan.scenes.len(),
        plan.variants.len(),
        plan.seeds.len()
    );
    let outcomes = workers.run(&plan.jobs, |job| obtain(job, &plan, &store, &hashes))?;
    hashes.save()?;
    say!("{}", what_was_reused(&outcomes));

    let results = Results { plan: &plan, outcomes: &outcomes };
    let benchmark = results.benchmark()?;
    results.write(&benchmark, &arguments.out)?;
    if let Some(paper) = &paper {
        let path = arguments.out.join("paper.md");
        write_atomically(&path, paper.document(&plan, &benchmark).as_bytes()).map_err(Failure::work)?;
        say!(
            "\n{}\nthe paper's tables, with our results next to its own, are in {}",
            paper.missing_list(),
            path.display()
        );
    }
    say!("\n{}", ScoreTable::over_all_scenes(&benchmark, plan.protocol).terminal());
    say!(
        "tables are in {}, the report is {}: open it in a browser",
        arguments.out.join("tables.md").display(),
        arguments.out.join("report.html").display()
    );
    match benchmark.missing.as_slice() {
        [] => Ok(()),
        [first, ..] => Err(Failure::work(format!(
            "{} of {} results are missing, see {}; the first: {}: {}",
            benchmark.missing.len(),
            plan.entries.len(),
            arguments.out.join("failures.json").display(),
            first.scene,
            first.error
        ))),
    }
}

/// A job's result, and where it came from.
struct Outcome {
    /// The name of its file, without ending.
    key: String,
    result: JobResult,
    origin: Origin,
}

/// Where a result came from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Origin {
    /// It was there.
    Stored,
    /// It is new.
    Measured,
    /// It takes the place of one that does not hold any more.
    MeasuredAgain,
}

/// A job's result: the stored one, or a new one that is stored.
fn obtain(job: &Job, plan: &Plan, store: &ResultStore, hashes: &InputHashes) -> Result<Outcome, String> {
    let (key, mut inputs) = plan.inputs(job).map_err(|error| error.to_string())?;
    let failed = |error: &String| say!("{key}: failed: {error}");
    let scene = &plan.scenes[job.scene].path;
    inputs.files = hashes.of(scene, &inputs.settings).inspect_err(failed)?;
    let mut origin = Origin::Measured;
    match store.load(&key, &inputs) {
        Stored::Same(result) => {
            say!("{key}: there already");
            return Ok(Outcome { key, result: *result, origin: Origin::Stored });
        }
        Stored::Outdated(reason) => {
            say!("{key}: measured again: {reason}");
            origin = Origin::MeasuredAgain;
        }
        Stored::Nothing => {}
    }
    let mut result = job::run(scene, &inputs).inspect_err(failed)?;
    store.save(&key, &result).map_err(|error| error.to_string())?;
    say!("{key}: {}", result.in_short());
    if job.seed != plan.seeds[0] {
        // The report shows the pictures of the first seed only.
        result.strip = Vec::new();
    }
    Ok(Outcome { key, result, origin })
}

/// How many of the results were there, and how many were measured.
fn what_was_reused(outcomes: &[Result<Outcome, String>]) -> String {
    let count = |wanted| outcomes.iter().flatten().filter(|outcome| outcome.origin == wanted).count();
    let (all, stored, again) = (outcomes.len(), count(Origin::Stored), count(Origin::MeasuredAgain));
    let measured = count(Origin::Measured) + again;
    let again = match again {
        0 => String::new(),
        again => format!(", {again} of them again, as the program or an input had changed"),
    };
    format!("of {}, {stored} there already, {measured} measured{again}", counted(all, "result"))
}
