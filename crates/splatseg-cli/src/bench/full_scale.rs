//! Test of the report on the paper's data sets with three seeds, with stand-ins for results.
//!
//! By default, with five scenes and twelve videos. With all of them, and peak memory and file sizes on standard error:
//! `SPLATSEG_FULL_SCALE=1 cargo test -p splatseg-cli --lib full_scale -- --nocapture`

use super::input_files::InputHashes;
use super::job::{JobInputs, JobResult};
use super::paper::{DataSet, PaperBenchmark};
use super::plan::Plan;
use super::store::{Program, ResultStore};
use crate::arguments::{Arguments, Command, Parsed};
use crate::bench::BenchArguments;
use crate::output_folder::OverwritePolicy;
use serde_json::json;
use splatseg::pipeline::StageTimes;
use splatseg::summary::{FramesPerSecond, peak_memory_mb};
use splatseg_dataset::open_scene;
use splatseg_geometry::SegmentMap;
use splatseg_metrics::{FramePrediction, Protocol, ScoreSettings, VideoScore, VideoScorer};
use splatseg_report::{Series, Thumbnail};
use splatseg_tracking::TrackErrorCounts;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Scans of ScanNet's validation split.
const SCANNET_SCENES: usize = 312;
/// Videos of MVPd's test split.
const MVPD_VIDEOS: usize = 1800;
const SEEDS: usize = 3;
/// Variants on ScanNet-MV: methods, dimensions, categories (except "none", which is SAM2), clicks from two sources.
const SCANNET_VARIANTS: usize = 7 + 5 + 4 + 6;
const MVPD_VARIANTS: usize = 5;
/// Number of frames with a thumbnail in each result.
const DRAWN: usize = 8;
/// Number of frames with times in each result.
const FRAMES: usize = 100;
/// Bytes of a thumbnail, as for a room at 224x168 pixels.
const THUMBNAIL_BYTES: usize = 14_000;
const MAX_PAGE_BYTES: u64 = 20_000_000;
/// Maximum memory of the command, megabytes.
const MAX_MEMORY_MB: f64 = 1000.0;
/// Environment variable with the arguments for the process that runs the command, one per line.
const COMMAND_LINE: &str = "SPLATSEG_FULL_SCALE_COMMAND";
/// Prefix of the line with that process's peak memory.
const PEAK: &str = "peak memory, MB: ";

/// Numbers of scenes.
struct Scale {
    scannet: usize,
    mvpd: usize,
}

impl Scale {
    fn chosen() -> Self {
        if std::env::var_os("SPLATSEG_FULL_SCALE").is_some() {
            Self { scannet: SCANNET_SCENES, mvpd: MVPD_VIDEOS }
        } else {
            Self { scannet: 5, mvpd: 12 }
        }
    }
}

#[test]
fn the_report_of_the_full_data_is_small() {
    if let Ok(arguments) = std::env::var(COMMAND_LINE) {
        let arguments = arguments.lines().map(Into::into).collect();
        assert_eq!(crate::main(arguments, Vec::new()), 0);
        crate::terminal::print_line(&format!("{PEAK}{}", peak_memory_mb().unwrap_or_default()));
        return;
    }
    let (folder, scale) = (tempfile::tempdir().unwrap(), Scale::chosen());
    let out = folder.path().join("out");
    let command_line = command_line(folder.path(), &out, &scale);
    let Parsed::Arguments(parsed) = Arguments::parse(command_line.iter().map(Into::into).collect()) else { panic!() };
    let Command::Bench(arguments) = parsed.command else { panic!() };
    let paper = PaperBenchmark::prepare(&arguments).unwrap();
    for (data, results) in [
        (DataSet::ScannetMv, scale.scannet * SCANNET_VARIANTS * SEEDS),
        (DataSet::Mvpd, scale.mvpd * MVPD_VARIANTS * SEEDS),
    ] {
        let plan = paper.plan(data, &arguments).unwrap().unwrap();
        assert_eq!(plan.entries.len(), results);
        write_results(&plan, &out.join(data.folder()), &arguments);
    }

    let child = std::process::Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "--nocapture", "bench::full_scale::the_report_of_the_full_data_is_small"])
        .env(COMMAND_LINE, command_line.join("\n"))
        .output()
        .unwrap();
    let stdout = String::from_utf8(child.stdout).unwrap();
    assert!(child.status.success(), "{stdout}\n{}", String::from_utf8_lossy(&child.stderr));
    assert!(stdout.contains(", 0 measured"), "{stdout}");
    let peak = stdout.lines().find_map(|line| line.strip_prefix(PEAK)?.parse::<f64>().ok()).unwrap();
    report(&out, peak);
    assert!(peak < MAX_MEMORY_MB, "{peak} MB");
    check_benchmark(&out.join(DataSet::ScannetMv.folder()), scale.scannet, SCANNET_VARIANTS);
    check_benchmark(&out.join(DataSet::Mvpd.folder()), scale.mvpd, MVPD_VARIANTS);
    check_pages(&out);
    check_paper(&out);
}

