//! Two saved maps of one place, from two days or two robots, become one.
//!
//! 1. The keyframes of both are joined: [`join_keyframes`] finds how the maps lie to each other, and corrects both.
//! 2. The changes between the maps are found (`splatseg_objects::MapChanges`). The later map is right: what it looked
//!    through is removed from the earlier one (`changed.rs`), also from the depth of its keyframes.
//! 3. Surfaces and ids that both have become one ([`SplatMemory::join`](splatseg_memory::SplatMemory::join)), and their
//!    names (`names.rs`).

mod changed;
mod error;
mod names;
mod report;

pub use error::MergeError;
pub use names::LabelConflict;
pub use report::{MergeReport, MergedKeyframes, MergedObject};

use crate::pipeline::NamedMap;
use changed::{Changed, removed, views};
use names::joined_names;
use report::ObjectIds;
use splatseg_geometry::Pose;
use splatseg_objects::SeenTimes;
use splatseg_odometry::{JoinedKeyframes, erase_surfaces, join_keyframes};

/// How maps are merged.
#[derive(Clone, Copy, Debug, Default)]
pub struct MergeOptions {
    /// Pose of the later map's world in the earlier one's, if it is known. Then nothing needs to be recognised, and the maps
    /// need not overlap.
    pub earlier_from_later: Option<Pose>,
}

/// A map that was made of two, and how.
pub struct MergedMap {
    /// The map, in the world coordinates of the earlier one.
    pub map: NamedMap,
    /// Report on the two maps.
    pub report: MergeReport,
}

/// Merges two maps of one place. Where they differ, `later` is right.
///
/// The same maps give the same result, byte for byte. A map may be merged again with a third one.
///
/// # Errors
/// [`MergeError`] if the maps do not overlap or do not fit, have no keyframes, or do not remember votes.
pub fn merge_maps(earlier: NamedMap, later: NamedMap, options: &MergeOptions) -> Result<MergedMap, MergeError> {
    let (mut earlier, mut later) = (earlier, later);
    let keyframes = |map: &NamedMap, which| map.keyframes.clone().ok_or(MergeError::NoKeyframes { which });
    let of_earlier = keyframes(&earlier, "earlier")?;
    let of_later = keyframes(&later, "later")?;
    if [&earlier, &later].iter().any(|map| !map.memory.can_join()) {
        return Err(MergeError::Memory(splatseg_memory::MemoryError::CannotJoin));
    }
    let joined = join_keyframes(&of_earlier, &of_later, options.earlier_from_later.as_ref())?;
    let JoinedKeyframes { keyframes, first_later, fit, .. } = &joined;
    earlier.memory.correct(&joined.earlier);
    later.memory.correct(&joined.later);
    let earlier_views = views(&of_earlier, None, &joined.earlier)?;
    let later_views = views(&of_later, Some(&of_earlier), &joined.later)?;
    earlier.names.rooms_mut().correct(&joined.earlier, &earlier_views.cameras);
    earlier.history.rooms.correct(&joined.earlier, &earlier_views.cameras);
    let ids = ObjectIds::new(&earlier, &later);
    let changed = Changed::new(&earlier.memory, &later.memory, [earlier_views.views, later_views.views]);
    if options.earlier_from_later.is_none() {
        changed.require_agreement(fit.earlier_from_later)?;
    }
    let kept = changed.kept_gaussians(&earlier.memory);
    let keyframes = erase_surfaces(keyframes, *first_later, &removed(&earlier.memory.map(), &kept))?;
    earlier.memory.keep_gaussians(&kept);
    let joined_ids = earlier.memory.join(later.memory, *first_later, &changed.same())?;
    let mut seen = SeenTimes::default();
    for (id, time) in later.history.seen().all() {
        if let Some(given) = joined_ids.given().get(&id) {
            seen.add(*given, time);
        }
    }
    earlier.history.add_earlier(&seen);
    earlier.history.remap(joined_ids.remapped());
    let (names, conflicts) = joined_names(&earlier.names, &later.names, &joined_ids, &fit.earlier_from_later)?;
    (earlier.names, earlier.keyframes) = (names, Some(keyframes));
    earlier.names.keep_only(&earlier.memory.map().carried_ids());
    let report = MergeReport::new(fit, &ids, &joined_ids, &earlier, changed, conflicts);
    Ok(MergedMap { map: earlier, report })
}
