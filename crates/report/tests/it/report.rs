//! Tables and page of a small made-up benchmark.

use splatseg_geometry::SegmentMap;
use splatseg_metrics::{FramePrediction, InstanceScorer, MIN_INSTANCE_VERTICES, PredictedInstance};
use splatseg_metrics::{Protocol, ScoreSettings, VideoScore, VideoScorer};
use splatseg_report::paper::{EfficiencyRow, MVPD, PaperResults, PaperRow, PaperTable, Reference, vsq_columns};
use splatseg_report::{Benchmark, Measurement, MissingResult, PageSelection, RunDrawings, SceneDrawings, ScenePicture};
use splatseg_report::{ScoreTable, Series, StageTable, Thumbnail, Variant};
use splatseg_report::{csv_table, html_page, markdown_tables, paper, paper_page};
use std::collections::BTreeMap;
use std::time::Duration;

const FRAMES: usize = 16;

/// Measurements of a run, without the scene and the method.
struct Run {
    paper: VideoScore,
    strict: VideoScore,
    stage_ms: BTreeMap<String, f64>,
    series: Series,
}

impl Run {
    /// An object over the left half; the prediction misses `missed` of its eight columns.
    fn new(missed: usize) -> Self {
        let map = |columns: usize| SegmentMap::from_fn(16, 4, |column, _| u32::from(column < columns));
        let score = |protocol| {
            let mut scorer = VideoScorer::new(ScoreSettings { protocol, ..ScoreSettings::default() });
            for _ in 0..FRAMES {
                scorer.push(&map(8), &FramePrediction::Ids(&map(8 - missed))).unwrap();
            }
            scorer.finish()
        };
        let mut series = Series::default();
        for _ in 0..FRAMES {
            let stages = [("segment", 5), ("track", 0), ("grow", 2), ("learn", 1)];
            series.push(stages.map(|(name, ms)| (name, Duration::from_millis(ms))), Some(7));
        }
        let stage_ms = series.stage_ms.iter().map(|(name, times)| (name.clone(), f64::from(times[0]))).collect();
        Self { paper: score(Protocol::Paper), strict: score(Protocol::Strict), stage_ms, series }
    }

    fn drawings(&self, variant: usize) -> RunDrawings {
        let thumbnails = vec![Thumbnail { frame: "0".to_owned(), image: "data:drawn".to_owned() }];
        RunDrawings { variant, series: self.series.clone(), thumbnails }
    }

    fn measurement(&self, variant: usize) -> Measurement<'_> {
        Measurement {
            scene: 0,
            variant,
            seed: 0,
            segmenter: "graph",
            frames: FRAMES,
            skipped_frames: 0,
            failed_frames: 0,
            segments: 1,
            gaussians: 7,
            parameters: 2_500_000,
            frames_per_second: 125.0,
            frames_per_second_without_segmenter: 333.0,
            stage_ms: &self.stage_ms,
            machine: "a CPU",
            paper: &self.paper,
            strict: &self.strict,
            final_pass: None,
            mesh: None,
        }
    }
}

/// Two variants of one method on two scenes, the second of which could not be measured.
fn benchmark<'a>(runs: &'a [Run; 2]) -> Benchmark<'a> {
    let variant = |changes: &[&str]| Variant {
        method: "fastsam-splat".to_owned(),
        changes: changes.iter().map(|change| (*change).to_owned()).collect(),
    };
    let missing = MissingResult {
        scene: "gone",
        scene_path: "/gone",
        method: "fastsam-splat",
        variant: None,
        seed: 0,
        error: "</script><b>no such file",
    };
    Benchmark {
        scenes: vec!["a|b <i>".to_owned(), "gone".to_owned()],
        variants: vec![variant(&[]), variant(&["memory.max_votes=3"])],
        seeds: vec![0],
        protocol: Protocol::Strict,
        setup: "segmenter graph".to_owned(),
        settings: "seed = 0".to_owned(),
        version: "1.2.3",
        reference: Reference::ScannetMv,
        stages: vec!["segment", "track", "grow", "learn"],
        measurements: vec![runs[0].measurement(0), runs[1].measurement(1)],
        missing: vec![missing],
    }
}

