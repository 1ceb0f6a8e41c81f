//! Corners that are followed from frame to frame, and the pairs of views that they make.

use super::corners::corners;
use super::grey_pyramid::{GreyPyramid, Level};
use glam::{DVec2, Vec2};

/// Half the side of the window that is compared, pixels.
const RADIUS: usize = 6;
const SIDE: usize = 2 * RADIUS + 1;
/// Corners closer to the edge of the image are not followed, pixels.
const EDGE: f32 = 4.0;
const STEPS: usize = 12;
/// A place that moves less, in pixels, is found.
const FOUND: f32 = 0.02;
/// A corner that is followed back to the frame before must be this close to where it came from, pixels.
const MAX_RETURN: f32 = 0.5;

/// Views with fewer common corners, or with less than half of those of the first view, are not compared.
const MIN_CORNERS: usize = 40;
/// A pair is complete once the median motion of its corners is this large, in long sides of the image...
const FAR: f64 = 0.12;
/// ...and left out if it ends, with the part or because corners are lost, below this motion.
const NEAR: f64 = 0.03;

/// Places of the same corners in two views, from the middle of the image, in its long sides.
#[derive(Clone, Debug, Default)]
pub(super) struct ViewPair {
    pub(super) first: Vec<DVec2>,
    pub(super) second: Vec<DVec2>,
}

impl ViewPair {
    /// The places that a lens without distortion would show, if the real one bends lines outwards with this strength: the
    /// division model (Fitzgibbon, 2001) with distances in long sides of the image.
    pub(super) fn straightened(&self, strength: f64) -> Self {
        let straight =
            |places: &[DVec2]| places.iter().map(|place| *place / (1.0 - strength * place.length_squared())).collect();
        Self { first: straight(&self.first), second: straight(&self.second) }
    }

    /// The median motion of the corners.
    fn motion(&self) -> f64 {
        let mut moved: Vec<f64> =
            self.first.iter().zip(&self.second).map(|(first, second)| first.distance(*second)).collect();
        moved.sort_by(f64::total_cmp);
        moved.get(moved.len() / 2).copied().unwrap_or(0.0)
    }
}

/// The corners of a frame, and where they are in the last one.
struct Followed {
    found: usize,
    first: Vec<Vec2>,
    last: Vec<Vec2>,
}

impl Followed {
    fn new(image: &GreyPyramid) -> Self {
        let corners = corners(&image.levels[0].grey, EDGE as usize);
        Self { found: corners.len(), first: corners.clone(), last: corners }
    }

    /// The corners that are seen in the next frame, too; `None` if those are few.
    fn next(&self, last: &GreyPyramid, next: &GreyPyramid) -> Option<Self> {
        let (mut first, mut places) = (Vec::new(), Vec::new());
        for (start, place) in self.first.iter().zip(&self.last) {
            let found = follow(last, next, *place);
            let returned =
                |found: &Vec2| follow(next, last, *found).is_some_and(|back| back.distance(*place) < MAX_RETURN);
            if let Some(found) = found.filter(returned) {
                first.push(*start);
                places.push(found);
            }
        }
        let enough = first.len() >= MIN_CORNERS && 2 * first.len() >= self.found;
        enough.then_some(Self { found: self.found, first, last: places })
    }

    fn pair(&self, image: &GreyPyramid) -> ViewPair {
        let placed = |places: &[Vec2]| places.iter().map(|place| image.relative_to_middle(*place)).collect();
        ViewPair { first: placed(&self.first), second: placed(&self.last) }
    }
}

