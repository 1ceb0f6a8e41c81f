//! Removal of Gaussians: those that frames see through, and those unseen for longest if there are too many.
//!
//! A frame that sees through a Gaussian is rendered without it at once ([`VisibleBalls`]): surfaces behind it show
//! again, and missing ones grow in the same frame. The Gaussian is removed only when several frames agree
//! ([`record_visibility`]).

use crate::MemorySettings;
use crate::map::SplatMap;
use glam::Vec3;
use rayon::prelude::*;
use splatseg_geometry::{RgbdFrame, SurfaceKind};
use splatseg_render::{Balls, Camera, Shape, Splats};

/// A frame contradicts the map if it sees through more than this share of the Gaussians that it sees or sees through.
/// Then either its pose or depth is wrong, or the map is: the frame counts only if earlier frames confirm it
/// ([`FrameTrust`]).
pub(crate) const CONTRADICTION: f32 = 0.5;

/// Trust in a frame that contradicts the map (see [`CONTRADICTION`]).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FrameTrust {
    /// No earlier frame confirms it: its pose or depth is taken to be wrong, and it removes nothing.
    Alone,
    /// Earlier frames show the same: the map is wrong.
    Confirmed,
}

/// How a frame sees a Gaussian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Visibility {
    /// Out of view, hidden, at a depth edge, or without depth.
    Unknown,
    /// The observed surface is where the Gaussian lies.
    Seen,
    /// The observed surface is where the Gaussian lies, but its colour is another thing's.
    Replaced,
    /// The observed surface lies clearly behind the Gaussian: its place is free space.
    SeenThrough,
}

/// A map without the Gaussians that a frame sees through: they would hide the surfaces that the frame shows.
pub(crate) struct VisibleBalls<'a> {
    map: &'a Balls,
    visibility: &'a [Visibility],
}

impl<'a> VisibleBalls<'a> {
    /// `visibility` has one entry per Gaussian of `map`, or is empty to keep all.
    pub fn new(map: &'a Balls, visibility: &'a [Visibility]) -> Self {
        Self { map, visibility }
    }
}

impl Splats for VisibleBalls<'_> {
    fn count(&self) -> usize {
        self.map.count()
    }

    #[inline(always)]
    fn mean(&self, index: usize) -> Vec3 {
        self.map.mean(index)
    }

    #[inline(always)]
    fn opacity(&self, index: usize) -> f32 {
        if self.visibility.get(index) == Some(&Visibility::SeenThrough) { 0.0 } else { self.map.opacity(index) }
    }

    #[inline(always)]
    fn shape(&self, index: usize) -> Shape {
        self.map.shape(index)
    }
}

/// Returns how `frame` sees every Gaussian, one entry each, and whether it contradicts the map (see [`CONTRADICTION`]).
/// A frame that does so alone sees through nothing.
pub(crate) fn visibilities(
    map: &Balls,
    frame: &RgbdFrame,
    camera: &Camera,
    trust: FrameTrust,
    settings: &MemorySettings,
) -> (Vec<Visibility>, bool) {
    let mut visibility: Vec<Visibility> =
        map.means.par_iter().map(|mean| visibility_at(camera.to_camera(*mean), frame, settings)).collect();
    let count = |kind| visibility.iter().filter(|seen| **seen == kind).count() as f32;
    let (seen, seen_through) = (count(Visibility::Seen), count(Visibility::SeenThrough));
    let contradicts = seen_through > CONTRADICTION * (seen + seen_through);
    if contradicts && trust == FrameTrust::Alone {
        visibility
            .iter_mut()
            .filter(|seen| **seen == Visibility::SeenThrough)
            .for_each(|seen| *seen = Visibility::Unknown);
    }
    (visibility, contradicts)
}

/// Records how frame number `frame` sees every Gaussian. One that it sees has been observed, even if it was added where
/// depth was missing. A Gaussian is gone once `removal_frames` frames saw through it
/// and none saw it in between. If any is gone, returns for each Gaussian whether to keep it.
pub(crate) fn record_visibility(
    map: &mut SplatMap,
    visibility: &[Visibility],
    removal_frames: u8,
    frame: u32,
) -> Option<Vec<bool>> {
    let mut removed = Vec::new();
    for (index, seen) in visibility.iter().enumerate() {
        match seen {
            Visibility::Seen => {
                map.last_seen[index] = frame;
                map.seen_through[index] = 0;
                map.surfaces[index] = SurfaceKind::Observed;
            }
            Visibility::Replaced => {
                map.last_seen[index] = frame;
                map.seen_through[index] = map.seen_through[index].saturating_add(1);
            }
            Visibility::SeenThrough if removal_frames > 0 => {
                map.seen_through[index] = map.seen_through[index].saturating_add(1);
                if map.seen_through[index] >= removal_frames {
                    removed.push(index);
                }
            }
            _ => {}
        }
    }
    (!removed.is_empty()).then(|| {
        let mut keep = vec![true; map.len()];
        removed.into_iter().for_each(|index| keep[index] = false);
        keep
    })
}