#[test]
fn scores_after_the_final_pass_have_tables_of_their_own() {
    let runs = [Run::new(2), Run::new(0)];
    let mut benchmark = benchmark(&runs);
    assert!(benchmark.of_final_pass().is_none());
    assert!(!markdown_tables(&benchmark).contains("after the final pass"));
    // Only the second variant has one.
    let again = Run::new(1);
    benchmark.measurements[1].final_pass = Some([&again.paper, &again.strict]);
    let tables = markdown_tables(&benchmark);
    let (before, after) = tables.split_once("protocol strict, after the final pass").unwrap();
    assert!(before.contains("| fastsam-splat memory.max_votes=3 (1 of 2 results) | 100.00"), "{before}");
    assert!(after.contains("| fastsam-splat memory.max_votes=3 (1 of 2 results) | 87.50"), "{after}");
    assert!(!after.contains("| fastsam-splat (") && !after.contains("ScanNet-MV"), "{after}");
    let last = &benchmark.of_final_pass().unwrap();
    assert_eq!((last.variants.len(), last.measurements.len(), last.measurements[0].variant), (1, 1, 0));
}

/// A video of this many frames whose only object is predicted `times` times.
fn score(protocol: Protocol, frames: usize, times: u32) -> VideoScore {
    let truth = SegmentMap::from_fn(16, 4, |column, _| u32::from(column < 8));
    let masks: Vec<_> = (1..=times).map(|id| (id, truth.mask_of(1))).collect();
    let mut scorer = VideoScorer::new(ScoreSettings { protocol, ..ScoreSettings::default() });
    for _ in 0..frames {
        scorer.push(&truth, &FramePrediction::Masks(&masks)).unwrap();
    }
    scorer.finish()
}

#[test]
fn scores_that_count_objects_more_than_once_are_marked() {
    let mut runs = [Run::new(0), Run::new(2)];
    runs[1].paper = score(Protocol::Paper, FRAMES, 3);
    runs[1].strict = score(Protocol::Strict, FRAMES, 3);
    let benchmark = Benchmark { protocol: Protocol::Paper, ..benchmark(&runs) };
    let note = "† overlapping masks cover 1 true object more than once.";
    let table = ScoreTable::over_all_scenes(&benchmark, Protocol::Paper);
    assert_eq!(table.notes.len(), 1);
    assert!(table.notes[0].starts_with(note), "{:?}", table.notes);
    assert_eq!(table.rows.iter().map(|row| row.overcounted_tracks).max(), Some(1));
    assert!(ScoreTable::over_all_scenes(&benchmark, Protocol::Strict).notes.is_empty());

    let tables = markdown_tables(&benchmark);
    // STQ and AQ of the second variant; the first has none.
    assert!(tables.contains("| 173.21† | 300.00† | 100.00 |") && tables.contains(note), "{tables}");
    assert!(tables.contains("| 100.00 | 100.00 | 100.00 | 125.00 |"), "{tables}");
    assert!(table.terminal().contains(" 173.21† 300.00†") && table.terminal().contains(note));
    let page = html_page(&benchmark, &PageSelection::new(&benchmark), &[]).unwrap();
    assert!(page.contains("300.00†") && page.contains(note));
    let csv = csv_table(&benchmark);
    let column = csv.lines().next().unwrap().split(',').position(|name| name == "overcounted_tracks").unwrap();
    let cells: Vec<&str> = csv.lines().skip(1).map(|line| line.split(',').nth(column).unwrap()).collect();
    assert_eq!(cells, ["0", "1"]);
    let row = PaperRow {
        table: PaperTable::Methods,
        name: "SAM2".to_owned(),
        published: [None; 8],
        point: None,
        variant: Some(1),
        obstacle: None,
    };
    let document = paper::markdown(&results(Some(&benchmark), None, &[row], &[]));
    assert!(document.contains("300.00†") && document.contains(note), "{document}");
}

#[test]
fn tables_say_why_videos_have_no_windows() {
    let mut runs = [Run::new(0), Run::new(2)];
    for run in &mut runs {
        run.paper = score(Protocol::Paper, 10, 1);
        run.strict = score(Protocol::Strict, 10, 1);
    }
    let benchmark = benchmark(&runs);
    let notes = |protocol| ScoreTable::over_all_scenes(&benchmark, protocol).notes;
    let paper = "no window of 1, 5, 10, 15 frames in a video of 10: under the protocol paper a video needs 16 frames";
    assert_eq!(notes(Protocol::Paper), [paper]);
    assert_eq!(notes(Protocol::Strict), ["no window of 15 frames in a video of 10: the video is too short"]);
}

