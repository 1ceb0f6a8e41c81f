//! Resampling of images between pixel grids that differ by a scale and a shift along each axis: resizing, or the same
//! view through another pinhole camera.
//!
//! Pixel centres have integer coordinates, as everywhere in the project.

use splatseg_geometry::{CowImage, Image, Intrinsics, SegmentMap};

/// Mapping of target to source pixels along one axis: `source = scale * target + offset`.
#[derive(Clone, Copy, Debug, PartialEq)]
struct AxisMap {
    scale: f64,
    offset: f64,
    source_len: usize,
    target_len: usize,
}

/// Mapping of the pixels of a target image to a source image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImageMap {
    columns: AxisMap,
    rows: AxisMap,
}

impl ImageMap {
    /// Maps from an image of size `source` to one of size `target`, both `(width, height)` and showing the same view.
    pub fn resize(source: (usize, usize), target: (usize, usize)) -> Self {
        let axis = |source_len: usize, target_len: usize| {
            let scale = source_len as f64 / target_len as f64;
            AxisMap { scale, offset: 0.5 * scale - 0.5, source_len, target_len }
        };
        Self { columns: axis(source.0, target.0), rows: axis(source.1, target.1) }
    }

    /// Maps from the image of camera `source` to that of camera `target`, at the same position.
    pub fn between_cameras(source: &Intrinsics, target: &Intrinsics) -> Self {
        let axis = |source: (f32, f32, usize), target: (f32, f32, usize)| {
            let scale = f64::from(source.0) / f64::from(target.0);
            let offset = f64::from(source.1) - scale * f64::from(target.1);
            AxisMap { scale, offset, source_len: source.2, target_len: target.2 }
        };
        Self {
            columns: axis((source.fx, source.cx, source.width), (target.fx, target.cx, target.width)),
            rows: axis((source.fy, source.cy, source.height), (target.fy, target.cy, target.height)),
        }
    }

    /// Returns the source pixel, `(column, row)`, nearest to a target pixel; `None` outside the source. Halfway between
    /// two pixels, the left or upper one. Labels and masks both follow this rule.
    pub fn nearest(&self, column: usize, row: usize) -> Option<(usize, usize)> {
        let inside = self.columns.is_inside(column) && self.rows.is_inside(row);
        inside.then(|| (self.columns.nearest(column), self.rows.nearest(row)))
    }

    /// Returns true if no pixel moves.
    pub fn is_identity(&self) -> bool {
        [self.columns, self.rows]
            .iter()
            .all(|axis| axis.scale == 1.0 && axis.offset == 0.0 && axis.source_len == axis.target_len)
    }
}

/// Filter weights of the source pixels of one target pixel.
struct Taps {
    first: usize,
    /// The weights sum to 1.
    weights: Vec<f32>,
}

impl AxisMap {
    fn center(&self, target: usize) -> f64 {
        self.scale * target as f64 + self.offset
    }

    /// Returns the source index nearest to a target pixel (the lower of two), clamped to the edge.
    fn nearest(&self, target: usize) -> usize {
        let index = (self.center(target) - 0.5).ceil().max(0.0) as usize;
        index.min(self.source_len.saturating_sub(1))
    }

    /// Computes a triangle filter, widened when the image shrinks to avoid aliasing.
    fn taps(&self) -> Vec<Taps> {
        let support = self.scale.abs().max(1.0);
        let taps_at = |target: usize| {
            let center = self.center(target);
            let first = (center - support).ceil().max(0.0) as usize;
            let end = ((center + support).floor() + 1.0).clamp(0.0, self.source_len as f64) as usize;
            let weights: Vec<f32> =
                (first..end).map(|index| (1.0 - (index as f64 - center).abs() / support).max(0.0) as f32).collect();
            let sum: f32 = weights.iter().sum();
            if sum > 0.0 {
                Taps { first, weights: weights.iter().map(|weight| weight / sum).collect() }
            } else {
                Taps { first: self.nearest(target), weights: vec![1.0] }
            }
        };
        (0..self.target_len).map(taps_at).collect()
    }

    /// Returns the source indices under a target pixel (at least the nearest), each with its squared distance.
    fn covered(&self, target: usize) -> Vec<(usize, f64)> {
        let center = self.center(target);
        let nearest = self.nearest(target);
        let half = self.scale.abs() / 2.0;
        let first = ((center - half).ceil().max(0.0) as usize).min(nearest);
        let last = ((center + half).floor().max(0.0) as usize).clamp(nearest, self.source_len - 1);
        (first..=last).map(|index| (index, (index as f64 - center).powi(2))).collect()
    }

    /// Returns true if a target pixel lies inside the source image.
    fn is_inside(&self, target: usize) -> bool {
        let center = self.center(target);
        center >= -0.5 && center <= self.source_len as f64 - 0.5
    }
}

/// Resamples colour with a low-pass filter. Pixels outside the source repeat its edge. Black for an empty source.
pub fn resample_color(source: &CowImage<'_, [u8; 3]>, map: &ImageMap) -> Image<[u8; 3]> {
    if map.is_identity() {
        return source.clone().into_owned();
    }
    let (width, height) = (map.columns.target_len, map.rows.target_len);
    if source.pixels().is_empty() {
        return Image::filled(width, height, [0; 3]);
    }
    // The triangle filter is separable: along x first, then along y.
    let column_taps = map.columns.taps();
    let mut narrow = vec![0.0; 3 * width * source.height()];
    for (row, out) in narrow.chunks_mut(3 * width).enumerate() {
        let pixels = source.row(row);
        for (taps, out) in column_taps.iter().zip(out.as_chunks_mut::<3>().0) {
            for (weight, pixel) in taps.weights.iter().zip(&pixels[taps.first..]) {
                (0..3).for_each(|channel| out[channel] += weight * f32::from(pixel[channel]));
            }
        }
    }
    let mut pixels = Vec::with_capacity(width * height);
    let mut sums = vec![0.0; 3 * width];
    for taps in map.rows.taps() {
        sums.fill(0.0);
        for (weight, row) in taps.weights.iter().zip(narrow.chunks(3 * width).skip(taps.first)) {
            sums.iter_mut().zip(row).for_each(|(sum, value)| *sum += weight * value);
        }
        pixels.extend(sums.as_chunks::<3>().0.iter().map(|sums| sums.map(rounded)));
    }
    Image::from_pixels(width, height, pixels).unwrap_or_else(|_| Image::filled(width, height, [0; 3]))
}