/// Beyond `max_gaussians`, one in this many Gaussians is removed at once, so that a full map is not searched every
/// frame.
const REMOVED_BEYOND_LIMIT: usize = 16;

/// Returns for each Gaussian whether to keep it if there are more than `limit`: fifteen sixteenths of the limit stay,
/// the ones seen most recently, and of several last seen in the same frame the ones with the lowest index. `None` up to
/// the limit. `last_seen` contains the number of the last frame that saw each Gaussian.
pub(crate) fn longest_unseen(last_seen: &[u32], limit: usize) -> Option<Vec<bool>> {
    if last_seen.len() <= limit {
        return None;
    }
    let max = limit - limit / REMOVED_BEYOND_LIMIT;
    let mut order: Vec<usize> = (0..last_seen.len()).collect();
    order.select_nth_unstable_by_key(max, |index| (std::cmp::Reverse(last_seen[*index]), *index));
    let mut keep = vec![false; last_seen.len()];
    order[..max].iter().for_each(|index| keep[*index] = true);
    Some(keep)
}

/// Compares a Gaussian at `center`, camera coordinates, with the depths around it: a pose that is off by a pixel must
/// not make its place look free.
fn visibility_at(center: Vec3, frame: &RgbdFrame<'_>, settings: &MemorySettings) -> Visibility {
    let (width, height) = (frame.width(), frame.height());
    let Some(pixel) = frame.intrinsics().project(center) else { return Visibility::Unknown };
    let (column, row) = (pixel.x.round(), pixel.y.round());
    let is_inside = column >= 1.0 && row >= 1.0 && column + 2.0 <= width as f32 && row + 2.0 <= height as f32;
    if !is_inside {
        return Visibility::Unknown;
    }
    let (column, row) = (column as usize, row as usize);
    let margin = settings.tolerance_at(center.z);
    let (mut all_seen_through, mut any_seen) = (true, false);
    for row in row - 1..=row + 1 {
        for observed in &frame.depth().row(row)[column - 1..=column + 1] {
            all_seen_through &= *observed > center.z + margin;
            any_seen |= *observed > 0.0 && (observed - center.z).abs() <= margin;
        }
    }
    match (all_seen_through, any_seen) {
        (true, _) => Visibility::SeenThrough,
        (_, true) => Visibility::Seen,
        _ => Visibility::Unknown,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use splatseg_geometry::{Image, Intrinsics, LocalPose, Pose};

    const CAMERA: Intrinsics = Intrinsics { fx: 10.0, fy: 12.0, cx: 4.5, cy: 3.5, width: 10, height: 8 };

    fn frame(depth: Image<f32>) -> RgbdFrame<'static> {
        RgbdFrame::new("0", Image::filled(10, 8, [0; 3]), depth, CAMERA, Pose::IDENTITY).unwrap()
    }

    fn frame_of(depth: f32) -> RgbdFrame<'static> {
        frame(Image::filled(10, 8, depth))
    }

    /// The point that a pixel sees at this depth.
    fn point((column, row): (usize, usize), depth: f32) -> Vec3 {
        CAMERA.unproject(glam::Vec2::new(column as f32, row as f32), depth)
    }

    fn visibility_of(pixel: (usize, usize), depth: f32, frame: &RgbdFrame<'_>) -> Visibility {
        visibility_at(point(pixel, depth), frame, &MemorySettings::default())
    }

    #[test]
    fn a_gaussian_is_seen_within_the_margin_through_beyond_it_and_hidden_behind() {
        let at = |depth: f32, observed: f32| visibility_of((4, 4), depth, &frame_of(observed));
        // The margin is 10 cm, or 5 % of the distance if that is more.
        assert_eq!(
            [1.88, 1.92, 2.0, 2.08, 2.12].map(|depth| at(depth, 2.0)),
            [Visibility::SeenThrough, Visibility::Seen, Visibility::Seen, Visibility::Seen, Visibility::Unknown]
        );
        assert_eq!(
            [4.75, 4.77, 5.26, 5.27].map(|depth| at(depth, 5.0)),
            [Visibility::SeenThrough, Visibility::Seen, Visibility::Seen, Visibility::Unknown]
        );
        let halves = MemorySettings::default().with(|settings| settings.depth_tolerance = 0.5);
        assert_eq!(
            visibility_at(point((4, 4), 1.5), &frame_of(2.0), &halves),
            Visibility::Seen,
            "the margin itself is not beyond it"
        );
        assert_eq!(at(0.05, 0.0), Visibility::Unknown, "no depth is not a surface at the camera");
        assert_eq!(at(-2.0, 2.0), Visibility::Unknown, "behind the camera");
    }

    #[test]
    fn all_nine_pixels_must_see_through_and_one_must_see() {
        for neighbour in (3..=5).flat_map(|column| (3..=5).map(move |row| (column, row))) {
            let with = |depth: f32, all: f32| {
                let mut image = Image::filled(10, 8, all);
                image[neighbour] = depth;
                visibility_of((4, 4), 2.0, &frame(image))
            };
            assert_eq!(with(2.0, 3.0), Visibility::Seen, "{neighbour:?}");
            assert_eq!(with(1.0, 3.0), Visibility::Unknown, "{neighbour:?}");
            assert_eq!(with(0.0, 3.0), Visibility::Unknown, "{neighbour:?}");
            assert_eq!(with(2.0, 1.0), Visibility::Seen, "{neighbour:?}");
        }
        for beyond in [(2, 4), (6, 4), (4, 2), (4, 6)] {
            let mut image = Image::filled(10, 8, 3.0);
            image[beyond] = 2.0;
            assert_eq!(visibility_of((4, 4), 2.0, &frame(image)), Visibility::SeenThrough, "{beyond:?}");
        }
    }

    #[test]
    fn the_outermost_pixels_are_ignored() {
        let frame = frame_of(2.0);
        for pixel in (0..10).flat_map(|column| (0..8).map(move |row| (column, row))) {
            let is_outermost = pixel.0 == 0 || pixel.1 == 0 || pixel.0 == 9 || pixel.1 == 7;
            let expected = if is_outermost { Visibility::Unknown } else { Visibility::Seen };
            assert_eq!(visibility_of(pixel, 2.0, &frame), expected, "{pixel:?}");
        }
    }

    #[test]
    fn a_frame_alone_that_sees_through_more_than_half_removes_nothing() {
        let visibilities_of = |through: usize, seen: usize, hidden: usize, trust| {
            let mut map = Balls::default();
            for (count, depth) in [(through, 1.5), (seen, 2.0), (hidden, 2.5)] {
                (0..count).for_each(|_| map.push(point((4, 4), depth), 0.01));
            }
            let camera = Camera::new(CAMERA, &LocalPose::IDENTITY);
            visibilities(&map, &frame_of(2.0), &camera, trust, &MemorySettings::default())
        };
        use Visibility::{Seen, SeenThrough, Unknown};
        let (visibility, contradicts) = visibilities_of(2, 2, 1, FrameTrust::Alone);
        assert_eq!((&visibility[..], contradicts), (&[SeenThrough, SeenThrough, Seen, Seen, Unknown][..], false));
        let (visibility, contradicts) = visibilities_of(3, 2, 4, FrameTrust::Alone);
        assert_eq!((&visibility[..5], contradicts), (&[Unknown, Unknown, Unknown, Seen, Seen][..], true));
        let (visibility, contradicts) = visibilities_of(3, 2, 4, FrameTrust::Confirmed);
        assert_eq!((&visibility[..5], contradicts), (&[SeenThrough, SeenThrough, SeenThrough, Seen, Seen][..], true));
    }

    #[test]
    fn gaussians_that_are_seen_through_are_not_rendered() {
        let mut map = Balls::default();
        (0..3).for_each(|_| map.push(Vec3::Z, 0.1));
        let opacities = |visibility: &[Visibility]| {
            let visible = VisibleBalls::new(&map, visibility);
            assert_eq!(visible.count(), 3);
            [0, 1, 2].map(|index| visible.opacity(index) > 0.0)
        };
        assert_eq!(opacities(&[Visibility::Seen, Visibility::SeenThrough, Visibility::Unknown]), [true, false, true]);
        assert_eq!(opacities(&[]), [true; 3]);
    }

    #[test]
    fn removal_counts_frames_that_see_through_up_to_its_number() {
        let mut map = SplatMap::default();
        let new = |pixel| crate::NewGaussian {
            pixel,
            mean: Vec3::Z,
            radius: 0.1,
            color: [0; 3],
            surface: SurfaceKind::Assumed,
        };
        map.add(&[new(0), new(1), new(2)], 0, 0);
        let through_first = [Visibility::SeenThrough, Visibility::Seen, Visibility::Unknown];
        assert_eq!(record_visibility(&mut map, &through_first, 2, 5), None);
        assert_eq!((&map.last_seen[..], &map.seen_through[..]), (&[0, 5, 0][..], &[1, 0, 0][..]));
        use SurfaceKind::{Assumed, Observed};
        assert_eq!(map.surfaces, [Assumed, Observed, Assumed], "only what is seen is observed");
        let found =
            record_visibility(&mut map, &[Visibility::SeenThrough, Visibility::SeenThrough, Visibility::Unknown], 2, 6);
        assert_eq!(found, Some(vec![false, true, true]));
        assert_eq!(
            record_visibility(&mut map, &[Visibility::Seen, Visibility::Unknown, Visibility::Unknown], 2, 7),
            None
        );
        assert_eq!((&map.last_seen[..], &map.seen_through[..]), (&[7, 5, 0][..], &[0, 1, 0][..]));
        assert_eq!(record_visibility(&mut map, &[Visibility::SeenThrough; 3], 0, 8), None, "0: never");
        assert_eq!(map.seen_through, [0, 1, 0]);
    }
}
