//! `splatseg bench`: every method on every scene with every seed.
//!
//! `plan.rs` says what to measure, `job.rs` measures one result, `pool.rs` runs several at a time, `input_files.rs` finds
//! out what its files hold, and `store.rs` keeps results on disk, so that a run that was stopped can go on. `results.rs`
//! writes tables and page, with the pictures that `drawings.rs` reads again. `mesh_files.rs` has the scenes' meshes.
//! `paper/` makes the plans for the paper's tables. The tables and the page themselves are the crate `splatseg-report`'s.

mod arguments;
mod drawings;
#[cfg(test)]
mod full_scale;
mod input_files;
mod job;
mod machine;
mod mesh_files;
mod paper;
mod pictures;
mod plan;
mod pool;
mod results;
mod store;

pub use arguments::BenchArguments;
pub use machine::processor;

use super::input_paths::InputPaths;
use super::output_folder::Existing;
use super::terminal::counted;
use super::{Failure, devices};
use input_files::InputHashes;
use job::JobResult;
use paper::{DataSet, PaperBenchmark};
use plan::{Job, Plan};
use pool::Workers;
use results::Results;
use splatseg_output::write_atomically;
use splatseg_report::paper::{csv, markdown};
use splatseg_report::{Benchmark, ScoreTable, paper_page};
use std::ffi::OsString;
use std::path::Path;
use store::{PAPER_FILES, Program, ResultStore, Stored, claim_paper_folder};

/// Does what `splatseg bench` asks for.
pub fn bench(arguments: &BenchArguments, program: &[OsString]) -> Result<(), Failure> {
    arguments.check_that_all_are_used()?;
    if arguments.runs_the_paper() {
        return bench_paper(arguments, program);
    }
    let plan = Plan::new(arguments)?;
    devices::check(plan.settings.devices(), program)?;
    let outcomes = measure(&plan, arguments, &arguments.out)?;
    let benchmark = finish(&plan, &outcomes, &arguments.out)?;
    missing_results(&[(&benchmark, arguments.out.as_path())])
}

/// Measures the paper's tables: a benchmark for each of its data sets, and the tables over both.
fn bench_paper(arguments: &BenchArguments, program: &[OsString]) -> Result<(), Failure> {
    let paper = PaperBenchmark::prepare(arguments)?;
    if arguments.dry_run {
        return paper.dry_run(arguments);
    }
    let mut plans = Vec::new();
    for data in DataSet::ALL {
        if let Some(plan) = paper.plan(data, arguments)? {
            plan.require_a_scene()?;
            let folder = arguments.out.join(data.folder());
            check_output(&plan, &arguments.out)?;
            plans.push((data, plan, folder));
        }
    }
    if plans.is_empty() {
        say!("{}", paper.missing_list());
        return Err(Failure::input("nothing of the paper can be run: give --scannet or --mvpd, and --weights-dir"));
    }
    for (_, plan, _) in &plans {
        devices::check(plan.settings.devices(), program)?;
    }
    claim_paper_folder(&arguments.out, Existing::from_flag(arguments.overwrite))?;
    let mut outcomes = Vec::new();
    for (_, plan, folder) in &plans {
        outcomes.push(measure(plan, arguments, folder)?);
    }
    let mut benchmarks = Vec::new();
    for ((_, plan, folder), outcomes) in plans.iter().zip(&outcomes) {
        benchmarks.push((finish(plan, outcomes, folder)?, folder));
    }
    let parts = plans.iter().zip(&benchmarks).map(|((data, plan, _), (benchmark, _))| (*data, plan, benchmark));
    let parts: Vec<_> = parts.collect();
    let texts = paper.with_results(&parts, |results| [markdown(results), csv(results), paper_page(results)]);
    for (file, text) in PAPER_FILES.iter().zip(&texts) {
        write_atomically(&arguments.out.join(file), text.as_bytes()).map_err(Failure::work)?;
    }
    say!(
        "\n{}\nthe paper's tables, with our results next to its own, are in {}",
        paper.missing_list(),
        arguments.out.join(PAPER_FILES[0]).display()
    );
    let benchmarks: Vec<_> = benchmarks.iter().map(|(benchmark, folder)| (benchmark, folder.as_path())).collect();
    missing_results(&benchmarks)
}

/// Checks that results in a folder cannot touch an input.
fn check_output(plan: &Plan, out: &Path) -> Result<(), Failure> {
    let mut inputs = InputPaths::of(&plan.settings);
    plan.scenes.iter().for_each(|scene| inputs.add_scene(&scene.path));
    inputs.check_output_folder(out)
}

/// Obtains every result of a plan.
fn measure(plan: &Plan, arguments: &BenchArguments, out: &Path) -> Result<Vec<Result<Outcome, String>>, Failure> {
    plan.require_a_scene()?;
    check_output(plan, out)?;
    let store = ResultStore::open(out, Existing::from_flag(arguments.overwrite), Program::running())?;
    let hashes = InputHashes::open(out);
    let workers = Workers { jobs: usize::try_from(arguments.jobs).unwrap_or(1), threads: plan.threads };
    say!(
        "{} (scenes: {}, methods and variants: {}, seeds: {})",
        counted(plan.jobs.len(), "result"),
        plan.scenes.len(),
        plan.variants.len(),
        plan.seeds.len()
    );
    let outcomes = workers.run(&plan.jobs, |job| obtain(job, plan, &store, &hashes))?;
    hashes.save()?;
    say!("{}", what_was_reused(&outcomes));
    Ok(outcomes)
}

/// Writes what came of a plan.
fn finish<'a>(plan: &'a Plan, outcomes: &'a [Result<Outcome, String>], out: &Path) -> Result<Benchmark<'a>, Failure> {
    let results = Results { plan, outcomes };
    let benchmark = results.benchmark()?;
    results.write(&benchmark, out)?;
    say!("\n{}", ScoreTable::over_all_scenes(&benchmark, plan.protocol).terminal());
    say!(
        "tables are in {}, the report is {}: open it in a browser",
        out.join("tables.md").display(),
        out.join("report.html").display()
    );
    Ok(benchmark)
}

/// An error if results are missing.
fn missing_results(benchmarks: &[(&Benchmark<'_>, &Path)]) -> Result<(), Failure> {
    let incomplete = benchmarks.iter().find_map(|(benchmark, out)| Some((benchmark, out, benchmark.missing.first()?)));
    let Some((benchmark, out, first)) = incomplete else { return Ok(()) };
    Err(Failure::work(format!(
        "{} of {} results are missing, see {}; the first: {}: {}",
        benchmark.missing.len(),
        benchmark.missing.len() + benchmark.measurements.len(),
        out.join("failures.json").display(),
        first.scene,
        first.error
    )))
}

/// A job's result, and where it came from.
struct Outcome {
    /// The name of its file, without ending.
    key: String,
    /// Without drawings.
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
    inputs.files = hashes.of(scene, &inputs.settings, inputs.mesh.as_ref()).inspect_err(failed)?;
    let mut origin = Origin::Measured;
    match store.load(&key, &inputs) {
        Stored::Same(result) => {
            say!("{key}: there already");
            return Ok(Outcome { key, result: result.without_drawings(), origin: Origin::Stored });
        }
        Stored::Outdated(reason) => {
            say!("{key}: measured again: {reason}");
            origin = Origin::MeasuredAgain;
        }
        Stored::Nothing => {}
    }
    let result = job::run(scene, &inputs).inspect_err(failed)?;
    store.save(&key, &result).map_err(|error| error.to_string())?;
    say!("{key}: {}", result.in_short());
    Ok(Outcome { key, result: result.without_drawings(), origin })
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
