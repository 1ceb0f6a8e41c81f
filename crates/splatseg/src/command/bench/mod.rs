//! `splatseg bench`: every method on every scene with every seed.
//!
//! `plan.rs` says what to measure, `job.rs` measures one result, `pool.rs` runs several at a time, `store.rs` keeps
//! results on disk, so that a run that was stopped can go on, and `results.rs` writes what came out. `paper/` makes the
//! plan for the paper's tables. The tables and the page themselves are the crate `splatseg-report`'s.

mod arguments;
mod job;
mod paper;
mod pictures;
mod plan;
mod pool;
mod results;
mod store;

pub use arguments::BenchArguments;

use super::Failure;
use super::output_folder::Existing;
use job::JobResult;
use paper::PaperBenchmark;
use plan::Plan;
use pool::Workers;
use results::Results;
use splatseg_dataset::write_atomically;
use splatseg_report::ScoreTable;
use store::{Program, ResultStore};

/// Does what `splatseg bench` asks for.
pub fn bench(arguments: &BenchArguments) -> Result<(), Failure> {
    let paper = arguments.runs_the_paper().then(|| PaperBenchmark::prepare(arguments)).transpose()?;
    let plan = match &paper {
        Some(paper) => paper.plan(arguments)?,
        None => Plan::new(arguments)?,
    };
    plan.require_a_scene()?;
    let program = Program::running();
    let store = ResultStore::open(&arguments.out, Existing::from_flag(arguments.overwrite), &program)?;
    let workers = Workers { jobs: arguments.jobs.max(1), threads: plan.threads };
    say!(
        "{} results (scenes: {}, methods and variants: {}, seeds: {})",
        plan.jobs.len(),
        plan.scenes.len(),
        plan.variants.len(),
        plan.seeds.len()
    );
    let outcomes = workers.run(&plan.jobs, |job| obtain(job, &store))?;
    store.warn_of_other_programs();

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

/// A job's result: the stored one, or a new one that is stored.
fn obtain(job: &plan::Job, store: &ResultStore) -> Result<JobResult, String> {
    if let Some(result) = store.load(job) {
        say!("{}: there already", job.key);
        return Ok(result);
    }
    let result = job::run(&job.inputs).inspect_err(|error| say!("{}: failed: {error}", job.key))?;
    store.save(job, &result).map_err(|error| error.to_string())?;
    say!("{}: {}", job.key, result.in_short());
    Ok(result)
}
