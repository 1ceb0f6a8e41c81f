//! The columns of the tables of scores, and tables of one video's scores for a terminal.

use splatseg_metrics::{InstanceScores, Protocol, Scores, SingleFrameScores, SizeClass, SizeScores};
use splatseg_metrics::{VideoScore, WindowLength};

/// The columns, in the order of the paper's tables.
pub(crate) const COLUMNS: [&str; 8] = ["k=1", "k=5", "k=10", "k=15", "VSQ", "STQ", "AQ", "SQ"];

/// Index of VSQ in [`COLUMNS`].
pub(crate) const VSQ: usize = 4;

/// Index of STQ in [`COLUMNS`].
pub(crate) const STQ: usize = 5;

/// Marks scores that count some true tracks more than once.
pub(crate) const OVERCOUNT_MARK: &str = "†";

/// Indices of the columns with such scores.
pub(crate) const OVERCOUNTED: [usize; 2] = [STQ, 6];

/// Explains `OVERCOUNT_MARK`; `None` if no score has it.
pub fn overcount_note(overcounted_tracks: u64) -> Option<String> {
    let objects = match overcounted_tracks {
        0 => return None,
        1 => "1 true object".to_owned(),
        several => format!("{several} true objects"),
    };
    Some(format!(
        "{OVERCOUNT_MARK} overlapping masks cover {objects} more than once. Under the protocol paper, AQ and with it STQ \
         count each of these masks in full, as the paper's code does, and can exceed 100."
    ))
}

/// Names the window lengths for which a video is too short, so that it has no score.
pub fn windows_note<'s>(scores: impl IntoIterator<Item = &'s VideoScore>) -> Option<String> {
    let mut notes: Vec<String> = Vec::new();
    for score in scores {
        let (protocol, frames) = (score.settings().protocol, score.counts().frames);
        let windows = score.counts().vsq_k.iter();
        let without: Vec<WindowLength> =
            windows.filter(|(_, counts)| counts.windows == 0).map(|(length, _)| *length).collect();
        let Some(shortest) = without.first() else { continue };
        let lengths = without.iter().map(|length| length.frames().to_string()).collect::<Vec<_>>().join(", ");
        let needed = match protocol {
            Protocol::Paper => {
                format!("under the protocol paper a video needs {} frames", shortest.least_frames(protocol))
            }
            Protocol::Strict => "the video is too short".to_owned(),
        };
        let note = format!("no window of {lengths} frames in a video of {frames}: {needed}");
        if !notes.contains(&note) {
            notes.push(note);
        }
    }
    (!notes.is_empty()).then(|| notes.join("; "))
}

/// The same columns as keys of CSV files, named after the JSON keys.
pub(crate) const COLUMN_KEYS: [&str; 8] = ["vsq_1", "vsq_5", "vsq_10", "vsq_15", "vsq", "stq", "aq", "sq"];

/// Scores in the order of [`COLUMNS`], percent; `None` where there is nothing to divide by.
pub(crate) fn columns(scores: &Scores) -> [Option<f64>; 8] {
    let mut columns = [None; 8];
    for (column, quality) in columns.iter_mut().zip(scores.vsq_k.values()) {
        *column = *quality;
    }
    columns[VSQ..].copy_from_slice(&[scores.vsq, scores.stq, scores.aq, scores.sq]);
    columns
}

/// The columns of 3D scores, of instances on the vertices of meshes.
pub(crate) const MESH_COLUMNS: [&str; 3] = ["AP", "AP50", "AP25"];

/// The same columns as keys of CSV files.
pub(crate) const MESH_COLUMN_KEYS: [&str; 3] = ["ap", "ap50", "ap25"];

/// 3D scores in the order of [`MESH_COLUMNS`], percent; `None` where there are no true instances.
pub(crate) fn mesh_columns(scores: &InstanceScores) -> [Option<f64>; 3] {
    [scores.ap, scores.ap50, scores.ap25]
}

/// The columns of tables by object size, after the number of objects.
pub(crate) const SIZE_COLUMNS: [&str; 4] = ["AQ", "found", "ids per object", "main id"];

/// The same columns as keys of CSV files, named after the JSON keys.
pub(crate) const SIZE_COLUMN_KEYS: [&str; 4] = ["aq", "found", "ids_per_object", "main_id"];

/// Explanation of the columns of tables by object size.
pub const SIZE_COLUMNS_EXPLAINED: &str = "An object's size is its mean area over the frames that show it. Its id in a \
    frame is the predicted id that covers more than half of its pixels, even if that id belongs to a larger neighbour. \
    AQ: as in STQ, over these objects only. Found: objects that have an id in at least one frame, percent. Ids per \
    object: number of different ids of a found object over the video; 1 is best. Main id: frames in which an \
    object has its most frequent id, percent of the frames that show it.";

