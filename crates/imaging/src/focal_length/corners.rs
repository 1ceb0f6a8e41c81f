//! Corners of an image: places that can be found again in the next one.

use glam::Vec2;
use splatseg_geometry::Image;

/// Most corners that are followed.
const MOST: usize = 300;
/// Pixels between corners.
const APART: usize = 7;
/// Weaker corners, as a share of the strongest, are left out.
const MIN_SHARE: f32 = 0.01;
/// Half the side of the window over which gradients are summed, pixels.
const RADIUS: usize = 2;

/// The strongest corners, at least `border` pixels from the edge, after Shi and Tomasi, "Good features to track" (1994):
/// their strength is the smaller eigenvalue of the sums of gradients.
pub(super) fn corners(image: &Image<f32>, border: usize) -> Vec<Vec2> {
    let (width, height) = image.size();
    let border = border.max(RADIUS + 1);
    if width.min(height) <= 2 * border {
        return Vec::new();
    }
    let strengths = strengths(image);
    let inside = (border..height - border).flat_map(|row| (border..width - border).map(move |column| (column, row)));
    let strongest = inside.clone().map(|place| strengths[place]).fold(0.0, f32::max);
    let is_peak = |&(column, row): &(usize, usize)| {
        let strength = strengths[(column, row)];
        let near =
            || (row - 1..=row + 1).flat_map(move |row| (column - 1..=column + 1).map(move |column| (column, row)));
        strength > MIN_SHARE * strongest && near().all(|place| strengths[place] <= strength)
    };
    let mut peaks: Vec<(usize, usize)> = inside.filter(is_peak).collect();
    // The sort is stable: equal corners stay in the order of rows.
    peaks.sort_by(|a, b| strengths[*b].total_cmp(&strengths[*a]));
    let mut is_taken = Image::filled(width, height, false);
    let mut corners = Vec::new();
    for (column, row) in peaks {
        if corners.len() < MOST && !is_taken[(column, row)] {
            corners.push(Vec2::new(column as f32, row as f32));
            for row in row.saturating_sub(APART)..(row + APART + 1).min(height) {
                for column in column.saturating_sub(APART)..(column + APART + 1).min(width) {
                    is_taken[(column, row)] = true;
                }
            }
        }
    }
    corners
}

/// The smaller eigenvalue of the gradients' second moments around each pixel; 0 next to the edge.
fn strengths(image: &Image<f32>) -> Image<f32> {
    let (width, height) = image.size();
    let products = Image::from_fn(width, height, |column, row| {
        if column == 0 || row == 0 || column + 1 == width || row + 1 == height {
            return [0.0; 3];
        }
        let x = image[(column + 1, row)] - image[(column - 1, row)];
        let y = image[(column, row + 1)] - image[(column, row - 1)];
        [x * x, x * y, y * y]
    });
    let sums = summed_along_columns(&summed_along_rows(&products));
    sums.map(|[xx, xy, yy]| {
        let (mean, half) = (0.5 * (xx + yy), 0.5 * (xx - yy));
        mean - (half * half + xy * xy).sqrt()
    })
}

fn summed_along_rows(values: &Image<[f32; 3]>) -> Image<[f32; 3]> {
    Image::from_fn(values.width(), values.height(), |column, row| {
        let around = column.saturating_sub(RADIUS)..(column + RADIUS + 1).min(values.width());
        summed(values.row(row)[around].iter())
    })
}

fn summed_along_columns(values: &Image<[f32; 3]>) -> Image<[f32; 3]> {
    Image::from_fn(values.width(), values.height(), |column, row| {
        let around = row.saturating_sub(RADIUS)..(row + RADIUS + 1).min(values.height());
        summed(around.map(|row| &values[(column, row)]))
    })
}

fn summed<'a>(values: impl Iterator<Item = &'a [f32; 3]>) -> [f32; 3] {
    values.fold([0.0; 3], |sum, value| std::array::from_fn(|part| sum[part] + value[part]))
}
