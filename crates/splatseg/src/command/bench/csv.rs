//! `results.csv`: the rows for spreadsheets.

use super::rows::Row;
use crate::command::score_table::{COLUMN_KEYS, SIZE_COLUMN_KEYS, columns, size_columns};
use splatseg_metrics::{Scores, SizeClass};

/// The rows with a line of column names above.
pub fn table(rows: &[Row]) -> String {
    let other = rows.iter().find_map(|row| row.other_protocol.keys().next()).copied().unwrap_or("other");
    let mut header: Vec<String> =
        ["scene", "method", "variant", "seed", "segmenter", "protocol"].map(str::to_owned).to_vec();
    header.extend(COLUMN_KEYS.map(str::to_owned));
    header.extend(COLUMN_KEYS.map(|key| format!("{other}_{key}")));
    header.extend(
        ["fps_total", "fps_without_segmenter", "frames", "skipped_frames", "failed_frames", "segments", "gaussians"]
            .map(str::to_owned),
    );
    header.push("parameters".to_owned());
    header.extend(SizeClass::ALL.into_iter().flat_map(|class| {
        let key = move |key: &str| format!("{}_{key}", class.name());
        std::iter::once(key("objects")).chain(SIZE_COLUMN_KEYS.map(key))
    }));
    let mut text = header.join(",");
    text.push('\n');
    for row in rows {
        text.push_str(&cells(row).join(","));
        text.push('\n');
    }
    text
}

fn cells(row: &Row) -> Vec<String> {
    let scores =
        |scores: &Scores| columns(scores).map(|value| value.map_or_else(String::new, |value| value.to_string()));
    let mut cells = vec![
        quoted(row.scene),
        quoted(row.method),
        quoted(row.variant.as_deref().unwrap_or_default()),
        row.seed.to_string(),
        quoted(row.segmenter),
        quoted(row.protocol),
    ];
    cells.extend(scores(&row.scores));
    cells.extend(row.other_protocol.values().flat_map(scores));
    cells.extend([row.fps.total, row.fps.without_segmenter].map(|rate| rate.to_string()));
    let counts = [row.frames, row.skipped_frames, row.failed_frames, row.segments, row.gaussians, row.parameters];
    cells.extend(counts.map(|count| count.to_string()));
    for class in SizeClass::ALL {
        let sizes = row.scores.by_size.get(&class);
        cells.push(sizes.map_or(0, |sizes| sizes.objects).to_string());
        let columns = sizes.map(size_columns).unwrap_or_default();
        cells.extend(columns.map(|value| value.map_or_else(String::new, |value| value.to_string())));
    }
    cells
}

/// A cell as RFC 4180 wants it.
fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}

#[cfg(test)]
mod tests {
    #[test]
    fn cells_with_commas_are_quoted() {
        assert_eq!(super::quoted("synthetic:frames=3,seed=1"), "\"synthetic:frames=3,seed=1\"");
        assert_eq!(super::quoted("a\"b"), "\"a\"\"b\"");
        assert_eq!(super::quoted("dev-a"), "dev-a");
    }
}