/// Rounds to the nearest of 0 to 255, halves up. `f32::round` is a call of a function on processors without SSE 4.1.
fn rounded(value: f32) -> u8 {
    let above = (value + 0.5) as u8;
    // The sum was rounded up if it was just below a half.
    if f32::from(above) - value > 0.5 { above - 1 } else { above }
}

/// Takes for each target pixel the valid depth nearest to its centre, among the source pixels it covers; 0 if there is
/// none.
pub fn resample_depth(source: &CowImage<'_, f32>, map: &ImageMap) -> Image<f32> {
    if map.is_identity() {
        return source.clone().into_owned();
    }
    let (width, height) = (map.columns.target_len, map.rows.target_len);
    if source.pixels().is_empty() {
        return Image::filled(width, height, 0.0);
    }
    let columns: Vec<_> = (0..width).map(|column| map.columns.covered(column)).collect();
    let rows: Vec<_> = (0..height).map(|row| map.rows.covered(row)).collect();
    Image::from_fn(width, height, |column, row| {
        let mut nearest = (f64::INFINITY, 0.0);
        for (source_row, row_distance) in &rows[row] {
            for (source_column, column_distance) in &columns[column] {
                let depth = source[(*source_column, *source_row)];
                if depth > 0.0 && row_distance + column_distance < nearest.0 {
                    nearest = (row_distance + column_distance, depth);
                }
            }
        }
        nearest.1
    })
}

/// Takes the label nearest to each target pixel; 0 outside the source.
pub fn resample_labels(source: &SegmentMap, map: &ImageMap) -> SegmentMap {
    let (width, height) = (map.columns.target_len, map.rows.target_len);
    if source.pixels().is_empty() {
        return Image::filled(width, height, 0);
    }
    Image::from_fn(width, height, |column, row| map.nearest(column, row).map_or(0, |nearest| source[nearest]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fine_pattern_becomes_grey_instead_of_aliasing() {
        let stripes = Image::from_fn(60, 30, |column, _| if column % 2 == 0 { [0; 3] } else { [200; 3] });
        // By an odd factor: single pixels would hit black and white in turn.
        let small = resample_color(&stripes, &ImageMap::resize((60, 30), (12, 6)));
        assert!(small.row(4)[1..11].iter().all(|pixel| pixel[0].abs_diff(100) <= 6), "{:?}", small.row(4));
    }

    #[test]
    fn a_ramp_stays_where_it_is() {
        let ramp = Image::from_fn(80, 60, |column, row| [column as u8 * 3, row as u8 * 3, 7]);
        let source = Intrinsics { fx: 70.0, fy: 65.0, cx: 41.0, cy: 28.0, width: 80, height: 60 };
        let target = Intrinsics { fx: 30.0, fy: 28.0, cx: 19.0, cy: 14.5, width: 40, height: 30 };
        let seen = resample_color(&ramp, &ImageMap::between_cameras(&source, &target));
        for (column, row) in [(10, 8), (19, 14), (30, 22)] {
            let x = 70.0 * (column as f32 - 19.0) / 30.0 + 41.0;
            let y = 65.0 * (row as f32 - 14.5) / 28.0 + 28.0;
            let [r, g, b] = seen[(column, row)];
            assert!((f32::from(r) - 3.0 * x).abs() < 1.0 && (f32::from(g) - 3.0 * y).abs() < 1.0 && b == 7);
        }
    }

    #[test]
    fn surfaces_are_never_mixed_and_holes_are_filled_only_by_neighbours_under_the_pixel() {
        let depth = Image::from_pixels(4, 2, vec![1.0, 5.0, 0.0, 0.0, 1.0, 5.0, 0.0, 3.0]).unwrap();
        let half = resample_depth(&depth, &ImageMap::resize((4, 2), (2, 1)));
        assert_eq!(half.pixels(), &[1.0, 3.0]);
        let twice = resample_depth(&depth, &ImageMap::resize((4, 2), (8, 4)));
        assert_eq!(&twice.row(0)[..6], &[1.0, 1.0, 5.0, 5.0, 0.0, 0.0]);
    }

    #[test]
    fn labels_go_to_the_nearest_pixel() {
        let labels = SegmentMap::from_pixels(4, 1, vec![1, 2, 3, 4]).unwrap();
        assert_eq!(resample_labels(&labels, &ImageMap::resize((4, 1), (2, 1))).pixels(), &[1, 3]);
        let wide = Intrinsics { fx: 1.0, fy: 1.0, cx: 3.5, cy: 0.0, width: 8, height: 1 };
        let narrow = Intrinsics { cx: 1.5, width: 4, ..wide };
        let map = ImageMap::between_cameras(&narrow, &wide);
        assert_eq!(resample_labels(&labels, &map).pixels(), &[0, 0, 1, 2, 3, 4, 0, 0]);
        assert_eq!(resample_color(&Image::filled(4, 1, [9; 3]), &map).pixels(), &[[9; 3]; 8]);
    }
}
