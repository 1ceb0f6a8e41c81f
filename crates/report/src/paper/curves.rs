//! The paper's ablations as curves: rows that differ in one number.

use super::{PaperRow, TableRow};
use crate::Origin;
use crate::columns::{STQ, VSQ};

/// Position of a row in its table's curves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CurvePoint {
    /// Quantity that varies along the curve, e.g. `clicks, prompted with detections`.
    pub curve: &'static str,
    /// The row's value of that quantity.
    pub value: usize,
}

/// VSQ and STQ as functions of a number.
#[derive(Clone, Debug, PartialEq)]
pub struct PaperCurve {
    /// The title.
    pub title: String,
    /// Name of the number on the horizontal axis.
    pub x_label: &'static str,
    /// Its points, in the order of the table.
    pub rows: Vec<CurveRow>,
}

/// A point of a curve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CurveRow {
    /// Its value of the number.
    pub value: usize,
    /// VSQ and STQ as measured, percent; `None` where nothing was measured.
    pub measured: [Option<f64>; 2],
    /// VSQ and STQ from the paper, percent.
    pub published: [Option<f64>; 2],
}

/// The curves of a table with these lines. All lines must have the columns VSQ and STQ.
pub(super) fn curves(rows: &[&PaperRow], lines: &[TableRow]) -> Vec<PaperCurve> {
    let mut curves: Vec<PaperCurve> = Vec::new();
    for row in rows {
        let Some(point) = row.point else { continue };
        let of = |origin: Origin| {
            let line = lines.iter().find(|line| line.origin == origin && line.name == row.name);
            [VSQ, STQ].map(|column| line?.cells.get(column)?.value.map(|value| value.mean))
        };
        let added = CurveRow { value: point.value, measured: of(Origin::Measured), published: of(Origin::Paper) };
        match curves.iter_mut().find(|curve| curve.x_label == point.curve) {
            Some(curve) => curve.rows.push(added),
            None => {
                let title = format!("VSQ and STQ by {}", point.curve);
                curves.push(PaperCurve { title, x_label: point.curve, rows: vec![added] });
            }
        }
    }
    curves
}
