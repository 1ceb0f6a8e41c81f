//! The list of objects as a table.

use crate::{FrameStamp, Object, ObjectList, ObjectState};
use splatseg_files::csv_cell;
use std::fmt::Display;

/// The columns; `docs/OBJECTS.md` describes them.
const COLUMNS: [&str; 49] = [
    "id",
    "label",
    "state",
    "frames",
    "confidence",
    "first_frame",
    "first_name",
    "first_time_s",
    "last_frame",
    "last_name",
    "last_time_s",
    "red",
    "green",
    "blue",
    "centroid_x",
    "centroid_y",
    "centroid_z",
    "min_x",
    "min_y",
    "min_z",
    "max_x",
    "max_y",
    "max_z",
    "center_x",
    "center_y",
    "center_z",
    "size_x",
    "size_y",
    "size_z",
    "rotation_x",
    "rotation_y",
    "rotation_z",
    "rotation_w",
    "area_m2",
    "points",
    "stray_points",
    "best_frame",
    "best_name",
    "best_x",
    "best_y",
    "best_width",
    "best_height",
    "crop",
    "completed_points",
    "label_score",
    "label_alternatives",
    "room",
    "first_seen_s",
    "last_seen_s",
];

impl ObjectList {
    /// The objects that count as comma-separated values (RFC 4180), with a header line. Unknown values are empty.
    pub fn to_csv(&self) -> String {
        let mut text = COLUMNS.join(",") + "\n";
        for object in &self.objects {
            text += &cells_of(object).join(",");
            text.push('\n');
        }
        text
    }
}

fn cells_of(object: &Object) -> Vec<String> {
    let state = object.state.map(|state| match state {
        ObjectState::Remembered => "remembered",
        ObjectState::Tentative => "tentative",
        ObjectState::Forgotten => "forgotten",
    });
    let mut cells = vec![object.id.to_string(), cell(object.label.as_deref().map(csv_cell)), cell(state)];
    cells.extend([object.frames.to_string(), cell(object.confidence)]);
    for frame in [&object.first_frame, &object.last_frame] {
        cells.extend(frame_cells(frame.as_ref()));
        cells.push(cell(frame.as_ref().and_then(|frame| frame.time_s)));
    }
    cells.extend((0..3).map(|channel| cell(object.color.map(|color| color[channel]))));
    let shape = object.shape.as_ref();
    cells.extend(vector_cells(shape.map(|shape| shape.centroid.to_array())));
    cells.extend(vector_cells(shape.map(|shape| shape.axis_aligned_box.min.to_array())));
    cells.extend(vector_cells(shape.map(|shape| shape.axis_aligned_box.max.to_array())));
    cells.extend(vector_cells(shape.map(|shape| shape.oriented_box.center.to_array())));
    cells.extend(vector_cells(shape.map(|shape| shape.oriented_box.size.to_array())));
    let rotation = shape.map(|shape| shape.oriented_box.rotation.to_array());
    cells.extend((0..4).map(|part| cell(rotation.map(|rotation| rotation[part]))));
    cells.push(cell(shape.map(|shape| shape.area_m2)));
    cells.push(cell(shape.map(|shape| shape.points)));
    cells.push(cell(shape.map(|shape| shape.stray_points)));
    let view = object.best_view.as_ref();
    cells.extend(frame_cells(view.map(|view| &view.frame)));
    let inner = view.map(|view| view.bounding_box);
    cells.extend([inner.map(|inner| inner.x), inner.map(|inner| inner.y)].map(cell));
    cells.extend([inner.map(|inner| inner.width), inner.map(|inner| inner.height)].map(cell));
    cells.push(cell(view.and_then(|view| view.crop.as_deref()).map(csv_cell)));
    cells.push(cell(shape.map(|shape| shape.completed_points)));
    cells.push(cell(object.label_score));
    let alternatives: Vec<&str> = object.label_alternatives.iter().map(|other| other.label.as_str()).collect();
    cells.push(csv_cell(&alternatives.join("; ")));
    cells.push(cell(object.room));
    cells.extend([object.first_seen_s, object.last_seen_s].map(cell));
    cells
}

/// Number and name of a frame.
fn frame_cells(frame: Option<&FrameStamp>) -> [String; 2] {
    [cell(frame.map(|frame| frame.number)), cell(frame.and_then(|frame| frame.name.as_deref()).map(csv_cell))]
}

fn vector_cells<T: Copy + Display>(vector: Option<[T; 3]>) -> [String; 3] {
    std::array::from_fn(|axis| cell(vector.map(|vector| vector[axis])))
}

fn cell(value: Option<impl Display>) -> String {
    value.map(|value| value.to_string()).unwrap_or_default()
}
