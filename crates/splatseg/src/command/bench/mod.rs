//! `splatseg bench`: scenes × methods × seeds, one result at a time, and what they come to.

mod arguments;
mod csv;
mod job;
mod markdown;
mod paper;
mod plan;
mod pool;
mod report;
mod rows;
mod size_table;
mod stage_table;
mod store;
mod tables;
mod thumbnail;

pub use arguments::BenchArguments;

use super::Failure;
use super::output_folder::Existing;
use job::JobResult;
use paper::PaperBenchmark;
use plan::Plan;
use pool::Workers;
use rows::{Failed, Finished, Row};
use splatseg_dataset::write_atomically;
use splatseg_metrics::Protocol;
use std::path::Path;
use store::{Program, ResultStore};

/// Everything that a benchmark found out.
pub struct Results<'a> {
    /// What was asked for.
    pub plan: &'a Plan,
    /// The protocol of the main tables.
    pub protocol: Protocol,
    /// What was measured, in the plan's order.
    pub finished: Vec<Finished<'a>>,
    /// What was not, and why.
    pub failed: Vec<Failed<'a>>,
}

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
        "{} results to have: {} scenes, {} methods and variants, {} seeds",
        plan.jobs.len(),
        plan.scenes.len(),
        plan.variants.len(),
        plan.seeds.len()
    );
    let outcomes = workers.run(&plan.jobs, |job| obtain(job, &store))?;
    store.warn_of_other_programs();

    let results = Results::new(&plan, plan.protocol, &outcomes);
    write(&arguments.out, &results)?;
    if let Some(paper) = &paper {
        let path = arguments.out.join("paper.md");
        write_atomically(&path, paper::document(paper, &results).as_bytes()).map_err(Failure::work)?;
        say!("\n{}\nthe paper's tables, ours beside its own, are in {}", paper.missing_list(), path.display());
    }
    say!("\n{}", tables::over_all_scenes(&results, plan.protocol).terminal());
    say!(
        "tables are in {}, the report is {}: open it in a browser",
        arguments.out.join("tables.md").display(),
        arguments.out.join("report.html").display()
    );
    match results.failed.as_slice() {
        [] => Ok(()),
        [first, ..] => Err(Failure::work(format!(
            "{} of {} results are missing, see {}; the first: {}: {}",
            results.failed.len(),
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

impl<'a> Results<'a> {
    fn new(plan: &'a Plan, protocol: Protocol, outcomes: &'a [Result<JobResult, String>]) -> Self {
        let (mut finished, mut failed) = (Vec::new(), Vec::new());
        for entry in &plan.entries {
            let scene = &plan.scenes[entry.scene];
            match &outcomes[entry.job] {
                Ok(result) => finished.push(Finished {
                    scene: entry.scene,
                    variant: entry.variant,
                    seed: entry.seed,
                    key: &plan.jobs[entry.job].key,
                    result,
                }),
                Err(error) => failed.push(Failed {
                    scene: &scene.name,
                    scene_path: &scene.path,
                    method: plan.variants[entry.variant].method.name(),
                    variant: plan.variants[entry.variant].change(),
                    seed: entry.seed,
                    error,
                }),
            }
        }
        Self { plan, protocol, finished, failed }
    }

    /// What was measured for one scene and variant, by seed.
    pub fn of(&self, scene: usize, variant: usize) -> impl Iterator<Item = &Finished<'a>> {
        self.finished.iter().filter(move |finished| (finished.scene, finished.variant) == (scene, variant))
    }

    /// The rows of `results.json`.
    pub fn rows(&self) -> Vec<Row<'_>> {
        self.finished.iter().map(|finished| Row::new(self, finished)).collect()
    }
}

fn write(out: &Path, results: &Results) -> Result<(), Failure> {
    let write = |name: &str, text: &str| write_atomically(&out.join(name), text.as_bytes()).map_err(Failure::work);
    let rows = results.rows();
    write("results.json", &pretty(&rows)?)?;
    write("failures.json", &pretty(&results.failed)?)?;
    write("results.csv", &csv::table(&rows))?;
    write("tables.md", &markdown::document(results))?;
    write("report.html", &report::page(results).map_err(Failure::work)?)
}

fn pretty(value: &impl serde::Serialize) -> Result<String, Failure> {
    serde_json::to_string_pretty(value).map_err(Failure::work)
}