/// Prints the numbers of a run at full scale.
fn report(out: &Path, peak: f64) {
    if std::env::var_os("SPLATSEG_FULL_SCALE").is_none() {
        return;
    }
    eprintln!("{PEAK}{peak}");
    for file in ["paper.html", "scannet-mv/report.html", "mvpd/report.html", "mvpd/results.json", "mvpd/tables.md"] {
        eprintln!("{file}, bytes: {}", fs::metadata(out.join(file)).unwrap().len());
    }
    if let Some(kept) = std::env::var_os("SPLATSEG_FULL_SCALE_KEEP") {
        for file in ["paper.html", "scannet-mv/report.html", "mvpd/report.html"] {
            fs::copy(out.join(file), Path::new(&kept).join(file.replace('/', "-"))).unwrap();
        }
    }
}

fn command_line(folder: &Path, out: &Path, scale: &Scale) -> Vec<String> {
    let mvpd = write_mvpd(&folder.join("MVPd/test"), scale.mvpd);
    let mut line = ["splatseg", "bench", "--preset", "paper", "--stride", "1"].map(str::to_owned).to_vec();
    line.extend(["--segmenter", "oracle", "--tracker", "sim", "--seeds", "3"].map(str::to_owned));
    line.extend(["--mvpd".to_owned(), mvpd.display().to_string()]);
    line.extend(["--out".to_owned(), out.display().to_string(), "--scenes".to_owned()]);
    line.extend((0..scale.scannet).map(|seed| format!("synthetic:frames={DRAWN},width=320,height=240,seed={seed}")));
    line
}

/// Writes a split of videos that all have the same images. Returns the folder that contains the split.
fn write_mvpd(split: &Path, count: usize) -> PathBuf {
    let kinds = [("imagesRGB", "jpg"), ("imagesDEPTH", "png"), ("panomasksRGB", "png")];
    let parts = kinds.map(|(kind, ending)| (split.join(kind), ending));
    parts.iter().for_each(|(part, _)| fs::create_dir_all(part).unwrap());
    let [color, depth, mask] = parts.each_ref().map(|(part, ending)| part.join(format!("any.{ending}")));
    let texture = |x: u32, y: u32| image::Rgb([(x / 3) as u8, (y / 2) as u8, (x * y / 16 % 64 + 90) as u8]);
    image::RgbImage::from_fn(640, 480, texture).save(&color).unwrap();
    image::ImageBuffer::from_pixel(640, 480, image::Luma([1500u16])).save(&depth).unwrap();
    image::RgbImage::from_fn(640, 480, |x, y| image::Rgb([(1 + x / 80 + 8 * (y / 80)) as u8, 0, 0]))
        .save(&mask)
        .unwrap();
    let (mut videos, mut annotations) = (Vec::new(), Vec::new());
    for video in 0..count {
        let name = format!("00800-room.{video:010}.0000000100");
        for ((part, ending), source) in parts.iter().zip([&color, &depth, &mask]) {
            fs::create_dir(part.join(&name)).unwrap();
            for frame in 0..DRAWN {
                fs::hard_link(source, part.join(&name).join(format!("{frame}.{ending}"))).unwrap();
            }
        }
        let image = |frame: usize| json!({"file_name": format!("{frame}.jpg"), "camera_position": [0, 0, 0], "camera_rotation": [1, 0, 0, 0]});
        let annotation = |frame: usize| json!({"file_name": format!("{frame}.png")});
        videos.push(json!({"video_name": name, "images": (0..DRAWN).map(image).collect::<Vec<_>>()}));
        annotations.push(json!({"video_name": name, "annotations": (0..DRAWN).map(annotation).collect::<Vec<_>>()}));
    }
    let document = json!({"videos": videos, "annotations": annotations});
    fs::write(split.join("panoptic_test.json"), document.to_string()).unwrap();
    split.parent().unwrap().to_owned()
}

