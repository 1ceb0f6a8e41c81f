//! Enlarges the segments of a reduced frame to the size of the frame.
//!
//! Where all neighbours of a reduced pixel show its segment, so do the pixels under it. Along borders, each pixel gets the
//! segment from which the cheapest path leads to it. Paths across edges of colour and depth are expensive, so a border
//! moves to an edge nearby, and stays halfway where there is none.

use super::working_resolution::nearest;
use rayon::prelude::*;
use splatseg_geometry::{CameraFrame, Image, SegmentId, SegmentMap};

/// A difference of red, green and blue, summed, that makes a step cost as much again. With 3 to 12, VSQ of `kitchen-dev`
/// differs by 0.1.
const COLOR_STEP: f32 = 6.0;

/// A difference of depth, as a fraction of the smaller one, that makes a step cost as much again.
const DEPTH_STEP: f32 = 0.02;

/// Most that a difference of depth adds to the cost of a step. Edges of depth are often beside the true ones, so those of
/// colour count more.
const MAX_DEPTH_COST: f32 = 2.0;

/// Pixels of the border that are worked on at a time.
const CHUNK: usize = 4096;

/// A pixel near a border.
struct BorderPixel {
    /// Row-major.
    index: usize,
    /// Its neighbours in the image (row-major) with the cost of a step from there. The first ones come first on equal cost.
    steps: [(usize, f32); 4],
}

/// Returns the segment of each pixel of `frame`, from the segments of the frame at a lower resolution.
pub(super) fn enlarged(segments: &SegmentMap, frame: &CameraFrame) -> SegmentMap {
    let (width, height) = (frame.width(), frame.height());
    let columns = nearest(segments.width(), width);
    let rows = nearest(segments.height(), height);
    let sure = sure_pixels(segments);
    let mut ids = vec![0; width * height];
    ids.par_chunks_mut(width.max(1)).zip(&rows).for_each(|(ids, row)| {
        let reduced = segments.row(*row);
        ids.iter_mut().zip(&columns).for_each(|(id, column)| *id = reduced[*column]);
    });
    let border = |row: usize| {
        let sure = sure.row(rows[row]);
        let columns = columns.iter().enumerate().filter(|(_, reduced)| !sure[**reduced]);
        columns.map(move |(column, _)| BorderPixel::new(frame, column, row)).collect::<Vec<_>>()
    };
    let border: Vec<BorderPixel> = (0..height).into_par_iter().flat_map_iter(border).collect();
    let mut costs = vec![0.0; width * height];
    border.iter().for_each(|pixel| costs[pixel.index] = f32::INFINITY);
    // From a sure pixel to any around it, a path crosses two reduced pixels at most, along each axis.
    let longest = |size: usize, reduced: usize| size.div_ceil(reduced.max(1));
    for _ in 0..2 * longest(width, segments.width()).max(longest(height, segments.height())) {
        spread(&border, &mut costs, &mut ids);
    }
    SegmentMap::from_pixels(width, height, ids).unwrap_or_else(|_| SegmentMap::filled(0, 0, 0))
}

/// Paths become one step longer where that leads to a pixel at a lower cost.
fn spread(border: &[BorderPixel], costs: &mut [f32], ids: &mut [SegmentId]) {
    let longer = |pixel: &BorderPixel| {
        let mut best = (costs[pixel.index], ids[pixel.index]);
        for (from, step) in pixel.steps {
            let cost = costs[from] + step;
            if cost < best.0 {
                best = (cost, ids[from]);
            }
        }
        best
    };
    let reached: Vec<(f32, SegmentId)> = border.par_iter().with_min_len(CHUNK).map(longer).collect();
    for (pixel, (cost, id)) in border.iter().zip(reached) {
        costs[pixel.index] = cost;
        ids[pixel.index] = id;
    }
}

impl BorderPixel {
    fn new(frame: &CameraFrame, column: usize, row: usize) -> Self {
        let index = row * frame.width() + column;
        let neighbours = [
            (row > 0).then(|| index - frame.width()),
            (column > 0).then(|| index - 1),
            (column + 1 < frame.width()).then(|| index + 1),
            (row + 1 < frame.height()).then(|| index + frame.width()),
        ];
        let step =
            |near: Option<usize>| near.map_or((index, f32::INFINITY), |near| (near, step_cost(frame, index, near)));
        Self { index, steps: neighbours.map(step) }
    }
}

/// Cost of a step between two pixels.
fn step_cost(frame: &CameraFrame, one: usize, other: usize) -> f32 {
    let [first, second] = [one, other].map(|index| frame.color().pixels()[index]);
    let color: u16 = first.iter().zip(second).map(|(first, second)| u16::from(first.abs_diff(second))).sum();
    let [first, second] = [one, other].map(|index| frame.depth().pixels()[index]);
    let nearer = first.min(second);
    let depth = if nearer > 0.0 { (first - second).abs() / nearer } else { 0.0 };
    1.0 + f32::from(color) / COLOR_STEP + (depth / DEPTH_STEP).min(MAX_DEPTH_COST)
}