#[test]
fn names_and_errors_cannot_break_the_page() {
    let runs = [Run::new(0), Run::new(2)];
    let picture = ScenePicture {
        frame: "0".to_owned(),
        image: "data:image".to_owned(),
        ground_truth: Some("data:truth".to_owned()),
    };
    let benchmark = benchmark(&runs);
    let selection = PageSelection::new(&benchmark);
    assert_eq!((&selection.scenes, &selection.open), (&vec![0], &vec![0, 1]));
    let drawings =
        SceneDrawings { scene: 0, pictures: vec![picture], runs: vec![runs[0].drawings(0), runs[1].drawings(1)] };
    let page = html_page(&benchmark, &selection, &[drawings]).unwrap();
    assert!(page.starts_with("<!DOCTYPE html><html lang=\"en\">"));
    assert!(page.contains("<h2>a|b &lt;i&gt;</h2>") && !page.contains("<i>") && !page.contains("<b>no such"));
    assert!(page.contains("seed 0: &lt;/script&gt;&lt;b&gt;no such file"));
    // One script holds data, the other moves the strips.
    assert_eq!((page.matches("<script").count(), page.matches("</script>").count()), (2, 2));
    for image in ["data:image", "data:truth", "data:drawn"] {
        assert!(page.contains(&format!("src=\"{image}\"")), "{image}");
    }
    // VSQ by window length, two scatters; Gaussians and two charts of stages for the scene.
    assert_eq!(page.matches("<svg ").count(), 3 + 3);
    assert!(!page.contains("NaN"));
}

#[test]
fn tables_say_what_is_missing_and_what_is_the_papers() {
    let runs = [Run::new(0), Run::new(2)];
    let benchmark = benchmark(&runs);
    let table = ScoreTable::over_all_scenes(&benchmark, Protocol::Strict);
    assert_eq!((table.title.as_str(), table.rows.len()), ("1 of 2 scenes, protocol strict", 2));
    let vsq = |row: usize| table.rows[row].cells[4].unwrap().mean;
    assert!((vsq(0) - 100.0).abs() < 1e-9 && (vsq(1) - 75.0).abs() < 1e-9, "{} {}", vsq(0), vsq(1));
    assert!(table.terminal().contains("fastsam-splat memory.max_votes=3 (1 of 2 results)"));
    let tables = markdown_tables(&benchmark);
    assert!(
        tables.contains("| fastsam-splat (1 of 2 results) | 100.00 | 100.00 | 100.00 | 100.00 | 100.00 |"),
        "{tables}"
    );
    assert!(tables.contains("| *FastSAM-Splat (paper, ScanNet-MV: other data)* | 48.07 |"), "{tables}");
    assert!(tables.contains("- gone, fastsam-splat, seed 0: </script><b>no such file\n"), "{tables}");
    let csv = csv_table(&benchmark);
    let columns: Vec<usize> = csv.lines().map(|line| line.matches(',').count()).collect();
    assert_eq!((columns.len(), columns[0]), (3, columns[1]));
    assert!(
        csv.lines().nth(2).unwrap().starts_with("a|b <i>,fastsam-splat,memory.max_votes=3,0,graph,strict,75,"),
        "{csv}"
    );
}

#[test]
fn stages_without_time_are_left_out_and_the_segmenter_is_not_in_the_sum() {
    let runs = [Run::new(0), Run::new(2)];
    let table = StageTable::new(&benchmark(&runs));
    assert_eq!(table.columns, ["segment", "grow", "learn", "all but the segmenter"]);
    assert_eq!(table.rows[0], ("fastsam-splat".to_owned(), vec![5.0, 2.0, 1.0, 3.0]));
}

/// Inputs of the paper's tables.
fn results<'a>(
    scannet: Option<&'a Benchmark<'a>>,
    mvpd: Option<&'a Benchmark<'a>>,
    rows: &'a [PaperRow],
    efficiency: &'a [EfficiencyRow],
) -> PaperResults<'a> {
    PaperResults { scannet, mvpd, rows, efficiency, notes: &[], missing: &[] }
}

