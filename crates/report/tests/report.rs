//! Tables and page of a small benchmark made up here.

use splatseg_geometry::SegmentMap;
use splatseg_metrics::{FramePrediction, Protocol, ScoreSettings, VideoScore, VideoScorer};
use splatseg_report::paper::{PaperRow, PaperTable};
use splatseg_report::{Benchmark, Measurement, MissingResult, ScenePicture, ScoreTable, Series, StageTable};
use splatseg_report::{Thumbnail, Variant, csv_table, html_page, markdown_tables, paper};
use std::collections::BTreeMap;
use std::time::Duration;

const FRAMES: usize = 16;

/// What was measured, apart from the scene and the method.
struct Run {
    paper: VideoScore,
    strict: VideoScore,
    stage_ms: BTreeMap<String, f64>,
    series: Series,
    thumbnails: Vec<Thumbnail>,
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
        let thumbnails = vec![Thumbnail { frame: "0".to_owned(), image: "data:drawn".to_owned() }];
        Self { paper: score(Protocol::Paper), strict: score(Protocol::Strict), stage_ms, series, thumbnails }
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
            paper: &self.paper,
            strict: &self.strict,
            series: &self.series,
            thumbnails: &self.thumbnails,
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
        measurements: vec![runs[0].measurement(0), runs[1].measurement(1)],
        missing: vec![missing],
    }
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
    let page = html_page(&benchmark, &[Vec::new(), Vec::new()], &["row"]).unwrap();
    assert!(page.contains("300.00†") && page.contains(note));
    let csv = csv_table(&benchmark);
    let column = csv.lines().next().unwrap().split(',').position(|name| name == "overcounted_tracks").unwrap();
    let cells: Vec<&str> = csv.lines().skip(1).map(|line| line.split(',').nth(column).unwrap()).collect();
    assert_eq!(cells, ["0", "1"]);
    let row = PaperRow {
        table: PaperTable::Methods,
        name: "SAM2".to_owned(),
        published: [None; 8],
        variant: Some(1),
        obstacle: None,
    };
    let document = paper::document(&benchmark, &[row], &[], &[]);
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
    assert_eq!(notes(Protocol::Strict), ["no window of 15 frames in a video of 10: a video needs as many frames"]);
}

#[test]
fn names_and_errors_cannot_break_the_page() {
    let runs = [Run::new(0), Run::new(2)];
    let picture = ScenePicture {
        frame: "0".to_owned(),
        image: "data:image".to_owned(),
        ground_truth: Some("data:truth".to_owned()),
    };
    let page = html_page(&benchmark(&runs), &[vec![picture], Vec::new()], &["row"]).unwrap();
    assert!(page.starts_with("<!DOCTYPE html><html lang=\"en\">"));
    assert!(page.contains("<h2>a|b &lt;i&gt;</h2>") && !page.contains("<i>") && !page.contains("<b>no such"));
    assert!(page.contains("seed 0: &lt;/script&gt;&lt;b&gt;no such file"));
    // One script holds data, the other moves the strips.
    assert_eq!((page.matches("<script").count(), page.matches("</script>").count()), (2, 2));
    for image in ["data:image", "data:truth", "data:drawn"] {
        assert!(page.contains(&format!("src=\"{image}\"")), "{image}");
    }
    // VSQ by window length, the ablation, two scatters; Gaussians and two charts of stages for the scene.
    assert_eq!(page.matches("<svg ").count(), 4 + 3);
    assert!(page.contains("<figcaption>fastsam-splat by memory.max_votes</figcaption>"));
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

#[test]
fn rows_of_the_paper_have_a_score_or_a_reason() {
    let runs = [Run::new(0), Run::new(2)];
    let row = |name: &str, variant, obstacle: Option<&str>| PaperRow {
        table: PaperTable::Methods,
        name: name.to_owned(),
        published: [Some(48.07); 8],
        variant,
        obstacle: obstacle.map(str::to_owned),
    };
    let rows = [row("FastSAM-Splat", Some(0), None), row("SAM2", None, Some("needs weights"))];
    let text = paper::document(&benchmark(&runs), &rows, &["a note".to_owned()], &["an input".to_owned()]);
    assert!(text.contains("| SAM2 (needs weights) | – | – | – | – | – | – | – | – |\n"), "{text}");
    assert!(text.contains("| *SAM2, the paper* | *48.07* |") && text.contains("| FastSAM-Splat (1 of 2 results) |"));
    assert!(text.contains("| FastSAM-Splat | 125.00 | *2.84* | 2.50 | *28.00* |"), "{text}");
    assert!(text.contains("- a note\n") && text.ends_with("## What is missing\n\n- an input\n"), "{text}");
}
