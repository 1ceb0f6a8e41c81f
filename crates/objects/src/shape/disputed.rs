//! Disputed patches of an object: Gaussians that were also seen as another object.
//!
//! Where an object hides part of the floor, the floor's Gaussians beside it blend into the object's edge and get votes
//! for it; large ones, added from afar, extend several centimetres. But the object's own Gaussians are disputed too,
//! where a thing in front of it is seen for the first time. Their positions tell them apart: the object's own patches
//! continue its surface.

use super::patch_grid::PatchGrid;
use super::patches::Patch;
use super::plane::least_spread;
use glam::DVec3;
use std::collections::BTreeMap;

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
    let (mut own, disputed): (Vec<Patch>, Vec<Patch>) = patches.iter().partition(|patch| patch.share >= least);
    let mut disputed: Vec<Disputed> = disputed.into_iter().map(Disputed::new).collect();
    let mut first_new = 0;
    for _ in 0..ROUNDS {
        find_neighbours(&mut disputed, &own[first_new..]);
        first_new = own.len();
        let (added, left): (Vec<Disputed>, Vec<Disputed>) = disputed.into_iter().partition(Disputed::is_in_plane);
        disputed = left;
        own.extend(added.into_iter().map(|disputed| disputed.patch));
        if own.len() == first_new || disputed.is_empty() {
            break;
        }
    }
    own
}

/// A disputed patch, and the surface beside it as found so far.
struct Disputed {
    patch: Patch,
    /// Number of patches within reach.
    neighbours: usize,
    /// Sum of their offsets from the patch, in its sides.
    offsets: DVec3,
    /// Sum of the outer products of these offsets, by rows.
    products: [DVec3; 3],
    /// False if no neighbours were found since the last test.
    is_changed: bool,
}

impl Disputed {
    fn new(patch: Patch) -> Self {
        Self { patch, neighbours: 0, offsets: DVec3::ZERO, products: [DVec3::ZERO; 3], is_changed: false }
    }

    /// Adds the patches within reach; `near` are indices into `surface`.
    fn add_neighbours(&mut self, near: &[usize], surface: &[Patch]) {
        let (patch, before) = (self.patch, self.neighbours);
        let reach = REACH * patch.side;
        let offsets = near.iter().map(|index| surface[*index].mean - patch.mean);
        for offset in offsets.filter(|offset| offset.length_squared() <= reach * reach) {
            let offset = (offset / patch.side).as_dvec3();
            self.neighbours += 1;
            self.offsets += offset;
            self.products.iter_mut().zip(offset.to_array()).for_each(|(row, part)| *row += part * offset);
        }
        self.is_changed |= self.neighbours > before;
    }

    /// True if the patch lies in the plane of the surface beside it.
    fn is_in_plane(&self) -> bool {
        if !self.is_changed || self.neighbours < MIN_NEIGHBOURS {
            return false;
        }
        let middle = self.offsets / self.neighbours as f64;
        let mut spread = self.products;
        spread.iter_mut().zip(middle.to_array()).for_each(|(row, part)| *row -= part * self.offsets);
        least_spread(spread.map(DVec3::as_vec3)).dot(middle.as_vec3()).abs() <= OFF_PLANE
    }
}

/// Adds the patches of `surface` to the neighbours of the disputed ones. Each size of disputed patches has its own
/// grid, so that a few large ones, added from afar, do not make the cells of all others large.
fn find_neighbours(disputed: &mut [Disputed], surface: &[Patch]) {
    let mut sizes: BTreeMap<i32, Vec<&mut Disputed>> = BTreeMap::new();
    for disputed in disputed {
        disputed.is_changed = false;
        sizes.entry(disputed.patch.side.log2().floor() as i32).or_default().push(disputed);
    }
    let mut near = Vec::new();
    for disputed in sizes.into_values() {
        let reach = disputed.iter().map(|disputed| REACH * disputed.patch.side).fold(0.0, f32::max);
        let grid = PatchGrid::new(surface, reach);
        for disputed in disputed {
            grid.near(disputed.patch.mean, &mut near);
            disputed.add_neighbours(&near, surface);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    /// A patch of 2 cm.
    fn patch(place: Vec3, share: f32) -> Patch {
        Patch { share, ..Patch::seen(place, 0.02) }
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