#[test]
fn rows_of_the_paper_have_a_score_or_a_reason() {
    let runs = [Run::new(0), Run::new(2)];
    let row = |name: &str, variant, obstacle: Option<&str>| PaperRow {
        table: PaperTable::Methods,
        name: name.to_owned(),
        published: [Some(48.07); 8],
        point: None,
        variant,
        obstacle: obstacle.map(str::to_owned),
    };
    let rows = [row("FastSAM-Splat", Some(0), None), row("SAM2", None, Some("needs weights"))];
    let benchmark = benchmark(&runs);
    let (notes, missing) = (["a note".to_owned()], ["an input".to_owned()]);
    let results = PaperResults { notes: &notes, missing: &missing, ..results(Some(&benchmark), None, &rows, &[]) };
    let text = paper::markdown(&results);
    assert!(text.contains("| SAM2 (needs weights) | – | – | – | – | – | – | – | – |\n"), "{text}");
    assert!(text.contains("| *SAM2, the paper* | *48.07* |") && text.contains("| FastSAM-Splat (1 of 2 results) |"));
    assert!(text.contains("- a note\n") && text.ends_with("## What is missing\n\n- an input\n"), "{text}");
    let page = paper_page(&results);
    assert!(page.contains("FastSAM-Splat (1 of 2 results)</th>") && page.contains("FastSAM-Splat, the paper</th>"));
    assert!(page.contains("<li>a note</li>") && page.contains("<li>an input</li>"));
    let csv = paper::csv(&results);
    assert!(csv.starts_with("table,row,origin,column,mean,deviation\n"), "{csv}");
    for line in [
        "Methods on ScanNet-MV,FastSAM-Splat,measured,vsq_15,100,",
        "Methods on ScanNet-MV,SAM2,paper,stq,48.07,",
        "Efficiency,\"Tube-Link, Swin-large\",paper,backbone_parameters_m,197,",
    ] {
        assert!(csv.lines().any(|found| found == line), "{line}\n{csv}");
    }
    assert!(!csv.contains("SAM2,measured"), "{csv}");
}

#[test]
fn mvpd_has_the_rows_of_every_backbone_beside_ours() {
    let runs = [Run::new(0), Run::new(2)];
    let benchmark = Benchmark { reference: Reference::Mvpd, protocol: Protocol::Paper, ..benchmark(&runs) };
    let row = |(name, scores): &(&str, [f64; 5])| PaperRow {
        table: PaperTable::Mvpd,
        name: (*name).to_owned(),
        published: vsq_columns(scores),
        point: None,
        variant: (*name == "FastSAM-Splat").then_some(0),
        obstacle: None,
    };
    let rows: Vec<PaperRow> = MVPD.iter().map(row).collect();
    let text = paper::markdown(&results(None, Some(&benchmark), &rows, &[]));
    let table = &text[text.find("## Methods on MVPd").unwrap()..text.find("## Efficiency").unwrap()];
    assert!(table.contains("|  | k=1 | k=5 | k=10 | k=15 | VSQ |\n"), "{table}");
    assert_eq!(table.matches(", the paper* |").count(), 9, "{table}");
    assert!(table.contains("| *Tube-Link, Swin-large, the paper* | *48.17* | *21.14* | *16.60* | *14.55* | *25.12* |"));
    // The other systems have no measured line.
    assert_eq!(table.matches("| FastSAM-Splat (1 of 2 results) | 100.00 |").count(), 1, "{table}");
    assert!(!table.contains("| OV2Seg"), "{table}");
    // Beside this benchmark's own tables stand MVPd's rows, not ScanNet's.
    let tables = markdown_tables(&benchmark);
    assert!(tables.contains("| *OV2Seg, Swin-base (paper, MVPd)* | 40.22 |"), "{tables}");
    assert!(!tables.contains("ScanNet-MV"), "{tables}");
}