/// Stores a stand-in for the result of each job.
fn write_results(plan: &Plan, out: &Path, arguments: &BenchArguments) {
    super::claim_paper_folder(&arguments.out, OverwritePolicy::Keep).unwrap();
    let store = ResultStore::open(out, OverwritePolicy::Keep, Program::running()).unwrap();
    let hashes = InputHashes::open(out);
    let scene = open_scene(&plan.scenes[0].path, &plan.settings.dataset).unwrap();
    let names: Vec<String> = (0..DRAWN).map(|frame| scene.read_frame(frame).unwrap().name().to_owned()).collect();
    let (_, inputs) = plan.inputs(&plan.jobs[0]).unwrap();
    let mut stand_in = stand_in(inputs, &names);
    let scores: Vec<[VideoScore; 2]> = (0..8).map(|missed| scores(missed, stand_in.inputs.score)).collect();
    for job in &plan.jobs {
        let (key, inputs) = plan.inputs(job).unwrap();
        stand_in.inputs = inputs;
        let (path, settings) = (&plan.scenes[job.scene].path, &stand_in.inputs.settings);
        stand_in.inputs.files = hashes.of(path, settings, None).unwrap();
        let kind = (job.scene + job.variant + job.seed as usize) % scores.len();
        [stand_in.paper, stand_in.strict] = scores[kind].clone();
        store.save(&key, &stand_in).unwrap();
    }
    hashes.save().unwrap();
}

/// Returns a stand-in for a result, with thumbnails of these frames.
fn stand_in(inputs: JobInputs, names: &[String]) -> JobResult {
    let mut series = Series::default();
    for frame in 0..FRAMES {
        let stages = StageTimes::default().stages().to_vec();
        let time = Duration::from_micros(1000 + 137 * frame as u64 % 1000);
        series.push(stages.into_iter().map(|(name, _)| (name, time)), Some(1000 * frame));
    }
    let stage_ms = series.stage_ms.iter().map(|(name, times)| (name.clone(), f64::from(times[0]))).collect();
    let image = format!("data:image/jpeg;base64,{}", "A".repeat(THUMBNAIL_BYTES));
    let [paper, strict] = scores(0, inputs.score);
    JobResult {
        final_pass: None,
        late: None,
        inputs,
        program: String::new(),
        frames: FRAMES,
        skipped_frames: 0,
        failed_frames: 0,
        segments: 40,
        gaussians: 100_000,
        parameters: 1_500_000,
        fps: FramesPerSecond { total: 3.0, without_segmenter: 10.0 },
        stage_ms,
        track_errors: TrackErrorCounts::default(),
        paper,
        strict,
        machine: "a machine, 2 threads".to_owned(),
        mesh: None,
        series,
        strip: names.iter().map(|name| Thumbnail { frame: name.clone(), image: image.clone() }).collect(),
    }
}

/// Scores for an object over half the image. The prediction misses `missed` columns of it.
fn scores(missed: usize, settings: ScoreSettings) -> [VideoScore; 2] {
    let map = |columns: usize| SegmentMap::from_fn(16, 4, |column, _| u32::from(column < columns));
    [Protocol::Paper, Protocol::Strict].map(|protocol| {
        let mut scorer = VideoScorer::new(ScoreSettings { protocol, ..settings });
        for _ in 0..16 {
            scorer.push(&map(8), &FramePrediction::Ids(&map(8 - missed))).unwrap();
        }
        scorer.finish()
    })
}

