//! Which patches an object shares with another thing: Gaussians that were seen as either.
//!
//! In frames in which an object hides part of the floor, the floor's Gaussians beside it shine through the object's edge
//! and get votes for it; large ones, from afar, reach several centimetres out. But the object's own Gaussians are disputed
//! too, where a thing in front of it is seen for the first time. They differ in where they lie: the object's own go on
//! with its surface.

use super::patch_grid::PatchGrid;
use super::patches::Patch;
use super::plane::normal;
use glam::Vec3;

/// Patches of which the object has less than this share, relative to the object's median, are disputed. Two thirds:
/// twice as many votes for it as for all else.
const MIN_SHARE: f32 = 2.0 / 3.0;
/// A disputed patch goes on with those within this many of its sides: a surface seen at a slant has few...
const REACH: f32 = 6.0;
/// ...if there are as many of them as span a plane...
const MIN_NEIGHBOURS: usize = 4;
/// ...and it lies no farther from that plane than this many of its sides.
const OFF_PLANE: f32 = 0.5;
/// How often patches that were found to go on with the surface are taken in before the next ones are looked at.
const ROUNDS: usize = 16;

/// The patches that are not disputed or go on with the surface of those that are not. The median is never disputed, so
/// some are left.
pub(super) fn undisputed(patches: &[Patch]) -> Vec<Patch> {
    let mut shares: Vec<f32> = patches.iter().map(|patch| patch.share).collect();
    shares.sort_unstable_by(f32::total_cmp);
    let least = shares.get(shares.len() / 2).map_or(0.0, |median| MIN_SHARE * median);
    let (mut own, mut disputed): (Vec<Patch>, Vec<Patch>) = patches.iter().partition(|patch| patch.share >= least);
    let reach = disputed.iter().map(|patch| REACH * patch.side).fold(0.0, f32::max);
    for _ in 0..ROUNDS {
        let grid = PatchGrid::new(&own, reach);
        let (going_on, left): (Vec<Patch>, Vec<Patch>) = disputed.iter().partition(|patch| goes_on(patch, &own, &grid));
        disputed = left;
        if going_on.is_empty() || disputed.is_empty() {
            own.extend(going_on);
            break;
        }
        own.extend(going_on);
    }
    own
}

/// Whether a patch lies in the plane of the surface beside it.
fn goes_on(patch: &Patch, surface: &[Patch], grid: &PatchGrid) -> bool {
    let reach = REACH * patch.side;
    let mut near = Vec::new();
    grid.near(patch.mean, &mut near);
    near.retain(|index| surface[*index].mean.distance_squared(patch.mean) <= reach * reach);
    if near.len() < MIN_NEIGHBOURS {
        return false;
    }
    let middle = near.iter().map(|index| surface[*index].mean).sum::<Vec3>() / near.len() as f32;
    let normal = normal(near.iter().map(|index| ((surface[*index].mean - middle) / patch.side, 1.0)));
    normal.dot(patch.mean - middle).abs() <= OFF_PLANE * patch.side
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A patch of 2 cm.
    fn patch(place: Vec3, share: f32) -> Patch {
        Patch { mean: place, side: 0.02, cover: 0.02, color: [0; 3], share }
    }

    /// The front of a box, 40 cm wide and high; `share` by the distance from its left edge, metres.
    fn front(share: impl Fn(f32) -> f32) -> Vec<Patch> {
        let place = |index: usize| Vec3::new((index % 20) as f32 * 0.02, 0.0, (index / 20) as f32 * 0.02);
        (0..400).map(|index| patch(place(index), share(place(index).x))).collect()
    }

    #[test]
    fn the_floor_before_an_object_goes() {
        let whole = front(|_| 0.9);
        // Seen as the object in a little more than half of the votes.
        let floor = (0..20).map(|index| patch(Vec3::new(index as f32 * 0.02, -0.05, 0.0), 0.55));
        let all: Vec<Patch> = whole.iter().copied().chain(floor).collect();
        assert_eq!(undisputed(&all), whole);
        // Twice as many votes as for all else are enough.
        let sure = Patch { share: 0.61, ..all[400] };
        assert!(undisputed(&[whole, vec![sure]].concat()).contains(&sure));
    }

    #[test]
    fn disputed_patches_that_go_on_with_the_surface_stay() {
        let patches = front(|x| if x < 0.25 { 1.0 } else { 0.5 });
        assert_eq!(undisputed(&patches).len(), patches.len());
        // But not those that nothing of the surface is near.
        let apart = patch(Vec3::new(0.6, 0.0, 0.2), 0.5);
        assert!(!undisputed(&[front(|_| 1.0), vec![apart]].concat()).contains(&apart));
    }

    #[test]
    fn an_object_that_is_disputed_all_over_stays() {
        let patches = front(|_| 0.5);
        assert_eq!(undisputed(&patches), patches);
        assert!(undisputed(&[]).is_empty());
    }
}