/// Scores of a size in the order of [`SIZE_COLUMNS`]; `None` where there is nothing to divide by.
pub(crate) fn size_columns(scores: &SizeScores) -> [Option<f64>; 4] {
    [scores.aq, scores.found, scores.ids_per_object, scores.main_id]
}

/// The columns of tables of single frames.
pub(crate) const FRAME_COLUMNS: [&str; 11] = [
    "k=1, all frames",
    "AP",
    "AP50",
    "AR@100",
    "AR small",
    "AR medium",
    "AR large",
    "boundary F",
    "over",
    "under",
    "segments",
];

/// The same columns as keys of CSV files.
pub(crate) const FRAME_COLUMN_KEYS: [&str; 11] = [
    "frames_quality",
    "frames_ap",
    "frames_ap50",
    "frames_ar",
    "frames_ar_small",
    "frames_ar_medium",
    "frames_ar_large",
    "frames_boundary_f",
    "frames_over_segmentation",
    "frames_under_segmentation",
    "frames_segments",
];

/// Explanation of the columns of single-frame tables.
pub const FRAME_COLUMNS_EXPLAINED: &str = "Ids do not matter here. k=1: VSQ of protocol paper at k = 1, over all frames \
    instead of every fifteenth. AP, AP50, AR@100: COCO's average precision and recall of masks, with one class; sizes are \
    the object's area in the frame: small under 400 px, large over 4000 px. Boundary F: F-score of pixels between \
    segments, which may be 2 px off. Over and under: pixels outside the largest part of their object, and of their \
    segment, percent; less is better. Segments: their mean number in a frame.";

/// Scores of single frames in the order of [`FRAME_COLUMNS`]; `None` where there is nothing to divide by.
pub(crate) fn frame_columns(scores: &SingleFrameScores) -> [Option<f64>; 11] {
    let recall = |class| scores.ar_by_size.get(&class).copied().flatten();
    [
        scores.quality,
        scores.ap,
        scores.ap50,
        scores.ar,
        recall(SizeClass::Small),
        recall(SizeClass::Medium),
        recall(SizeClass::Large),
        scores.boundary_f,
        scores.over_segmentation,
        scores.under_segmentation,
        scores.segments_per_frame,
    ]
}

/// Two lines for a terminal: the names of the columns of single frames and one row of scores.
pub fn terminal_frame_table(scores: &SingleFrameScores) -> String {
    let cells = frame_columns(scores).map(terminal_cell);
    let line = |cells: &[&str]| -> String {
        cells.iter().zip(FRAME_COLUMNS).map(|(cell, name)| format!("{cell:>width$}", width = name.len() + 2)).collect()
    };
    format!("single frames\n{}\n{}", line(&FRAME_COLUMNS), line(&cells.each_ref().map(String::as_str)))
}

/// Two lines for a terminal: the names of the columns and one row of scores.
pub fn terminal_table(scores: &Scores) -> String {
    let line = |cells: Vec<String>| cells.iter().map(|cell| format!("{cell:>8}")).collect::<String>();
    let names = COLUMNS.iter().map(|name| (*name).to_owned()).collect();
    let cells = (0..).zip(columns(scores)).map(|(column, value)| {
        format!("{}{}", terminal_cell(value), overcount_mark(column, scores.overcounted_tracks))
    });
    format!("{}\n{}", line(names), line(cells.collect()))
}

/// The mark of a column's score.
pub(crate) fn overcount_mark(column: usize, overcounted_tracks: u64) -> &'static str {
    if overcounted_tracks > 0 && OVERCOUNTED.contains(&column) { OVERCOUNT_MARK } else { "" }
}

/// Lines for a terminal: a row of scores for each object size.
pub fn terminal_size_table(scores: &Scores) -> String {
    let width = scores.by_size.keys().map(|class| class.label().len()).max().unwrap_or(0);
    let mut text = format!("{:width$}{:>9}", "", "objects");
    text.extend(SIZE_COLUMNS.map(|name| format!("{name:>16}")));
    for (class, sizes) in &scores.by_size {
        text.push_str(&format!("\n{:width$}{:>9}", class.label(), sizes.objects));
        text.extend(size_columns(sizes).map(|value| format!("{:>16}", terminal_cell(value))));
    }
    text
}

/// Formats a number for a terminal.
pub(crate) fn terminal_cell(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |value| format!("{value:.2}"))
}
