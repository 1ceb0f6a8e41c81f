//! `splatseg name`, and `find` with what it gives.

use crate::support::{Ended, ROOM, finish, map_with_floor, splatseg};
use splatseg::pipeline::NamedMap;
use splatseg_objects::RoomNameSource;
use splatseg_places::PlanSettings;
use std::fs;
use std::path::Path;

/// Saves a map of the room, without names.
fn save_map(folder: &Path) -> std::path::PathBuf {
    let map = folder.join("map.ply");
    let mut command = splatseg();
    command.args(["run", ROOM, "--no-page"]).arg("--out").arg(folder.join("out")).arg("--save-memory").arg(&map);
    assert_eq!(finish(&mut command).code, 0);
    map
}

fn name(map: &Path, more: &[&str]) -> Ended {
    finish(splatseg().arg("name").arg(map).args(more))
}

#[test]
fn labels_are_given_by_hand_and_found() {
    let folder = tempfile::tempdir().unwrap();
    let map = save_map(folder.path());
    let ended = name(&map, &[]);
    assert!(ended.code == 0 && ended.out.contains(" without a label: `splatseg inspect`"), "{}", ended.out);
    let objects = NamedMap::load(&map).unwrap().object_list().objects;
    assert_eq!(ended.out.split(' ').next(), Some(objects.len().to_string().as_str()), "{}", ended.out);
    let ids: Vec<String> = objects.iter().map(|object| object.id.to_string()).collect();
    let before = fs::read(&map).unwrap();

    // By hand and from a file, to a file of its own.
    let (labels, named) = (folder.path().join("labels.csv"), folder.path().join("named.ply"));
    fs::write(&labels, format!("id,label\n{},\"arm chair\"\n", ids[1])).unwrap();
    let mug = format!("{}=mug", ids[0]);
    let ended = name(&map, &[&mug, "--labels", labels.to_str().unwrap(), "--out", named.to_str().unwrap()]);
    assert!(ended.code == 0 && ended.out.contains(&format!("{} mug (by hand)", ids[0])), "{}{}", ended.out, ended.err);
    assert!(fs::read(&map).unwrap() == before, "the map itself is not changed");
    let found = finish(splatseg().arg("find").arg(&named).args(["coffee cup", "--json"]));
    let json: serde_json::Value = serde_json::from_str(&found.out).unwrap();
    assert_eq!((&json[0]["label"], json[0]["id"].to_string()), (&"mug".into(), ids[0].clone()), "{}", found.out);
    assert!(json[0]["shape"]["oriented_box"].is_object() && json.as_array().unwrap().len() == 1, "{json}");

    // Not over a file of others, and not over a map without being asked.
    let notes = folder.path().join("thesis.txt");
    fs::write(&notes, "mine").unwrap();
    let to = |out: &Path, more: &[&str]| name(&map, &[&["--out", out.to_str().unwrap(), &mug], more].concat());
    for more in [&[][..], &["--overwrite"]] {
        let ended = to(&notes, more);
        assert!(ended.code == 2 && ended.err.contains("thesis.txt: exists") && ended.out.is_empty(), "{}", ended.err);
        assert_eq!(fs::read_to_string(&notes).unwrap(), "mine");
    }
    let copy = folder.path().join("copy.ply");
    fs::copy(&named, &copy).unwrap();
    assert!(to(&copy, &[]).err.contains("give --overwrite"));
    assert_eq!((to(&copy, &["--overwrite"]).code, to(&map, &[]).code), (0, 0));
    fs::write(&map, &before).unwrap();

    // In place; an empty label takes one away.
    let ended = name(&named, &[&format!("{}=", ids[0])]);
    assert!(ended.code == 0 && !ended.out.contains("mug"), "{}", ended.out);
    let found = finish(splatseg().arg("find").arg(&named).arg("mug"));
    assert!(found.code == 0 && found.out.contains("the labels are arm chair"), "{}", found.out);

    merged_by_hand(&named, &objects.iter().map(|object| object.id).collect::<Vec<_>>());
}

/// Merges objects of a map, of which the second one has a label.
fn merged_by_hand(map: &Path, ids: &[u32]) {
    let (into, from) = (ids[0].min(ids[1]), ids[0].max(ids[1]));
    let points = |id: u32| {
        let list = NamedMap::load(map).unwrap().object_list();
        list.get(id).and_then(|object| Some(object.shape.as_ref()?.points))
    };
    let before = points(into).unwrap() + points(from).unwrap();
    for (wrong, said) in
        [(format!("merge:{from}=x"), "found \"x\""), (format!("merge:{from}={from}"), "two or more to merge")]
    {
        let ended = name(map, &[&wrong]);
        assert!(ended.code == 2 && ended.err.contains(said), "{}", ended.err);
    }
    let ended = name(map, &["merge:99999=1"]);
    assert!(ended.code == 2 && ended.err.contains("found no object 99999"), "{}", ended.err);
    // From a file, as the page saves it.
    let changes = map.with_extension("csv");
    fs::write(&changes, format!("id,label\nmerge:{from},{into}\n")).unwrap();
    let ended = name(map, &["--labels", changes.to_str().unwrap()]);
    assert!(
        ended.code == 0 && ended.out.contains(&format!("{into} arm chair (by hand)")),
        "{}{}",
        ended.out,
        ended.err
    );
    assert_eq!((points(into), points(from)), (Some(before), None));
}

