//! `splatseg bench`: every method on every scene with every seed.
//!
//! `plan.rs` plans the results to measure, `job.rs` measures one result, `pool.rs` runs several jobs at a time,
//! `depth_check.rs` checks depth predictors first, `input_files.rs` hashes the input files, and `store.rs` keeps results on
//! disk, so that a stopped benchmark can be resumed. `results.rs` writes the tables and the report, with the pictures from `drawings.rs`. `mesh_files.rs` finds the
//! scenes' meshes. `paper/` plans the paper's tables. The crate `splatseg-report` formats the tables and the report.

mod arguments;
mod depth_check;
mod drawings;
mod final_pass;
#[cfg(test)]
mod full_scale;
mod input_files;
mod job;
mod late_results;
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
use super::output_folder::OverwritePolicy;
use super::terminal::counted;
use super::{Failure, devices};
use input_files::InputHashes;
use job::JobResult;
use paper::{DataSet, PaperBenchmark};
use plan::{BenchJob, Plan};
use pool::Workers;
use results::Results;
use splatseg_output::write_atomically;
use splatseg_report::paper::{csv, markdown};
use splatseg_report::{Benchmark, ScoreTable, paper_page};
use std::ffi::OsString;
use std::path::Path;
use store::{PAPER_FILES, Program, ResultStore, Stored, claim_paper_folder};

/// Executes `splatseg bench`.
pub fn bench(arguments: &BenchArguments, program: &[OsString]) -> Result<(), Failure> {
    arguments.check_all_used()?;
    if arguments.runs_the_paper() {
        return bench_paper(arguments, program);
    }
    let mut plan = Plan::new(arguments)?;
    plan.check_depth_predictors()?;
    devices::check(plan.settings.device(), program)?;
    let outcomes = measure(&plan, arguments, &arguments.out)?;
    let benchmark = finish(&plan, &outcomes, &arguments.out)?;
    missing_results(&[(&benchmark, arguments.out.as_path())])
}

/// Measures the paper's tables: a benchmark for each data set, and the tables over both.
fn bench_paper(arguments: &BenchArguments, program: &[OsString]) -> Result<(), Failure> {
    let paper = PaperBenchmark::prepare(arguments)?;
    if arguments.dry_run {
        return paper.dry_run(arguments);
    }
    let mut plans = Vec::new();
    for data in DataSet::ALL {
        if let Some(mut plan) = paper.plan(data, arguments)? {
            plan.check_depth_predictors()?;
            plan.require_a_scene()?;
            let folder = arguments.out.join(data.folder());
            check_output(&plan, &arguments.out)?;
            plans.push((data, plan, folder));
        }
    }
    if plans.is_empty() {
        say!("{}", paper.missing_list());
        return Err(Failure::input("no paper benchmark can run: give --scannet or --mvpd, and --weights-dir"));
    }
    for (_, plan, _) in &plans {
        devices::check(plan.settings.device(), program)?;
    }
    claim_paper_folder(&arguments.out, OverwritePolicy::from_flag(arguments.overwrite))?;
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
        write_atomically(&arguments.out.join(file), text.as_bytes()).map_err(Failure::runtime)?;
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

/// Loads or measures every result of a plan.
fn measure(plan: &Plan, arguments: &BenchArguments, out: &Path) -> Result<Vec<Result<Outcome, String>>, Failure> {
    plan.require_a_scene()?;
    check_output(plan, out)?;
    let store = ResultStore::open(out, OverwritePolicy::from_flag(arguments.overwrite), Program::running())?;
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
    say!("{}", reuse_summary(&outcomes));
    Ok(outcomes)
}

/// Writes the results of a plan.
fn finish<'a>(plan: &'a Plan, outcomes: &'a [Result<Outcome, String>], out: &Path) -> Result<Benchmark<'a>, Failure> {
    let results = Results { plan, outcomes };
    let benchmark = results.benchmark()?;
    results.write(&benchmark, out)?;
    say!("\n{}", ScoreTable::over_all_scenes(&benchmark, plan.protocol).terminal());
    if let Some(again) = benchmark.of_final_pass() {
        say!("\n{}", ScoreTable::of_final_pass(&again, plan.protocol).terminal());
    }
    say!(
        "tables are in {}, the report is {}: open it in a browser",
        out.join("tables.md").display(),
        out.join("report.html").display()
    );
    Ok(benchmark)
}

/// Returns an error if results are missing.
fn missing_results(benchmarks: &[(&Benchmark<'_>, &Path)]) -> Result<(), Failure> {
    let incomplete = benchmarks.iter().find_map(|(benchmark, out)| Some((benchmark, out, benchmark.missing.first()?)));
    let Some((benchmark, out, first)) = incomplete else { return Ok(()) };
    Err(Failure::runtime(format!(
        "{} of {} results are missing, see {}; the first: {}: {}",
        benchmark.missing.len(),
        benchmark.missing.len() + benchmark.measurements.len(),
        out.join("failures.json").display(),
        first.scene,
        first.error
    )))
}

/// A job's result, and its origin.
struct Outcome {
    /// Name of the result's file, without extension.
    key: String,
    /// The result, without drawings.
    result: JobResult,
    origin: Origin,
}

/// Origin of a result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Origin {
    /// Loaded from the store.
    Stored,
    /// Measured for the first time.
    Measured,
    /// Measured to replace an outdated result.
    MeasuredAgain,
}

/// Loads a job's result, or measures and stores it.
fn obtain(job: &BenchJob, plan: &Plan, store: &ResultStore, hashes: &InputHashes) -> Result<Outcome, String> {
    let (key, mut inputs) = plan.inputs(job).map_err(|error| error.to_string())?;
    let failed = |error: &String| say!("{key}: failed: {error}");
    let scene = &plan.scenes[job.scene].path;
    inputs.files = hashes.of(scene, &inputs.settings, inputs.mesh.as_ref()).inspect_err(failed)?;
    let mut origin = Origin::Measured;
    match store.load(&key, &inputs) {
        Stored::Same(result) => {
            report!("{key}: reused");
            return Ok(Outcome { key, result: result.without_drawings(), origin: Origin::Stored });
        }
        Stored::Outdated(reason) => {
            report!("{key}: measured again: {reason}");
            origin = Origin::MeasuredAgain;
        }
        Stored::Nothing => {}
    }
    let result = job::run(scene, &inputs).inspect_err(failed)?;
    store.save(&key, &result).map_err(|error| error.to_string())?;
    report!("{key}: {}", result.short_summary());
    Ok(Outcome { key, result: result.without_drawings(), origin })
}

/// Formats the numbers of reused and measured results.
fn reuse_summary(outcomes: &[Result<Outcome, String>]) -> String {
    let count = |wanted| outcomes.iter().flatten().filter(|outcome| outcome.origin == wanted).count();
    let (all, stored, again) = (outcomes.len(), count(Origin::Stored), count(Origin::MeasuredAgain));
    let measured = count(Origin::Measured) + again;
    let again = match again {
        0 => String::new(),
        again => format!(", {again} of them again because the program or an input has changed"),
    };
    format!("of {}, {stored} reused, {measured} measured{again}", counted(all, "result"))
}
