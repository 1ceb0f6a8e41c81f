//! `results.csv`: one line per measurement, for spreadsheets.

use crate::columns::{COLUMN_KEYS, FRAME_COLUMN_KEYS, MESH_COLUMN_KEYS, SIZE_COLUMN_KEYS};
use crate::columns::{columns, frame_columns, mesh_columns, size_columns};
use crate::{Benchmark, Measurement};
use splatseg_files::csv_cell;
use splatseg_metrics::{Scores, SizeClass};

/// The measurements, below a line of column names.
pub fn csv_table(benchmark: &Benchmark) -> String {
    let mut text = header(benchmark).join(",");
    text.push('\n');
    for measurement in &benchmark.measurements {
        text.push_str(&cells(benchmark, measurement).join(","));
        text.push('\n');
    }
    text
}

/// True if any result has 3D scores; otherwise their columns are omitted.
fn has_mesh(benchmark: &Benchmark) -> bool {
    benchmark.measurements.iter().any(|measurement| measurement.mesh.is_some())
}

fn header(benchmark: &Benchmark) -> Vec<String> {
    let other = benchmark.other_protocol().name();
    let mut header: Vec<String> =
        ["scene", "method", "variant", "seed", "segmenter", "protocol"].map(str::to_owned).to_vec();
    header.extend(COLUMN_KEYS.map(str::to_owned));
    header.extend(COLUMN_KEYS.map(|key| format!("{other}_{key}")));
    header.push("overcounted_tracks".to_owned());
    if has_mesh(benchmark) {
        header.extend(MESH_COLUMN_KEYS.map(str::to_owned));
    }
    let counts = ["frames", "skipped_frames", "failed_frames", "segments", "gaussians", "parameters"];
    header.extend(["fps_total", "fps_without_segmenter"].into_iter().chain(counts).map(str::to_owned));
    header.extend(SizeClass::ALL.into_iter().flat_map(|class| {
        let key = move |key: &str| format!("{}_{key}", class.name());
        std::iter::once(key("objects")).chain(SIZE_COLUMN_KEYS.map(key))
    }));
    header.extend(FRAME_COLUMN_KEYS.map(str::to_owned));
    header
}

fn cells(benchmark: &Benchmark, measurement: &Measurement) -> Vec<String> {
    let number = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
    let variant = &benchmark.variants[measurement.variant];
    let scores = measurement.score(benchmark.protocol).scores();
    let other: Scores = measurement.score(benchmark.other_protocol()).scores();
    let mut cells = vec![
        csv_cell(&benchmark.scenes[measurement.scene]),
        csv_cell(&variant.method),
        csv_cell(&variant.change().unwrap_or_default()),
        measurement.seed.to_string(),
        csv_cell(measurement.segmenter),
        csv_cell(benchmark.protocol.name()),
    ];
    cells.extend([&scores, &other].into_iter().flat_map(columns).map(number));
    cells.push(scores.overcounted_tracks.to_string());
    if has_mesh(benchmark) {
        let mesh = measurement.mesh.map(|scorer| mesh_columns(&scorer.scores())).unwrap_or_default();
        cells.extend(mesh.map(number));
    }
    let speeds = [measurement.frames_per_second, measurement.frames_per_second_without_segmenter];
    cells.extend(speeds.map(|speed| speed.to_string()));
    let counts = [
        measurement.frames,
        measurement.skipped_frames,
        measurement.failed_frames,
        measurement.segments,
        measurement.gaussians,
        measurement.parameters,
    ];
    cells.extend(counts.map(|count| count.to_string()));
    for class in SizeClass::ALL {
        let sizes = scores.by_size.get(&class);
        cells.push(sizes.map_or(0, |sizes| sizes.objects).to_string());
        cells.extend(sizes.map(size_columns).unwrap_or_default().map(number));
    }
    cells.extend(frame_columns(&scores.single_frames).map(number));
    cells
}
