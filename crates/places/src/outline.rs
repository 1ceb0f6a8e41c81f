//! The outline of a set of cells.

use crate::grid::GridShape;
use glam::DVec2;
use std::collections::{BTreeMap, BTreeSet};

/// Returns the outlines of a set of cells, in the plan's coordinates: counter-clockwise around each connected part, and
/// clockwise around each hole. Corners that lie within a cell of the line between others are left out.
pub(crate) fn outlines(shape: &GridShape, cells: &BTreeSet<usize>) -> Vec<Vec<DVec2>> {
    // Edges from corner to corner, with the cells to their left.
    let mut edges: BTreeMap<[i64; 2], Vec<[i64; 2]>> = BTreeMap::new();
    for cell in cells {
        let (column, row) = shape.column_row(*cell);
        let [x, y] = [column, row].map(|index| index as i64);
        let corners = [[x, y], [x + 1, y], [x + 1, y + 1], [x, y + 1]];
        let has = |column: i64, row: i64| {
            let is_inside = column >= 0 && row >= 0 && column < shape.width as i64 && row < shape.height as i64;
            is_inside && cells.contains(&(row as usize * shape.width + column as usize))
        };
        let neighbours = [has(x, y - 1), has(x + 1, y), has(x, y + 1), has(x - 1, y)];
        for side in (0..4).filter(|side| !neighbours[*side]) {
            edges.entry(corners[side]).or_default().push(corners[(side + 1) % 4]);
        }
    }
    let mut outlines = Vec::new();
    while let Some((start, _)) = edges.first_key_value() {
        let start = *start;
        let mut outline = Vec::new();
        let mut from = start;
        let mut heading = [1, 0];
        while let Some(to) = next(&mut edges, from, heading) {
            heading = [to[0] - from[0], to[1] - from[1]];
            outline.push(from);
            from = to;
            if from == start {
                break;
            }
        }
        let place =
            |corner: &[i64; 2]| shape.origin + DVec2::new(corner[0] as f64, corner[1] as f64) * shape.resolution;
        let places: Vec<DVec2> = outline.iter().map(place).collect();
        outlines.push(simplified(&places, shape.resolution));
    }
    outlines
}

/// Takes the edge from a corner that turns left most, so that parts that touch at a corner only stay apart.
fn next(edges: &mut BTreeMap<[i64; 2], Vec<[i64; 2]>>, from: [i64; 2], heading: [i64; 2]) -> Option<[i64; 2]> {
    let ends = edges.get_mut(&from)?;
    let left = |to: &[i64; 2]| heading[0] * (to[1] - from[1]) - heading[1] * (to[0] - from[0]);
    let best = (0..ends.len()).max_by_key(|index| left(&ends[*index]))?;
    let to = ends.swap_remove(best);
    if ends.is_empty() {
        edges.remove(&from);
    }
    Some(to)
}

/// Leaves out corners of a closed line that lie within `tolerance` of what remains, by Douglas and Peucker's rule. Of a line
/// around one row of cells little would remain: then only corners between others on a straight line are left out.
fn simplified(corners: &[DVec2], tolerance: f64) -> Vec<DVec2> {
    let Some(first) = corners.first() else { return Vec::new() };
    let farthest = (0..corners.len())
        .max_by(|one, other| corners[*one].distance(*first).total_cmp(&corners[*other].distance(*first)))
        .unwrap_or(0);
    let mut closed = corners.to_vec();
    closed.push(*first);
    let mut kept = vec![false; closed.len()];
    for index in [0, farthest] {
        kept[index] = true;
    }
    let mut parts = vec![(0, farthest), (farthest, closed.len() - 1)];
    while let Some((from, to)) = parts.pop() {
        let line = closed[to] - closed[from];
        let off = |index: &usize| {
            let offset = closed[*index] - closed[from];
            if line.length() > 0.0 { offset.perp_dot(line).abs() / line.length() } else { offset.length() }
        };
        let worst = (from + 1..to).max_by(|one, other| off(one).total_cmp(&off(other)));
        if let Some(worst) = worst.filter(|worst| off(worst) > tolerance) {
            kept[worst] = true;
            parts.extend([(from, worst), (worst, to)]);
        }
    }
    let few: Vec<DVec2> = (0..corners.len()).filter(|index| kept[*index]).map(|index| corners[index]).collect();
    if area(&few).abs() >= 0.5 * area(corners).abs() {
        return few;
    }
    let before = |index: usize| corners[(index + corners.len() - 1) % corners.len()];
    let turns = |index: &usize| {
        let (corner, next) = (corners[*index], corners[(index + 1) % corners.len()]);
        (corner - before(*index)).perp_dot(next - corner).abs() > 1e-6 * tolerance * tolerance
    };
    (0..corners.len()).filter(turns).map(|index| corners[index]).collect()
}

/// Area inside of a closed line, negative if it runs clockwise.
fn area(outline: &[DVec2]) -> f64 {
    let Some(first) = outline.first() else { return 0.0 };
    let corners = || outline.iter().map(|corner| *corner - *first);
    0.5 * corners().zip(corners().skip(1)).map(|(one, other)| one.perp_dot(other)).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outlines_have_the_area_of_their_cells() {
        let shape = GridShape { resolution: 0.5, origin: DVec2::new(-3.0, 1.0), width: 20, height: 20 };
        let block = |columns: std::ops::Range<usize>, rows: std::ops::Range<usize>| {
            rows.flat_map(move |row| columns.clone().map(move |column| row * 20 + column))
        };
        let mut cells: BTreeSet<usize> = block(2..10, 3..12).collect();
        assert_eq!(outlines(&shape, &cells).len(), 1);
        assert_eq!(outlines(&shape, &cells)[0].len(), 4, "a rectangle");
        // With a hole of 4 x 4 cells, and another part that touches at a corner.
        block(4..8, 5..9).for_each(|cell| _ = cells.remove(&cell));
        cells.extend(block(10..14, 12..15));
        let found = outlines(&shape, &cells);
        let areas: Vec<f64> = found.iter().map(|outline| area(outline) / 0.25).collect();
        assert_eq!(areas, [72.0, -16.0, 12.0]);
        assert!(outlines(&shape, &BTreeSet::new()).is_empty());
        // A single cell, and a wall as thin as one.
        for (columns, rows) in [(3..4, 5..6), (3..4, 2..15), (2..15, 19..20)] {
            let cells = block(columns, rows).collect::<BTreeSet<usize>>();
            let found = outlines(&shape, &cells);
            assert_eq!((found.len(), found[0].len()), (1, 4), "{found:?}");
            assert!((area(&found[0]) - 0.25 * cells.len() as f64).abs() < 1e-9, "{found:?}");
        }
    }
}
