//! Messages after others that were missed.

use crate::support::{Published, play, setting};
use splatseg_live::{LiveOptions, Output};
use splatseg_ros::{MarkerArray, action, from_cdr};
use std::collections::BTreeSet;

/// The messages of a kind, in order.
fn of_kind(published: &Published, wanted: Output) -> Vec<Vec<u8>> {
    let published = published.lock().unwrap();
    published.iter().filter(|(output, _)| *output == wanted).map(|(_, message)| message.clone()).collect()
}

/// The objects whose markers a viewer shows that gets these messages.
fn shown_after(messages: &[&[u8]]) -> BTreeSet<i32> {
    let mut shown = BTreeSet::new();
    for message in messages {
        for marker in from_cdr::<MarkerArray<'_>>(message).unwrap().markers {
            match marker.action {
                action::DELETE_ALL => shown.clear(),
                action::DELETE => drop(shown.remove(&marker.id)),
                _ => drop(shown.insert(marker.id)),
            }
        }
    }
    shown
}

#[test]
fn a_viewer_that_misses_markers_shows_no_object_that_is_gone() {
    let mut setting = setting(LiveOptions::default(), None);
    play(&mut setting);
    let list = setting.session.objects().objects;
    let in_map: Vec<u32> = list.iter().filter(|object| object.shape.is_some()).map(|object| object.id).collect();
    let (into, from) = (in_map[0].min(in_map[1]), in_map[0].max(in_map[1]));
    setting.session.merge_objects(&[from, into]).unwrap();
    setting.session.name_by_hand(into, Some("mug")).unwrap();
    let messages = of_kind(&setting.published, Output::Markers);
    let [.., before, _missed, after] = messages.as_slice() else { panic!("{} messages", messages.len()) };
    assert!(shown_after(&[before]).contains(&(from as i32)));
    let all = shown_after(&[after]);
    assert!(all.contains(&(into as i32)) && !all.contains(&(from as i32)), "{all:?}");
    assert_eq!(shown_after(&[before, after]), all);
}
