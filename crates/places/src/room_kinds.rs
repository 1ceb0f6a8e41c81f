//! The kind of a room, from the things in it.

use std::collections::BTreeSet;

/// Kinds of rooms, and labels of things that stand in no other kind.
const KINDS: [(&str, &[&str]); 5] = [
    (
        "kitchen",
        &[
            "stove",
            "cooker",
            "range",
            "hob",
            "cooktop",
            "oven",
            "refrigerator",
            "fridge",
            "dishwasher",
            "kitchen sink",
            "range hood",
            "extractor hood",
        ],
    ),
    ("bathroom", &["toilet", "bathtub", "bath", "shower", "shower cabin", "bidet"]),
    ("bedroom", &["bed", "double bed", "single bed", "bunk bed", "bed frame", "crib", "cot"]),
    ("living room", &["sofa", "couch", "settee", "sectional sofa", "corner sofa"]),
    ("laundry room", &["washing machine", "washer", "tumble dryer", "clothes dryer"]),
];
/// A room with things of the first kind and of the second is of the first: a sofa may stand in a bedroom, and a washing
/// machine in a bathroom or a kitchen.
const STRONGER: [(&str, &str); 4] = [
    ("bedroom", "living room"),
    ("bathroom", "laundry room"),
    ("kitchen", "laundry room"),
    ("bedroom", "laundry room"),
];

/// The kind of a room with things of these labels; `None` if none tells, or if they tell different kinds.
pub(crate) fn room_kind<'a>(labels: impl Iterator<Item = &'a str>) -> Option<&'static str> {
    let kind_of = |label: &str| {
        let label = label.trim().to_lowercase();
        KINDS.into_iter().find(|(_, things)| things.contains(&label.as_str())).map(|(kind, _)| kind)
    };
    let mut kinds: BTreeSet<&'static str> = labels.filter_map(kind_of).collect();
    for (kind, weaker) in STRONGER {
        if kinds.contains(kind) {
            kinds.remove(weaker);
        }
    }
    kinds.pop_first().filter(|_| kinds.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn things_tell_a_room_unless_they_contradict() {
        let kind = |labels: &[&str]| room_kind(labels.iter().copied());
        assert_eq!(kind(&["chair", "Fridge", "mug"]), Some("kitchen"));
        assert_eq!(kind(&["sofa", "bed"]), Some("bedroom"));
        assert_eq!(kind(&["washing machine", "toilet"]), Some("bathroom"));
        assert_eq!(kind(&["washing machine"]), Some("laundry room"));
        for unknown in [&["sofa", "stove"][..], &["toilet", "bed"], &["dog bed", "oven mitt", "toilet paper"], &[]] {
            assert_eq!(kind(unknown), None, "{unknown:?}");
        }
    }
}
