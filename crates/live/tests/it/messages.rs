//! Messages after others that were missed, or that say nothing true any more.

use crate::support::{Published, play, setting};
use splatseg::settings::SettingsLayers;
use splatseg::{Pipeline, Settings};
use splatseg_geometry::{Image, Intrinsics, Pose, RgbdFrame};
use splatseg_live::{LiveOptions, Output};
use splatseg_ros::{MarkerArray, OccupancyGrid, action, from_cdr};
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

/// Who drives by the grid must not see walls of which nothing is known any more.
#[test]
fn a_plan_that_fails_takes_back_the_grid_of_the_one_before() {
    let mut setting = setting(LiveOptions::default(), None);
    play(&mut setting);
    let before = of_kind(&setting.published, Output::Map);
    let known: OccupancyGrid = from_cdr(before.last().unwrap()).unwrap();
    assert!(known.data.contains(&0) && known.data.contains(&100));
    // A map without a floor in place of the one that had one: a surface of a few square centimetres.
    let settings: Settings = SettingsLayers::default().resolve().unwrap();
    let mut pipeline = Pipeline::builder(&settings).build().unwrap();
    let camera = Intrinsics { fx: 100.0, fy: 100.0, cx: 32.0, cy: 24.0, width: 64, height: 48 };
    let images = (Image::filled(64, 48, [90; 3]), Image::filled(64, 48, 0.3));
    pipeline.step(&RgbdFrame::new("0", images.0, images.1, camera, Pose::IDENTITY).unwrap()).unwrap();
    *setting.session.pipeline_mut() = pipeline;
    setting.session.run(&mut || true).unwrap();
    let places = setting.session.status().places.clone().unwrap();
    assert!(places.contains("no floor"), "{places}");
    let after = of_kind(&setting.published, Output::Map);
    assert_eq!(after.len(), before.len() + 1);
    let unknown: OccupancyGrid = from_cdr(after.last().unwrap()).unwrap();
    assert_eq!((&unknown.header.frame_id, &unknown.info.origin), (&known.header.frame_id, &known.info.origin));
    assert_eq!(unknown.data, vec![-1; known.data.len()]);
}