/// The pairs of views of consecutive frames of one size.
pub(super) fn view_pairs(mut images: impl Iterator<Item = GreyPyramid>) -> Vec<ViewPair> {
    let mut pairs = Vec::new();
    let Some(mut last) = images.next() else { return pairs };
    let size = last.size();
    let mut followed = Followed::new(&last);
    let mut has_moved = false;
    for image in images.take_while(|image| image.size() == size) {
        let mut next = followed.next(&last, &image);
        if next.is_none() && has_moved {
            pairs.extend(Some(followed.pair(&last)).filter(|pair| pair.motion() >= NEAR));
            next = Followed::new(&last).next(&last, &image);
        }
        has_moved = next.is_some();
        followed = next.unwrap_or_else(|| Followed::new(&image));
        let pair = followed.pair(&image);
        if pair.motion() >= FAR {
            pairs.push(pair);
            followed = Followed::new(&image);
            has_moved = false;
        }
        last = image;
    }
    pairs.extend(Some(followed.pair(&last)).filter(|pair| pair.motion() >= NEAR));
    pairs
}

/// Finds the place of the second image that looks like a place of the first, from the coarsest level to the finest, after
/// Bouguet, "Pyramidal implementation of the affine Lucas Kanade feature tracker" (2001). `None` if the place is not found,
/// or at the edge.
fn follow(first: &GreyPyramid, second: &GreyPyramid, place: Vec2) -> Option<Vec2> {
    let mut shift = Vec2::ZERO;
    for (number, (first, second)) in first.levels.iter().zip(&second.levels).enumerate().rev() {
        // Centres of pixels have whole coordinates: that of four pixels lies between theirs.
        let place = (place + 0.5) / (1 << number) as f32 - 0.5;
        match refined(first, second, place, shift) {
            Some(found) => shift = found,
            None if number > 0 => {}
            None => return None,
        }
        if number > 0 {
            shift *= 2.0;
        }
    }
    let (width, height) = second.size();
    let end = Vec2::new(width as f32, height as f32) - 1.0 - EDGE;
    let found = place + shift;
    (found.cmpge(Vec2::splat(EDGE)).all() && found.cmple(end).all()).then_some(found)
}

/// Finds the shift of a place between two images of one resolution, starting with a shift.
fn refined(first: &Level, second: &Level, place: Vec2, mut shift: Vec2) -> Option<Vec2> {
    let template = Template::new(first, place)?;
    for _ in 0..STEPS {
        let step = template.step(second, place + shift)?;
        shift += step;
        if step.length() < FOUND {
            break;
        }
    }
    Some(shift)
}

/// The window around a place.
struct Template {
    values: [[f32; SIDE]; SIDE],
    gradients: [[Vec2; SIDE]; SIDE],
    /// The inverse of the sums of products of gradients: xx, xy, yy.
    inverse: [f32; 3],
}

impl Template {
    fn new(level: &Level, place: Vec2) -> Option<Self> {
        let around = level.window::<{ SIDE + 2 }>(place)?;
        let values = std::array::from_fn(|row| std::array::from_fn(|column| around[row + 1][column + 1]));
        let gradients: [[Vec2; SIDE]; SIDE] = std::array::from_fn(|row| {
            std::array::from_fn(|column| {
                let across = around[row + 1][column + 2] - around[row + 1][column];
                let down = around[row + 2][column + 1] - around[row][column + 1];
                Vec2::new(across, down) * 0.5
            })
        });
        let [xx, xy, yy] = gradients.iter().flatten().fold([0.0; 3], |[xx, xy, yy], gradient| {
            [xx + gradient.x * gradient.x, xy + gradient.x * gradient.y, yy + gradient.y * gradient.y]
        });
        let determinant = xx * yy - xy * xy;
        let is_corner = determinant > 1e-3 * (xx + yy) * (xx + yy);
        is_corner.then(|| Self { values, gradients, inverse: [yy, -xy, xx].map(|part| part / determinant) })
    }

    /// The step towards the place that looks like the template.
    fn step(&self, level: &Level, place: Vec2) -> Option<Vec2> {
        let found = level.window::<SIDE>(place)?;
        let mut sum = Vec2::ZERO;
        for ((values, gradients), found) in self.values.iter().zip(&self.gradients).zip(&found) {
            for ((value, gradient), found) in values.iter().zip(gradients).zip(found) {
                sum += *gradient * (value - found);
            }
        }
        let [xx, xy, yy] = self.inverse;
        Some(Vec2::new(xx * sum.x + xy * sum.y, xy * sum.x + yy * sum.y))
    }
}
