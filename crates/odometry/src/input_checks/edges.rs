//! Edges of depth, and how much the colour image changes at a place.

use glam::Vec2;
use splatseg_geometry::CameraFrame;

/// Frames are looked at as if they were about this wide; lengths are in pixels of such a frame, called units.
const WIDTH: usize = 320;

/// Depth has an edge where it changes by more than this fraction...
const MIN_CHANGE: f32 = 0.08;
/// ...between measurements at most this far apart, units: beside near surfaces, sensors measure nothing.
const MAX_GAP: usize = 8;

/// Every Nth row and column is searched, in units.
const LINES: usize = 2;

/// A frame with fewer edges says nothing.
const MIN_EDGES: usize = 30;

/// Changes of colour above this count the same.
const MAX_CONTRAST: f32 = 14.0;

/// Where the edges of depth would be, colour changes at least this many times as much as in the mean of the image. Less
/// tells nothing: a noisy depth camera moves its edges, and right input gave up to 1.41, wrong input 1.56 or more.
pub(super) const TELLING_CONTRAST: f64 = 1.5;

/// The mean contrast of an image is measured at every Nth pixel.
const SAMPLING: usize = 41;

/// An edge of a near surface in the depth image.
#[derive(Clone, Copy, Debug)]
pub(super) struct DepthEdge {
    /// Column and row of its pixel.
    pub(super) place: Vec2,
    /// Depth of the near surface, metres.
    pub(super) depth: f32,
    /// True if depth changes along the row, false if along the column.
    is_along_row: bool,
}

/// A frame with the edges of its depth.
pub(super) struct EdgeFrame<'a> {
    frame: &'a CameraFrame<'a>,
    /// Pixels per unit.
    pub(super) unit: usize,
    /// Evenly sampled edges.
    pub(super) edges: Vec<DepthEdge>,
    /// Mean contrast along columns, and along rows.
    mean: [f32; 2],
}

impl<'a> EdgeFrame<'a> {
    /// Finds the edges of a frame, about `most` at most. `None` if depth or colour have too few.
    pub(super) fn new(frame: &'a CameraFrame<'a>, most: usize) -> Option<Self> {
        let unit = ((frame.width() + WIDTH / 2) / WIDTH).max(1);
        let sampled = |edges: Vec<DepthEdge>| {
            let step = edges.len().div_ceil((most / 2).max(1)).max(1);
            edges.into_iter().step_by(step)
        };
        let edges: Vec<_> = sampled(along_rows(frame, unit)).chain(sampled(along_columns(frame, unit))).collect();
        let mut edge_frame = Self { frame, unit, edges, mean: [1.0; 2] };
        if edge_frame.edges.len() < MIN_EDGES {
            return None;
        }
        edge_frame.mean = [false, true].map(|is_along_row| edge_frame.mean_contrast(is_along_row));
        edge_frame.mean.iter().all(|mean| *mean > 0.0).then_some(edge_frame)
    }

    /// Contrast of the colour image across an edge of depth that is moved by `shift` pixels, relative to the image's mean.
    /// `None` outside the image.
    pub(super) fn contrast(&self, edge: &DepthEdge, shift: Vec2) -> Option<f32> {
        let place = (edge.place + shift + 0.5).floor();
        let contrast = self.contrast_at(place.x as i64, place.y as i64, edge.is_along_row)?;
        Some(contrast / self.mean[usize::from(edge.is_along_row)])
    }

    fn mean_contrast(&self, is_along_row: bool) -> f32 {
        let width = self.frame.width();
        let numbers = (0..width * self.frame.height()).step_by(SAMPLING * self.unit);
        let contrasts = numbers
            .filter_map(|number| self.contrast_at((number % width) as i64, (number / width) as i64, is_along_row));
        let (sum, count) = contrasts.fold((0.0, 0), |(sum, count), contrast| (sum + contrast, count + 1));
        sum / count.max(1) as f32
    }

    /// Change of the green channel across a place, averaged over six pixels on each side.
    fn contrast_at(&self, column: i64, row: i64, is_along_row: bool) -> Option<f32> {
        let (width, height) = (self.frame.width() as i64, self.frame.height() as i64);
        let unit = self.unit as i64;
        let reach = 2 * unit;
        if column < reach || row < reach || column >= width - reach || row >= height - reach {
            return None;
        }
        let green = |across: i64, along: i64| {
            let (dx, dy) = if is_along_row { (across, along) } else { (along, across) };
            i32::from(self.frame.color().row((row + dy * unit) as usize)[(column + dx * unit) as usize][1])
        };
        let side = |sign: i64| (-1..=1).map(|along| green(sign, along) + green(2 * sign, along)).sum::<i32>();
        Some(((side(1) - side(-1)).abs() as f32 / 6.0).min(MAX_CONTRAST))
    }
}