/// The reduced pixels that keep their segment: those inside it, and those of parts that are too thin to have an inside.
fn sure_pixels(segments: &SegmentMap) -> Image<bool> {
    let (width, height) = segments.size();
    let mut inside = Image::filled(width, height, false);
    for (row, inside) in inside.pixels_mut().chunks_mut(width.max(1)).enumerate() {
        let own = segments.row(row);
        let near = [row.saturating_sub(1), (row + 1).min(height - 1)].map(|row| segments.row(row));
        for (column, inside) in inside.iter_mut().enumerate() {
            let columns = column.saturating_sub(1)..(column + 2).min(width);
            let is_own = |ids: &[SegmentId]| ids[columns.clone()].iter().all(|id| *id == own[column]);
            *inside = is_own(own) && is_own(near[0]) && is_own(near[1]);
        }
    }
    let mut sure = inside.clone();
    for (index, sure) in sure.pixels_mut().iter_mut().enumerate().filter(|(_, sure)| !**sure) {
        let at = (index % width, index / width);
        *sure = !around(at, (width, height)).any(|near| inside[near] && segments[near] == segments[at]);
    }
    sure
}

/// A pixel and those around it.
fn around((column, row): (usize, usize), (width, height): (usize, usize)) -> impl Iterator<Item = (usize, usize)> {
    let columns = column.saturating_sub(1)..(column + 2).min(width);
    let rows = row.saturating_sub(1)..(row + 2).min(height);
    rows.flat_map(move |row| columns.clone().map(move |column| (column, row)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use splatseg_geometry::Intrinsics;

    fn frame(
        size: (usize, usize),
        color: impl Fn(usize, usize) -> u8,
        depth: impl Fn(usize, usize) -> f32,
    ) -> CameraFrame<'static> {
        let camera = Intrinsics { fx: 50.0, fy: 50.0, cx: 3.0, cy: 3.0, width: size.0, height: size.1 };
        let color = Image::from_fn(size.0, size.1, |column, row| [color(column, row); 3]);
        CameraFrame::new("0", color, Image::from_fn(size.0, size.1, depth), camera).unwrap()
    }

    /// Left and right half.
    fn halves() -> SegmentMap {
        SegmentMap::from_fn(10, 6, |column, _| if column < 5 { 7 } else { 300 })
    }

    /// The first column of the right segment in each row.
    fn border(segments: &SegmentMap) -> Vec<usize> {
        let first = |row| segments.row(row).iter().position(|id| *id == 300).unwrap();
        (0..segments.height()).map(first).collect()
    }

    #[test]
    fn a_border_stays_halfway_without_an_edge() {
        let plain = frame((20, 12), |_, _| 90, |_, _| 2.0);
        assert_eq!(border(&enlarged(&halves(), &plain)), [10; 12]);
    }

    #[test]
    fn a_border_moves_to_an_edge_of_colour_or_depth() {
        for edge in [9, 11] {
            let colored = frame((20, 12), |column, _| if column < edge { 90 } else { 120 }, |_, _| 0.0);
            assert_eq!(border(&enlarged(&halves(), &colored)), [edge; 12]);
            let deep = frame((20, 12), |_, _| 90, |column, _| if column < edge { 1.0 } else { 1.5 });
            assert_eq!(border(&enlarged(&halves(), &deep)), [edge; 12]);
        }
    }

    #[test]
    fn an_edge_far_from_the_border_does_not_attract_it() {
        let colored = frame((20, 12), |column, _| if column < 15 { 90 } else { 120 }, |_, _| 0.0);
        assert_eq!(border(&enlarged(&halves(), &colored)), [10; 12]);
    }

    #[test]
    fn thin_segments_stay() {
        let thin = SegmentMap::from_fn(10, 6, |column, row| u32::from(column == 4) + 2 * u32::from(row == 2));
        let whole = enlarged(&thin, &frame((35, 19), |_, _| 0, |_, _| 1.0));
        assert_eq!(whole.areas().into_keys().collect::<Vec<_>>(), [1, 2, 3]);
    }

    proptest! {
        #[test]
        fn pixels_show_segments_from_around(
            (size, reduced) in (1usize..40, 1usize..30).prop_flat_map(|size| (Just(size), (1..=size.0, 1..=size.1))),
            seed in 0u32..1000,
        ) {
            let noise = |column: usize, row: usize| (column as u32 * 7919 + row as u32 * 104_729 + seed) % 251;
            let segments = SegmentMap::from_fn(reduced.0, reduced.1, |column, row| noise(column, row) % 4);
            let frame = frame(size, |column, row| noise(row, column) as u8, |column, row| noise(column, row) as f32);
            let whole = enlarged(&segments, &frame);
            prop_assert_eq!(whole.size(), size);
            let (columns, rows) = (nearest(reduced.0, size.0), nearest(reduced.1, size.1));
            for (row, reduced_row) in rows.iter().enumerate() {
                for (column, reduced_column) in columns.iter().enumerate() {
                    let id = whole[(column, row)];
                    prop_assert!(around((*reduced_column, *reduced_row), reduced).any(|near| segments[near] == id));
                }
            }
        }
    }
}
