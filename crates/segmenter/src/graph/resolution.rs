//! Downscaling of large frames by a whole number.

use splatseg_geometry::{CameraFrame, CowImage, Image, Intrinsics};

/// A frame at its own or a lower resolution.
pub(super) struct ScaledFrame<'a> {
    pub color: CowImage<'a, [u8; 3]>,
    /// z-depth, metres; 0 where missing.
    pub depth: CowImage<'a, f32>,
    pub camera: Intrinsics,
    /// Rows and columns of the original frame per pixel.
    step: usize,
}

impl<'a> ScaledFrame<'a> {
    /// Divides the frame's resolution by the smallest whole number that leaves at most `max_pixels`.
    pub fn new(frame: &'a CameraFrame<'_>, max_pixels: usize) -> Self {
        let (width, height) = (frame.width(), frame.height());
        let smaller = |step: usize| (width.div_ceil(step), height.div_ceil(step));
        let fits = |(width, height): (usize, usize)| width * height <= max_pixels;
        let step = (1..width.max(height)).find(|step| fits(smaller(*step))).unwrap_or(width.max(height));
        if step == 1 {
            let (color, depth) = (frame.color().as_borrowed(), frame.depth().as_borrowed());
            return Self { color, depth, camera: *frame.intrinsics(), step };
        }
        let (small_width, small_height) = smaller(step);
        let (color, depth) = (frame.color(), frame.depth());
        let small_color = Image::from_fn(small_width, small_height, |column, row| {
            let (mut sum, mut count) = ([0u32; 3], 0);
            for pixel in block((column, row), step, (width, height)) {
                let rgb = color[pixel];
                sum = [0, 1, 2].map(|channel| sum[channel] + u32::from(rgb[channel]));
                count += 1;
            }
            sum.map(|channel| ((channel + count / 2) / count) as u8)
        });
        // A mean would invent depths between an object and its background. So it is the depth nearest to the block's centre,
        // where the camera sees the new pixel.
        let outwards = outwards(step);
        let small_depth = Image::from_fn(small_width, small_height, |column, row| {
            let pixels = outwards.iter().map(|(right, down)| (column * step + right, row * step + down));
            let inside = pixels.filter(|(column, row)| *column < width && *row < height);
            inside.map(|pixel| depth[pixel]).find(|depth| *depth > 0.0).unwrap_or(0.0)
        });
        // The last blocks may extend past the edge, so the camera is that of the padded image.
        let padded = Intrinsics { width: small_width * step, height: small_height * step, ..*frame.intrinsics() };
        let camera = padded.resized(small_width, small_height);
        Self { color: small_color, depth: small_depth, camera, step }
    }

    /// Row-major index of the scaled pixel that covers a pixel of the original frame.
    pub fn index_of(&self, column: usize, row: usize) -> usize {
        row / self.step * self.color.width() + column / self.step
    }
}

/// The pixels of the original frame covered by a scaled pixel.
fn block(
    (column, row): (usize, usize),
    step: usize,
    (width, height): (usize, usize),
) -> impl Iterator<Item = (usize, usize)> {
    (row * step..((row + 1) * step).min(height))
        .flat_map(move |row| (column * step..((column + 1) * step).min(width)).map(move |column| (column, row)))
}

/// The pixels of a block of `step` × `step`, from its centre outwards; equally near ones row by row.
fn outwards(step: usize) -> Vec<(usize, usize)> {
    let mut pixels: Vec<(usize, usize)> = (0..step * step).map(|pixel| (pixel % step, pixel / step)).collect();
    let from_centre = |place: usize| (2 * place + 1).abs_diff(step);
    pixels.sort_by_key(|(column, row)| from_centre(*column).pow(2) + from_centre(*row).pow(2));
    pixels
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_is_the_nearest_to_the_centre_of_each_block() {
        let camera = Intrinsics { fx: 9.0, fy: 9.0, cx: 3.0, cy: 1.0, width: 7, height: 3 };
        let color = Image::filled(7, 3, [9; 3]);
        let with = |missing: &[(usize, usize)], step: usize| {
            let depth = |column: usize, row: usize| (10 * row + column + 1) as f32;
            let depth = Image::from_fn(
                7,
                3,
                |column, row| {
                    if missing.contains(&(column, row)) { 0.0 } else { depth(column, row) }
                },
            );
            let frame = CameraFrame::new("0", color.clone(), depth, camera).unwrap();
            let max_pixels = 7_usize.div_ceil(step) * 3_usize.div_ceil(step);
            ScaledFrame::new(&frame, max_pixels).depth.pixels().to_vec()
        };
        // The last block has one column, and its middle row is nearest to its centre.
        assert_eq!(with(&[], 3), [12.0, 15.0, 17.0]);
        assert_eq!(with(&[(1, 1), (4, 1), (4, 0)], 3), [2.0, 14.0, 17.0]);
        // In a block of four pixels, all are equally near.
        assert_eq!(with(&[(0, 0)], 2), [2.0, 3.0, 5.0, 7.0, 21.0, 23.0, 25.0, 27.0]);
    }
}
