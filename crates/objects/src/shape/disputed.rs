//! Disputed patches of an object: Gaussians that were also seen as another object.
//!
//! Where an object hides part of the floor, the floor's Gaussians beside it blend into the object's edge and get votes
//! for it; large ones, added from afar, extend several centimetres. But the object's own Gaussians are disputed too,
//! where a thing in front of it is seen for the first time. Their positions tell them apart: the object's own patches
//! continue its surface.

use super::patch_grid::PatchGrid;
use super::patches::Patch;
use super::plane::normal;
use glam::Vec3;

/// A patch is disputed if the object's share of it, relative to the object's median share, is below this. Two thirds
/// means twice as many votes for the object as for all others.
const MIN_SHARE: f32 = 2.0 / 3.0;
/// A disputed patch belongs to the object if the undisputed patches within this many of its sides (a surface seen at a
/// slant has few)...
const REACH: f32 = 6.0;
/// ...number at least this many, enough to fit a plane...
const MIN_NEIGHBOURS: usize = 4;
/// ...and it lies within this many of its sides of that plane.
const OFF_PLANE: f32 = 0.5;
/// Maximum number of rounds; each adds the patches that continue the surface found so far.
const ROUNDS: usize = 16;

/// The patches that are not disputed, or that continue the surface of the undisputed ones. The median patch is never
/// disputed, so some are left.
pub(super) fn undisputed(patches: &[Patch]) -> Vec<Patch> {
    let mut shares: Vec<f32> = patches.iter().map(|patch| patch.share).collect();
    shares.sort_unstable_by(f32::total_cmp);
    let least = shares.get(shares.len() / 2).map_or(0.0, |median| MIN_SHARE * median);
    let (mut own, mut disputed): (Vec<Patch>, Vec<Patch>) = patches.iter().partition(|patch| patch.share >= least);
    let reach = disputed.iter().map(|patch| REACH * patch.side).fold(0.0, f32::max);
    for _ in 0..ROUNDS {
        let grid = PatchGrid::new(&own, reach);
        let (added, left): (Vec<Patch>, Vec<Patch>) =
            disputed.iter().partition(|patch| is_in_plane(patch, &own, &grid));
        disputed = left;
        if added.is_empty() || disputed.is_empty() {
            own.extend(added);
            break;
        }
        own.extend(added);
    }
    own
}

/// True if a patch lies in the plane of the surface beside it.
fn is_in_plane(patch: &Patch, surface: &[Patch], grid: &PatchGrid) -> bool {
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
        // Twice as many votes as for all others are enough.
        let sure = Patch { share: 0.61, ..all[400] };
        assert!(undisputed(&[whole, vec![sure]].concat()).contains(&sure));
    }

    #[test]
    fn disputed_patches_that_go_on_with_the_surface_stay() {
        let patches = front(|x| if x < 0.25 { 1.0 } else { 0.5 });
        assert_eq!(undisputed(&patches).len(), patches.len());
        // But patches far from the surface go.
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
