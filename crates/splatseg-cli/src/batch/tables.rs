//! Tables of a batch over all of its scenes.

use super::plan::Plan;
use super::row::Row;
use crate::Failure;
use parquet::column::writer::ColumnWriter;
use parquet::data_type::ByteArray;
use parquet::errors::ParquetError;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::parser::parse_message_type;
use serde::{Deserialize, Serialize};
use splatseg_metrics::{DatasetScore, Scores};
use splatseg_output::write_atomically;
use std::path::Path;
use std::sync::Arc;

/// Name of the table with a row per scene.
pub const RESULTS: &str = "results.parquet";
/// Name of the file with the scores over all scenes with ground truth.
pub const SCORES: &str = "scores.json";
/// Name of the list of failed scenes.
pub const FAILED: &str = "failed.csv";

/// A scene that failed.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct FailedScene {
    /// The scene as given on the command line or in a list.
    pub scene: String,
    /// Error message.
    pub error: String,
}

/// Content of `scores.json`. Its keys are part of the interface.
#[derive(Serialize)]
struct ScoresFile<'a> {
    /// Number of videos with ground truth.
    videos: u64,
    /// Scores over all of these videos: tracks, tubes and pixels are summed.
    #[serde(flatten)]
    scores: Scores,
    protocol: &'static str,
    /// The counts behind the scores.
    sum: &'a DatasetScore,
}

/// Writes all tables.
///
/// # Errors
/// If one cannot be written.
pub fn write(out: &Path, plan: &Plan, failed: &[FailedScene]) -> Result<(), Failure> {
    let is_failed = |scene: &str| failed.iter().any(|failed| failed.scene == scene);
    let jobs = plan.scenes.iter().filter(|job| !is_failed(&job.scene));
    let missing = |scene: &str| Failure::runtime(format!("{scene}: has neither a row nor an error"));
    let rows: Vec<Row> = jobs.map(|job| job.done_row().ok_or_else(|| missing(&job.scene))).collect::<Result<_, _>>()?;
    let table = parquet(&rows).map_err(|error| Failure::runtime(format!("{RESULTS}: {error}")))?;
    write_atomically(&out.join(RESULTS), &table).map_err(Failure::runtime)?;
    write_atomically(&out.join(FAILED), csv(failed).as_bytes()).map_err(Failure::runtime)?;
    write_scores(out, &rows)
}

fn write_scores(out: &Path, rows: &[Row]) -> Result<(), Failure> {
    let mut scores = rows.iter().filter_map(|row| row.score.as_ref()).peekable();
    let Some(first) = scores.peek() else { return Ok(()) };
    let settings = *first.settings();
    let mut sum = DatasetScore::new(settings);
    scores.try_for_each(|score| sum.add(score)).map_err(Failure::runtime)?;
    let protocol = settings.protocol.name();
    let file = ScoresFile { videos: sum.videos(), scores: sum.total(), protocol, sum: &sum };
    let text = serde_json::to_vec_pretty(&file).map_err(Failure::runtime)?;
    write_atomically(&out.join(SCORES), &text).map_err(Failure::runtime)
}

fn csv(failed: &[FailedScene]) -> String {
    let quoted = |text: &str| format!("\"{}\"", text.replace('"', "\"\""));
    let line = |failed: &FailedScene| format!("{},{}\n", quoted(&failed.scene), quoted(&failed.error));
    std::iter::once("scene,error\n".to_owned()).chain(failed.iter().map(line)).collect()
}

/// The values of a column.
enum Column {
    Text(Vec<String>),
    Whole(Vec<usize>),
    Number(Vec<Option<f64>>),
}

fn columns(rows: &[Row]) -> Vec<(&'static str, Column)> {
    let text = |value: fn(&Row) -> &String| Column::Text(rows.iter().map(|row| value(row).clone()).collect());
    let whole = |value: fn(&Row) -> usize| Column::Whole(rows.iter().map(value).collect());
    let number = |value: fn(&Row) -> Option<f64>| Column::Number(rows.iter().map(value).collect());
    let score = |value: fn(&Scores) -> Option<f64>| {
        Column::Number(rows.iter().map(|row| row.score.as_ref().and_then(|score| value(&score.scores()))).collect())
    };
    vec![
        ("scene", text(|row| &row.scene)),
        ("out", text(|row| &row.out)),
        ("frames", whole(|row| row.frames)),
        ("skipped_frames", whole(|row| row.skipped_frames)),
        ("segments", whole(|row| row.segments)),
        ("gaussians", whole(|row| row.gaussians)),
        ("peak_memory_mb", number(|row| row.peak_memory_mb)),
        ("seconds", number(|row| Some(row.seconds))),
        ("frames_per_second", number(|row| Some(row.frames as f64 / row.seconds.max(1e-9)))),
        ("vsq", score(|scores| scores.vsq)),
        ("stq", score(|scores| scores.stq)),
        ("aq", score(|scores| scores.aq)),
        ("sq", score(|scores| scores.sq)),
    ]
}

/// Encodes the rows as a Parquet file.
fn parquet(rows: &[Row]) -> Result<Vec<u8>, ParquetError> {
    let columns = columns(rows);
    let field = |(name, column): &(&str, Column)| match column {
        Column::Text(_) => format!("REQUIRED BINARY {name} (UTF8);"),
        Column::Whole(_) => format!("REQUIRED INT64 {name};"),
        Column::Number(_) => format!("OPTIONAL DOUBLE {name};"),
    };
    let schema = format!("message results {{ {} }}", columns.iter().map(field).collect::<Vec<_>>().join(" "));
    let schema = Arc::new(parse_message_type(&schema)?);
    let mut bytes = Vec::new();
    let mut file = SerializedFileWriter::new(&mut bytes, schema, Arc::new(WriterProperties::builder().build()))?;
    let mut group = file.next_row_group()?;
    for (_, column) in &columns {
        let Some(mut writer) = group.next_column()? else { break };
        match (writer.untyped(), column) {
            (ColumnWriter::ByteArrayColumnWriter(writer), Column::Text(values)) => {
                let values: Vec<ByteArray> = values.iter().map(|value| ByteArray::from(value.as_str())).collect();
                writer.write_batch(&values, None, None)?;
            }
            (ColumnWriter::Int64ColumnWriter(writer), Column::Whole(values)) => {
                let values: Vec<i64> = values.iter().map(|value| *value as i64).collect();
                writer.write_batch(&values, None, None)?;
            }
            (ColumnWriter::DoubleColumnWriter(writer), Column::Number(values)) => {
                let known: Vec<f64> = values.iter().flatten().copied().collect();
                let levels: Vec<i16> = values.iter().map(|value| i16::from(value.is_some())).collect();
                writer.write_batch(&known, Some(&levels), None)?;
            }
            _ => return Err(ParquetError::General("a column has another type than its schema".to_owned())),
        }
        writer.close()?;
    }
    group.close()?;
    file.close()?;
    Ok(bytes)
}