/// Asserts that the tables of a benchmark are complete.
fn check_benchmark(out: &Path, scenes: usize, variants: usize) {
    let read = |file: &str| fs::read_to_string(out.join(file)).unwrap();
    let results = scenes * variants * SEEDS;
    assert_eq!(read("results.csv").lines().count(), 1 + results);
    assert_eq!(read("results.json").lines().filter(|line| line.starts_with("    \"scene\": ")).count(), results);
    assert_eq!(read("failures.json"), "[]");
    // Scores and sizes in both protocols, single frames, stages, and the scenes.
    let tables = read("tables.md");
    assert_eq!(tables.matches("\n## ").count(), 6 + scenes);
    let measured =
        |line: &&str| line.starts_with("| fastsam") || line.starts_with("| fastspam") || line.starts_with("| sam2");
    assert_eq!(tables.lines().filter(measured).count(), variants * (2 + 2 * 3 + 2 + scenes));
    assert!(tables.contains(&format!("## All {scenes} scenes, protocol paper\n")));
    let page = read("report.html");
    assert!((page.len() as u64) < MAX_PAGE_BYTES, "{} bytes", page.len());
    let of_scenes = &page[page.find("VSQ of each scene").unwrap()..page.find("class=\"strip\"").unwrap()];
    assert_eq!(of_scenes.matches("<tr>").count(), 1 + scenes);
    assert_eq!(of_scenes.matches("<td>").count(), scenes * variants);
}

/// Asserts that the pages have the right pictures and curves.
fn check_pages(out: &Path) {
    let read = |file: &str| fs::read_to_string(out.join(file).join("report.html")).unwrap();
    let (scannet, mvpd) = (read("scannet-mv"), read("mvpd"));
    let shown = |page: &str| {
        let methods = page.matches("<figure data-variant=").count();
        let hidden = page.matches(" hidden><img").count();
        [page.matches("class=\"strip\"").count(), methods, methods - hidden]
    };
    // FastSAM, FastSPAM, SAM2, FastSAM-Splat and SAM2-Splat are shown at first; every variant can be chosen.
    assert_eq!(shown(&scannet), [5, 5 * SCANNET_VARIANTS, 5 * 5]);
    assert_eq!(shown(&mvpd), [12, 12 * MVPD_VARIANTS, 12 * MVPD_VARIANTS]);
    assert_eq!(scannet.matches("<fieldset class=\"chooser\">").count(), 1);
    assert!(scannet.contains("\"images\":[\"data:image/jpeg;base64,A") && mvpd.contains("/jpeg;base64,A"));
    for title in [
        "fastsam-splat by memory.feature_dim",
        "sam2-splat by reprompt.clicks",
        "sam2-splat by reprompt.clicks, prompts=ground-truth",
    ] {
        assert!(scannet.contains(&format!("<figcaption>{title}</figcaption>")), "{title}");
    }
}

/// Asserts that the paper's tables and curves are complete.
fn check_paper(out: &Path) {
    let read = |file: &str| fs::read_to_string(out.join(file)).unwrap();
    let text = read("paper.md");
    let rows = |wanted: fn(&&str) -> bool| text.lines().filter(wanted).count();
    // Five tables of scores, with two rows that the paper lacks, and efficiency.
    let (ours, papers) = (7 + 5 + 5 + 6 + MVPD_VARIANTS + 5, 7 + 5 + 5 + 6 + 9 + 11);
    assert_eq!(rows(|line| line.starts_with("| ") && !line.starts_with("| *") && !line.starts_with("|  |")), ours);
    assert_eq!(rows(|line| line.starts_with("| *")), papers);
    let page = read("paper.html");
    assert!(page.len() < 200_000, "{} bytes", page.len());
    // D, clicks from detections and clicks from ground truth, each with two of our curves and two of the paper's.
    assert_eq!((page.matches("<svg ").count(), page.matches("<path class=\"curve").count()), (3, 12));
    assert_eq!(page.matches("<circle ").count(), 4 * (5 + 3 + 3));
}

#[test]
fn results_in_memory_have_no_drawings() {
    let folder = tempfile::tempdir().unwrap();
    let scale = Scale { scannet: 1, mvpd: 1 };
    let line = command_line(folder.path(), &folder.path().join("out"), &scale);
    let Parsed::Arguments(parsed) = Arguments::parse(line.iter().map(Into::into).collect()) else { panic!() };
    let Command::Bench(arguments) = parsed.command else { panic!() };
    let plan = PaperBenchmark::prepare(&arguments).unwrap().plan(DataSet::Mvpd, &arguments).unwrap().unwrap();
    let (_, inputs) = plan.inputs(&plan.jobs[0]).unwrap();
    let result = stand_in(inputs, &["0".to_owned()]).without_drawings();
    assert_eq!((result.series, result.strip.len(), result.inputs.files.len()), (Series::default(), 0, 0));
}
