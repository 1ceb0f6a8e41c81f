//! The names of two maps' objects.

use serde::Serialize;
use splatseg_geometry::{Pose, RemappedId, SegmentId};
use splatseg_memory::JoinedIds;
use splatseg_objects::{NameError, ObjectNames};

/// An object that both maps name, differently.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct LabelConflict {
    /// Its id in the merged map.
    pub id: SegmentId,
    /// The label that it has now.
    pub kept: String,
    /// The other map's label.
    pub dropped: String,
}

/// The names of both maps by the merged map's ids. Of two names of an object, the one that a person gave stays, of two such
/// ones the later map's, and otherwise the one from the better view. Of two names of a room, the later map's holds.
///
/// # Errors
/// If the embeddings of the two maps have different lengths, or all names take too much room.
pub(super) fn joined_names(
    earlier: &ObjectNames,
    later: &ObjectNames,
    ids: &JoinedIds,
    earlier_from_later: &Pose,
) -> Result<(ObjectNames, Vec<LabelConflict>), NameError> {
    let mut names = earlier.clone();
    for (id, name, score) in later.all() {
        if let Some(given) = ids.given().get(&id) {
            names.set(*given, name.clone(), score)?;
        }
    }
    names.rooms_mut().add_all(later.rooms(), earlier_from_later)?;
    let mut conflicts = Vec::new();
    for remapped in ids.remapped() {
        join_names(&mut names, *remapped, &mut conflicts);
    }
    Ok((names, conflicts))
}

fn join_names(names: &mut ObjectNames, ids: RemappedId, conflicts: &mut Vec<LabelConflict>) {
    let label = |names: &ObjectNames, id| names.label(id).map(str::to_owned);
    let by_hand = |names: &ObjectNames, id| names.name(id).is_some_and(|name| name.by_hand);
    let labels = [label(names, ids.into), label(names, ids.from)];
    if by_hand(names, ids.from) && by_hand(names, ids.into) {
        // The later map is right.
        names.forget(ids.into);
    }
    names.remap(&[ids]);
    let [Some(earlier), Some(later)] = labels else { return };
    if earlier != later {
        let kept = label(names, ids.into).unwrap_or_default();
        let dropped = if kept == earlier { later } else { earlier };
        conflicts.push(LabelConflict { id: ids.into, kept, dropped });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use splatseg_objects::ObjectName;

    const JOIN: RemappedId = RemappedId { from: 12, into: 2 };

    fn by_network(label: &str) -> ObjectName {
        ObjectName { label: Some(label.to_owned()), ..ObjectName::default() }
    }

    /// The label after two names of an object became one, and a note about the other.
    fn joined(earlier: ObjectName, later: ObjectName) -> (String, Option<String>) {
        let mut names = ObjectNames::default();
        names.set(JOIN.into, earlier, 1.0).unwrap();
        names.set(JOIN.from, later, 2.0).unwrap();
        let mut conflicts = Vec::new();
        join_names(&mut names, JOIN, &mut conflicts);
        assert!(names.name(JOIN.from).is_none() && conflicts.len() <= 1);
        (names.label(JOIN.into).unwrap().to_owned(), conflicts.pop().map(|conflict| conflict.dropped))
    }

    #[test]
    fn labels_by_hand_stay_and_of_two_the_later() {
        let (mug, cup) = (|| ObjectName::by_hand("mug"), || ObjectName::by_hand("cup"));
        let told = |kept: &str, dropped: &str| (kept.to_owned(), Some(dropped.to_owned()));
        assert_eq!(joined(mug(), by_network("cup")), told("mug", "cup"));
        assert_eq!(joined(by_network("mug"), cup()), told("cup", "mug"));
        assert_eq!(joined(mug(), cup()), told("cup", "mug"));
        assert_eq!(joined(by_network("mug"), by_network("cup")), told("cup", "mug"), "the better view");
        assert_eq!(joined(mug(), mug()), ("mug".to_owned(), None));
        assert_eq!(joined(mug(), ObjectName::default()), ("mug".to_owned(), None));
    }
}
