//! The surface of an object that a view shows, as cells of space: how much of it other views do not show.

use crate::BoundingBox;
use crate::kept_views::ViewedFrame;
use glam::Vec2;
use splatseg_geometry::SegmentId;

/// Side of the smallest cells, metres. Those of level `n` are `2^n` times as wide.
const SMALLEST_CELL: f32 = 0.02;
const MAX_LEVEL: i32 = 8;
/// Samples along the longer side of an object's box.
const SAMPLES: usize = 24;
/// Cells are at least this many times as wide as the distance of two samples, so that none lies between them.
const SAMPLES_PER_CELL: f32 = 1.5;

/// The cells of space in which a view shows an object; none without depth or pose.
#[derive(Clone, Debug, Default)]
pub(crate) struct SeenSurface {
    level: i32,
    /// In ascending order.
    cells: Vec<[i32; 3]>,
    /// These and the cells around them, in ascending order: a measured surface is not exact. Empty until [`Self::widened`]:
    /// most views are only compared with those that are kept.
    wide: Vec<[i32; 3]>,
}

impl SeenSurface {
    /// The surface of object `id`, which lies in the box `inner` of a frame.
    pub(crate) fn of(frame: &ViewedFrame<'_>, id: SegmentId, inner: &BoundingBox) -> Self {
        let Some(world_from_camera) = frame.world_from_camera else { return Self::default() };
        let (width, height) = frame.segments.size();
        let (columns, rows) = frame.depth.size();
        let step = inner.width.max(inner.height).div_ceil(SAMPLES).max(1);
        let (mut points, mut depths) = (Vec::new(), 0.0);
        for y in (inner.y + step / 2..(inner.y + inner.height).min(height)).step_by(step) {
            for x in (inner.x + step / 2..(inner.x + inner.width).min(width)).step_by(step) {
                // The depth may have fewer pixels than the ids.
                let (column, row) = (x * columns / width, y * rows / height);
                let depth = frame.depth[(column, row)];
                if frame.segments[(x, y)] != id || !(depth > 0.0 && depth.is_finite()) {
                    continue;
                }
                let pixel = Vec2::new(column as f32, row as f32);
                points.push(world_from_camera.to_world(frame.intrinsics.unproject(pixel, depth)));
                depths += depth;
            }
        }
        if points.is_empty() {
            return Self::default();
        }
        let apart = depths / points.len() as f32 * step as f32 * columns as f32 / width as f32 / frame.intrinsics.fx;
        let level = (SAMPLES_PER_CELL * apart / SMALLEST_CELL).log2().ceil() as i32;
        let level = level.clamp(0, MAX_LEVEL);
        let side = f64::from(SMALLEST_CELL) * f64::from(1 << level);
        let cells = points.into_iter().map(|point| (point / side).floor().as_ivec3().to_array());
        Self { level, cells: distinct(cells.collect()), wide: Vec::new() }
    }

    /// Ready for other views to be compared with it.
    pub(crate) fn widened(mut self) -> Self {
        let beside = |cells: Vec<[i32; 3]>, axis: usize| {
            let all = cells.into_iter().flat_map(|cell| {
                [-1, 0, 1].map(|step| {
                    let mut other = cell;
                    other[axis] = other[axis].saturating_add(step);
                    other
                })
            });
            distinct(all.collect())
        };
        self.wide = (0..3).fold(self.cells.clone(), beside);
        self
    }

    /// Number of its cells.
    pub(crate) fn len(&self) -> usize {
        self.cells.len()
    }

    /// The memory that it takes, in units of 4 bytes, about.
    pub(crate) fn size(&self) -> usize {
        4 * (self.cells.len() + self.wide.len())
    }

    /// For each other view, which must be [widened](Self::widened), whether it shows each cell of this one.
    pub(crate) fn shown_by<'o>(&self, others: impl Iterator<Item = &'o Self>) -> Vec<Vec<bool>> {
        others.map(|other| self.cells_in(other)).collect()
    }

    fn cells_in(&self, other: &Self) -> Vec<bool> {
        let coarser = |cells: &[[i32; 3]], levels: i32| -> Vec<[i32; 3]> {
            cells.iter().map(|cell| cell.map(|place| place >> levels)).collect()
        };
        if self.level <= other.level {
            let cells = coarser(&self.cells, other.level - self.level);
            return cells.iter().map(|cell| other.wide.binary_search(cell).is_ok()).collect();
        }
        let wide = distinct(coarser(&other.wide, self.level - other.level));
        self.cells.iter().map(|cell| wide.binary_search(cell).is_ok()).collect()
    }
}

/// Each cell once, in ascending order.
fn distinct(mut cells: Vec<[i32; 3]>) -> Vec<[i32; 3]> {
    cells.sort_unstable();
    cells.dedup();
    cells
}

/// The share of a view's cells that no other view shows, but for one that is left out. `shown` is as of
/// [`SeenSurface::shown_by`]. 0 without cells.
pub(crate) fn share_of_new(cells: usize, shown: &[Vec<bool>], but: Option<usize>) -> f64 {
    let is_new = |cell: &usize| shown.iter().enumerate().all(|(view, shown)| Some(view) == but || !shown[*cell]);
    (0..cells).filter(is_new).count() as f64 / cells.max(1) as f64
}
