//! Fills small holes in masks (official `fill_holes_in_mask_scores`).

/// Logit of a filled pixel, just inside the mask.
const FILLED_LOGIT: f32 = 0.1;

/// State of a pixel.
#[derive(Clone, Copy, PartialEq)]
enum Pixel {
    Inside,
    /// Outside, in a region whose size is not known yet.
    Open,
    /// Reached while measuring the current region.
    Reached,
    /// In a region too large to be a hole.
    Background,
}

/// Fills the holes in mask logits with rows of `width` pixels. A hole is any background region (logits up to 0),
/// connected by edges or corners, of at most `max_area` pixels, even at the border.
pub(crate) fn fill_holes(logits: &mut [f32], width: usize, max_area: usize) {
    if max_area == 0 {
        return;
    }
    let kind = |logit: &f32| if *logit <= 0.0 { Pixel::Open } else { Pixel::Inside };
    let mut pixels: Vec<Pixel> = logits.iter().map(kind).collect();
    let mut region = Vec::new();
    for start in 0..pixels.len() {
        if pixels[start] != Pixel::Open {
            continue;
        }
        let is_hole = measure(&mut pixels, width, max_area, start, &mut region);
        for pixel in region.drain(..) {
            if is_hole {
                (pixels[pixel], logits[pixel]) = (Pixel::Inside, FILLED_LOGIT);
            } else {
                pixels[pixel] = Pixel::Background;
            }
        }
    }
}

/// Collects the region of a pixel and returns true if it has at most `max_area` pixels. Stops as soon as the region is
/// larger or touches known background: a neighbour decides most pixels of a frame.
fn measure(pixels: &mut [Pixel], width: usize, max_area: usize, start: usize, region: &mut Vec<usize>) -> bool {
    pixels[start] = Pixel::Reached;
    region.push(start);
    let mut next = 0;
    while let Some(&pixel) = region.get(next) {
        for neighbour in neighbours(pixel, width, pixels.len()) {
            match pixels[neighbour] {
                Pixel::Background => return false,
                Pixel::Open if region.len() == max_area => return false,
                Pixel::Open => {
                    pixels[neighbour] = Pixel::Reached;
                    region.push(neighbour);
                }
                Pixel::Inside | Pixel::Reached => {}
            }
        }
        next += 1;
    }
    true
}

/// Returns the up to eight neighbours of a pixel.
fn neighbours(pixel: usize, width: usize, len: usize) -> impl Iterator<Item = usize> {
    let (column, row, height) = (pixel % width, pixel / width, len / width);
    let columns = column.saturating_sub(1)..(column + 2).min(width);
    let rows = row.saturating_sub(1)..(row + 2).min(height);
    rows.flat_map(move |row| columns.clone().map(move |column| row * width + column))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `#` is inside, `.` outside.
    fn filled(picture: &[&str], max_area: usize) -> Vec<String> {
        let width = picture[0].len();
        let mut logits: Vec<f32> =
            picture.concat().chars().map(|pixel| if pixel == '#' { 3.0 } else { -3.0 }).collect();
        fill_holes(&mut logits, width, max_area);
        let shown = |logit: &f32| match *logit {
            3.0 => '#',
            FILLED_LOGIT => 'o',
            _ => '.',
        };
        logits.chunks_exact(width).map(|row| row.iter().map(shown).collect()).collect()
    }

    #[test]
    fn holes_up_to_the_area_are_filled_and_corners_connect() {
        let picture = ["######", "#.#..#", "##.###", "######", "#....."];
        assert_eq!(filled(&picture, 3), picture, "four pixels that touch by corners are one hole");
        assert_eq!(filled(&picture, 4), ["######", "#o#oo#", "##o###", "######", "#....."]);
        assert_eq!(
            filled(&picture, 5),
            ["######", "#o#oo#", "##o###", "######", "#ooooo"],
            "holes at the border are filled too"
        );
        assert_eq!(filled(&picture, 0), picture);
    }

    #[test]
    fn regions_do_not_connect_round_the_border_of_rows() {
        assert_eq!(filled(&["##.", ".##"], 1), ["##o", "o##"]);
    }
}