#[test]
fn rooms_are_named_by_hand_or_by_their_objects() {
    let folder = tempfile::tempdir().unwrap();
    let map = map_with_floor(folder.path());
    let ended = name(&map, &[]);
    assert!(ended.out.contains("room:1 without a name, "), "{}{}", ended.out, ended.err);
    let ended = name(&map, &["room:3=hall"]);
    assert!(
        ended.code == 2 && ended.err.contains("room 3: found no such room, expected one of [1, 2]"),
        "{}",
        ended.err
    );
    let ended = name(&map, &["room:one=hall"]);
    assert!(ended.code == 2 && ended.err.contains("found \"room:one=hall\""), "{}", ended.err);

    // An object in the room tells what it is, until a person does.
    let mut named = NamedMap::load(&map).unwrap();
    let plan = named.floor_plan(PlanSettings::default()).unwrap();
    let in_first = |id: &&u32| plan.room_of(**id).is_some_and(|room| room.id == 1);
    let object = plan.footprints().keys().find(in_first).unwrap();
    let ended = name(&map, &[&format!("{object}=toilet")]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    assert!(name(&map, &[]).out.contains("room:1 bathroom (from its objects), "));
    let ended = name(&map, &["room:1=guest bathroom"]);
    assert!(ended.code == 0 && ended.out.contains("room:1 guest bathroom (by hand), "), "{}{}", ended.out, ended.err);
    named = NamedMap::load(&map).unwrap();
    let room = &named.scene_graph().unwrap().rooms[0];
    assert_eq!((room.name.as_deref(), room.name_source), (Some("guest bathroom"), Some(RoomNameSource::ByHand)));
    let exported =
        finish(splatseg().arg("export").arg(&map).args(["--as", "occupancy", "--out"]).arg(folder.path().join("home")));
    assert_eq!(exported.code, 0, "{}", exported.err);
    let plan: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(folder.path().join("home.json")).unwrap()).unwrap();
    assert_eq!(
        (&plan["rooms"][0]["name"], &plan["rooms"][0]["name_source"]),
        (&"guest bathroom".into(), &"by_hand".into())
    );
    assert!(name(&map, &["room:1="]).out.contains("room:1 bathroom (from its objects), "));
}

#[test]
fn colours_and_sizes_need_no_names() {
    let folder = tempfile::tempdir().unwrap();
    let map = save_map(folder.path());
    let found = finish(splatseg().arg("find").arg(&map).args(["the largest one", "--top", "1"]));
    assert!(found.code == 0 && found.out.contains("(size): "), "{}{}", found.out, found.err);
    let found = finish(splatseg().arg("find").arg(&map).args(["the grey one", "--json"]));
    assert!(found.code == 0 && found.out.starts_with('['), "{}{}", found.out, found.err);
}

#[test]
fn wrong_input_is_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let map = save_map(folder.path());
    let (labels, network) = (folder.path().join("labels.csv"), folder.path().join("network.safetensors"));
    fs::write(&labels, "1,mug\nmug\n").unwrap();
    fs::write(&network, [8, 0, 0, 0, 0, 0, 0, 0, b'{', b'}', b' ', b' ', b' ', b' ', b' ', b' ']).unwrap();
    let (labels, network) = (labels.to_str().unwrap(), network.to_str().unwrap());
    for (more, problem) in [
        (&["9999=mug"][..], "no object 9999"),
        (&["mug"], "found \"mug\""),
        (&["--labels", labels], "line 2: found \"mug\""),
        (&["--names", network], "expected a CLIP network"),
        (&["--names", "nowhere.safetensors"], "nowhere.safetensors"),
        (&["--names", network, "--min-score", "2"], "--min-score: found 2"),
    ] {
        let ended = name(&map, more);
        assert!(ended.code == 2 && ended.err.contains(problem) && ended.err.lines().count() == 1, "{}", ended.err);
    }
    let mut run = splatseg();
    run.args(["run", ROOM, "--out"]).arg(folder.path().join("new")).args(["--names", network]);
    let ended = finish(&mut run);
    assert!(ended.code == 2 && ended.err.contains("expected a CLIP network"), "{}", ended.err);
    let mut run = splatseg();
    run.args(["run", ROOM, "--out"]).arg(folder.path().join("new")).args(["--vocabulary", labels]);
    assert!(finish(&mut run).err.contains("namer = clip"));
}
