//! `splatseg route`: ways between objects, rooms and places.

use crate::support::{Ended, finish, map_with_floor, splatseg};
use glam::DVec2;
use serde_json::Value;
use splatseg::pipeline::NamedMap;
use splatseg_places::{Cell, PlanSettings};
use std::path::Path;

fn route(map: &Path, words: &[&str]) -> Ended {
    finish(splatseg().arg("route").arg(map).args(words))
}

#[test]
fn ways_lead_over_free_cells_to_objects_rooms_and_places() {
    let folder = tempfile::tempdir().unwrap();
    let map = map_with_floor(folder.path());
    let mut named = NamedMap::load(&map).unwrap();
    let plan = named.floor_plan(PlanSettings::default()).unwrap();
    // The largest room, and an object that a robot can reach from its middle.
    let room = plan.rooms().iter().max_by(|one, other| one.area_m2.total_cmp(&other.area_m2)).unwrap();
    let reached = |id: &&u32| plan.route_to_object(room.middle, **id, 0.2).is_ok();
    let object = *plan.footprints().keys().find(reached).unwrap();
    named.names.set_by_hand(object, Some("Mug")).unwrap();
    named.save(&map).unwrap();

    let from = format!("room:{}", room.id);
    let ended = route(&map, &[&from, "mug", "--json"]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    let json: Value = serde_json::from_str(&ended.out).unwrap();
    let points: Vec<DVec2> = serde_json::from_value(json["points"].clone()).unwrap();
    assert!(points[0].distance(room.middle) < 0.7 && points.len() == json["points_world"].as_array().unwrap().len());
    for pair in points.windows(2) {
        assert!((0..=50).all(|step| plan.grid().at(pair[0].lerp(pair[1], f64::from(step) / 50.0)) == Cell::Free));
    }
    let stands: DVec2 = serde_json::from_value(json["approach"]["place"].clone()).unwrap();
    assert!(stands.distance(*points.last().unwrap()) < 0.1 && json["clearance_m"].as_f64().unwrap() >= 0.2);

    // By id and as text, between places of the plan and of the world.
    let text = route(&map, &[&from, &object.to_string()]);
    assert!(text.code == 0 && text.out.contains(" m, at least ") && text.out.contains("then turn to"), "{}", text.out);
    let place = |point: DVec2| format!("{},{}", point.x, point.y);
    let world = plan.frame().to_world(points[0]).to_array().map(|number| number.to_string()).join(",");
    let ended = route(&map, &["--json", "--", &place(stands), &world]);
    let back: Value = serde_json::from_str(&ended.out).unwrap_or_else(|_| panic!("{}", ended.err));
    assert!((back["length_m"].as_f64().unwrap() - json["length_m"].as_f64().unwrap()).abs() < 0.3);
    assert!(back["approach"].is_null());

    for (words, problem) in [
        ([&from, "cup"], "found no object with the label \"cup\""),
        ([&from, "99999"], "99999"),
        (["room:hall", "mug"], "room:hall: found no such room, expected 1 to"),
        ([&from, "500,500"], "free"),
        ([&from, "1,2,3,4"], "found the place \"1,2,3,4\""),
    ] {
        let ended = route(&map, &words);
        assert!(ended.code == 2 && ended.err.contains(problem), "{words:?}: {}", ended.err);
    }
    let ended = route(&map, &[&from, "mug", "--robot-radius", "9"]);
    assert!(ended.code == 2 && ended.err.contains("--robot-radius"), "{}", ended.err);
}