#[test]
fn the_speed_is_over_scenes_and_its_spread_over_seeds() {
    let runs = [Run::new(0), Run::new(2)];
    let mut benchmark = benchmark(&runs);
    let measured = |scene: usize, seed: u64, frames: usize, frames_per_second: f64| Measurement {
        scene,
        seed,
        frames,
        frames_per_second,
        ..runs[0].measurement(0)
    };
    // 100 frames in 10 seconds, then 300 in 3.
    benchmark.measurements = vec![measured(0, 0, 100, 10.0), measured(1, 0, 300, 100.0)];
    let text = |benchmark: &Benchmark| {
        let table = ScoreTable::over_all_scenes(benchmark, Protocol::Strict);
        table.rows[0].speed.unwrap().text()
    };
    assert_eq!(text(&benchmark), "30.77", "there is one seed");
    benchmark.seeds.push(7);
    benchmark.measurements.extend([measured(0, 7, 100, 20.0), measured(1, 7, 300, 60.0), measured(1, 7, 0, 0.0)]);
    // 400 frames in 13 and in 10 seconds.
    assert_eq!(text(&benchmark), "35.38 ± 6.53");
}

#[test]
fn efficiency_is_over_all_videos_and_names_the_machine() {
    let runs = [Run::new(0), Run::new(2)];
    let mut benchmark = benchmark(&runs);
    let mut other = runs[0].measurement(0);
    other.scene = 1;
    other.parameters = 3_500_000;
    other.frames_per_second = 75.0;
    benchmark.measurements.push(other);
    let row = |name: &str, variant, backbone_parameters| EfficiencyRow {
        name: name.to_owned(),
        variant,
        backbone_parameters,
        obstacle: variant.is_none().then(|| "needs weights".to_owned()),
    };
    let rows = [row("FastSAM-Splat", Some(0), Some(72_000_000)), row("FastSAM", None, Some(72_000_000))];
    let text = paper::markdown(&results(Some(&benchmark), None, &[], &rows));
    // As many frames at 125 and at 75 frames per second.
    assert!(text.contains("| FastSAM-Splat | 93.75 | 72.00 | 3.00 | 75.00 |"), "{text}");
    assert!(text.contains("| *FastSAM-Splat, the paper* | *2.84* | *72.00* | *28.00* | *100.00* |"), "{text}");
    assert!(text.contains("| FastSAM (needs weights) | – | – | – | – |"), "{text}");
    assert!(text.contains("| *Video K-Net, ResNet50, the paper* | *40.54* | *26.00* |  | *26.00* |"), "{text}");
    assert!(text.contains("Machine: ours a CPU;"), "{text}");
}

#[test]
fn three_dimensional_scores_have_columns_where_there_are_any() {
    let runs = [Run::new(0), Run::new(2)];
    let mut benchmark = benchmark(&runs);
    let csv_columns = |benchmark: &Benchmark| csv_table(benchmark).lines().next().unwrap().split(',').count();
    let without = csv_columns(&benchmark);
    assert!(!markdown_tables(&benchmark).contains("AP25"));

    // The first variant finds one of two instances.
    let truth: Vec<u32> =
        (0..2 * MIN_INSTANCE_VERTICES).map(|vertex| 1 + (vertex / MIN_INSTANCE_VERTICES) as u32).collect();
    let found = PredictedInstance { confidence: 0.9, vertices: (0..MIN_INSTANCE_VERTICES).collect() };
    let mut scorer = InstanceScorer::default();
    scorer.add_scene(&truth, &[found]).unwrap();
    benchmark.measurements[0].mesh = Some(&scorer);
    assert_eq!(csv_columns(&benchmark), without + 3);
    let ap = scorer.scores().ap.unwrap();
    let tables = markdown_tables(&benchmark);
    assert!(tables.contains("| SQ | AP | AP50 | AP25 | frames/s |"), "{tables}");
    assert!(tables.contains(&format!("| {ap:.2} | {ap:.2} | {ap:.2} | 125.00 |")), "{tables}");
    assert!(tables.contains(" | – | – | – | 125.00 |"), "{tables}");
    assert!(
        tables.contains(
            "| *ESAM-E (ScanNet200, its paper)* | – | – | – | – | – | – | – | – | 43.40 | 65.40 | 80.90 | – |"
        )
    );
    let table = ScoreTable::over_all_scenes(&benchmark, Protocol::Strict);
    assert!(table.terminal().contains("    AP50"), "{}", table.terminal());
    let page = html_page(&benchmark, &PageSelection::new(&benchmark), &[]).unwrap();
    assert!(page.contains(">AP25</th>") && page.contains("colspan=\"13\""));
}