/// The nearer one of two neighbouring measurements, if there is an edge between them.
fn nearer<T>((one, one_depth): (T, f32), (other, other_depth): (T, f32)) -> Option<(T, f32)> {
    let (near, far) = (one_depth.min(other_depth), one_depth.max(other_depth));
    let is_edge = far > near * (1.0 + MIN_CHANGE) && far.is_finite();
    is_edge.then_some(if one_depth < other_depth { (one, one_depth) } else { (other, other_depth) })
}

fn along_rows(frame: &CameraFrame<'_>, unit: usize) -> Vec<DepthEdge> {
    let mut edges = Vec::new();
    for row in (0..frame.height()).step_by(LINES * unit) {
        let mut last: Option<(usize, f32)> = None;
        for (column, depth) in frame.depth().row(row).iter().copied().enumerate().filter(|(_, depth)| *depth > 0.0) {
            let before = last.replace((column, depth));
            let before = before.filter(|(before, _)| column - before <= MAX_GAP * unit);
            if let Some((column, depth)) = before.and_then(|before| nearer(before, (column, depth))) {
                let place = Vec2::new(column as f32, row as f32);
                edges.push(DepthEdge { place, depth, is_along_row: true });
            }
        }
    }
    edges
}

fn along_columns(frame: &CameraFrame<'_>, unit: usize) -> Vec<DepthEdge> {
    let mut edges = Vec::new();
    let mut last: Vec<Option<(usize, f32)>> = vec![None; frame.width().div_ceil(LINES * unit)];
    for row in 0..frame.height() {
        let depths = frame.depth().row(row).iter().copied().step_by(LINES * unit);
        for ((number, depth), last) in depths.enumerate().zip(&mut last).filter(|((_, depth), _)| *depth > 0.0) {
            let before = last.replace((row, depth)).filter(|(before, _)| row - before <= MAX_GAP * unit);
            if let Some((row, depth)) = before.and_then(|before| nearer(before, (row, depth))) {
                let place = Vec2::new((number * LINES * unit) as f32, row as f32);
                edges.push(DepthEdge { place, depth, is_along_row: false });
            }
        }
    }
    edges
}

#[cfg(test)]
mod tests {
    use super::*;
    use splatseg_geometry::{Image, Intrinsics};

    /// A near white square before a dark wall, with a shadow of missing depth to its left.
    fn square() -> CameraFrame<'static> {
        let is_near = |column: usize, row: usize| (20..60).contains(&column) && (15..45).contains(&row);
        let color = Image::from_fn(80, 60, |column, row| if is_near(column, row) { [200; 3] } else { [20; 3] });
        let depth = Image::from_fn(80, 60, |column, row| match is_near(column, row) {
            true => 1.0,
            false if (16..20).contains(&column) => 0.0,
            false => 2.0,
        });
        let intrinsics = Intrinsics { fx: 80.0, fy: 80.0, cx: 39.5, cy: 29.5, width: 80, height: 60 };
        CameraFrame::new("square", color, depth, intrinsics).unwrap()
    }

    #[test]
    fn edges_are_those_of_the_near_surface() {
        let frame = square();
        let found = EdgeFrame::new(&frame, 1000).unwrap();
        assert_eq!(found.edges.len(), 2 * 15 + 2 * 20);
        let is_border = |edge: &DepthEdge| match edge.is_along_row {
            true => [20.0, 59.0].contains(&edge.place.x),
            false => [15.0, 44.0].contains(&edge.place.y),
        };
        assert!(found.edges.iter().all(|edge| edge.depth == 1.0 && is_border(edge)));
        let sharp = |shift: Vec2| found.edges.iter().filter_map(|edge| found.contrast(edge, shift)).sum::<f32>();
        assert!(sharp(Vec2::ZERO) > 3.0 * sharp(Vec2::new(8.0, 8.0)));
    }

    #[test]
    fn frames_without_depth_or_contrast_say_nothing() {
        let intrinsics = Intrinsics { fx: 80.0, fy: 80.0, cx: 39.5, cy: 29.5, width: 80, height: 60 };
        let frame = |depth: Image<f32>| CameraFrame::new("frame", Image::filled(80, 60, [9; 3]), depth, intrinsics);
        assert!(EdgeFrame::new(&frame(Image::filled(80, 60, 0.0)).unwrap(), 100).is_none());
        let stripes = Image::from_fn(80, 60, |column, _| if column % 10 < 5 { 1.0 } else { 2.0 });
        assert!(EdgeFrame::new(&frame(stripes).unwrap(), 100).is_none(), "no contrast");
        let tiny = Intrinsics { fx: 1.0, fy: 1.0, cx: 0.0, cy: 0.0, width: 1, height: 1 };
        let tiny = CameraFrame::new("tiny", Image::filled(1, 1, [9; 3]), Image::filled(1, 1, 1.0), tiny).unwrap();
        assert!(EdgeFrame::new(&tiny, 100).is_none());
    }
}
