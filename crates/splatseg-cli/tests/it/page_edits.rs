//! Objects that are merged and labelled by hand on the page of a run, in a real browser.

use crate::page_browser::{open, room_with_map};
use crate::page_controls::room;
use serde_json::{Value, json};
use splatseg_dataset::read_segments_png;

/// Two objects that count, are in the map, and are seen side by side in this frame, with a pixel of the second one.
fn two_objects(frame: usize) -> (u32, u32, [f64; 2]) {
    let run = crate::page_controls::run_data(&room_with_map().join("viewer/run.js"));
    let ids = read_segments_png(&room_with_map().join(format!("segments/{frame:06}.png"))).unwrap();
    let areas = ids.areas();
    let objects = run["objects"].as_array().unwrap();
    let fits = |object: &&Value| {
        object["state"] == "remembered"
            && object["gaussians"].as_u64() > Some(50)
            && object["frames"].as_u64() > Some(1)
    };
    let found = objects.iter().filter(fits).map(|object| object["id"].as_u64().unwrap() as u32);
    let mut found: Vec<u32> = found.filter(|id| areas.get(id).is_some_and(|area| *area > 100)).collect();
    found.sort_unstable();
    let (one, other) = (found[0], found[1]);
    // The middle of the longest run of its pixels in a row.
    let mut best = (0, [0.0; 2]);
    for row in 0..ids.height() {
        let mut length = 0_usize;
        for column in 0..ids.width() {
            length = if ids[(column, row)] == other { length + 1 } else { 0 };
            let middle =
                [(column as f64 - length as f64 / 2.0) / ids.width() as f64, (row as f64 + 0.5) / ids.height() as f64];
            best = if length > best.0 { (length, middle) } else { best };
        }
    }
    (one, other, best.1)
}

#[test]
fn objects_are_merged_by_hand_in_all_views_and_it_is_kept_and_taken_back() {
    let test = "objects_are_merged_by_hand_in_all_views_and_it_is_kept_and_taken_back";
    let Some(mut browser) = room(test, (1000, 720), "#frame=2") else { return };
    let (one, other, place) = two_objects(2);
    let gaussians = |id: u32| format!("splatsegPage.map.splats.ids.filter((id) => id === {id}).length");
    let before = [one, other].map(|id| browser.value(&gaussians(id)).as_u64().unwrap());
    browser.click_on(&format!("#list [data-object='{one}']"));
    browser.press("u");
    // The other one is chosen in the picture.
    let (left, top, width, height) = browser.place_of("#picture");
    let at = (left + place[0] * width, top + place[1] * height);
    browser.click(at.0, at.1);
    let chosen = "[...document.querySelectorAll('#list .chosen button')].map((row) => Number(row.dataset.object)).sort((one, other) => one - other)";
    assert_eq!(browser.value(chosen), json!([one, other]));
    assert_eq!(browser.value("document.documentElement.dataset.object"), one.to_string(), "the selection stays");
    browser.click_on("#merge");
    browser.wait_for("!document.getElementById('drawn').hidden");
    let merged = json!([before[0] + before[1], 0]);
    let counts = format!("[{}, {}]", gaussians(one), gaussians(other));
    assert_eq!(browser.value(&counts), merged);
    assert_eq!(browser.value(&format!("document.querySelectorAll('[data-object=\"{other}\"]').length")), 0);
    // It is seen wherever one of them was.
    let frames = (0..6).filter(|frame| {
        let ids = read_segments_png(&room_with_map().join(format!("segments/{frame:06}.png"))).unwrap();
        ids.pixels().iter().any(|id| [one, other].contains(id))
    });
    assert_eq!(browser.value(&format!("splatsegPage.run.byId.get({one}).frames")), frames.count());
    // In the picture, the other one is the first one, now.
    browser.press("Escape");
    browser.click(at.0, at.1);
    assert_eq!(browser.value("document.documentElement.dataset.object"), one.to_string());

    // A label; keys are typed into it.
    browser.press("n");
    browser.call("Input.insertText", json!({ "text": "mug" }));
    browser.press("m");
    browser.click_on("#objects form button");
    let title = "document.querySelector('#info h2').textContent";
    browser.wait_for(&format!("{title} === 'Object {one}: mug'"));
    assert_eq!(browser.value("document.getElementById('stage').classList.contains('measuring')"), false);

    // As `splatseg name --labels` reads it.
    assert_eq!(browser.value("splatsegPage.edits.lines"), format!("id,label\nmerge:{other},{one}\n{one},\"mug\"\n"));

    // The browser keeps it, and so does the link.
    browser.wait_for("location.hash.includes('mug')");
    let link = browser.value("location.hash");
    let state = format!("[splatsegPage.run.byId.get({one}).label, splatsegPage.run.byId.has({other}), ...{counts}]");
    let edited = json!(["mug", false, merged[0], 0]);
    browser.open_url("about:blank");
    open(&mut browser, room_with_map(), "");
    assert_eq!(browser.value(&state), edited);
    browser.value("document.activeElement.blur()");
    browser.press("z");
    assert_eq!(browser.value(&state), json!([null, false, merged[0], 0]));
    browser.click_on("#undo");
    assert_eq!(browser.value(&state), json!([null, true, before[0], before[1]]));
    assert_eq!(browser.value("document.getElementById('undo').hidden"), true);
    assert_eq!(browser.value("document.getElementById('picture').hidden"), false, "the run's own overlay again");
    browser.open_url("about:blank");
    open(&mut browser, room_with_map(), link.as_str().unwrap());
    assert_eq!(browser.value(&state), edited);
    assert_eq!(browser.value("localStorage.length"), 0, "whoever opens a link has changed nothing");

    // A link does not take the place of what the browser has kept.
    let own = json!(["own", true, before[0], before[1]]);
    browser.open_url("about:blank");
    open(&mut browser, room_with_map(), "");
    browser.value(&format!("splatsegPage.edits.rename({one}, 'own')"));
    browser.open_url("about:blank");
    open(&mut browser, room_with_map(), link.as_str().unwrap());
    assert_eq!(browser.value(&state), edited);
    browser.click_on("#kept-edits");
    assert_eq!(browser.value(&state), own);
    assert_eq!(browser.value("document.getElementById('kept-edits').hidden"), true, "the link has the others");

    // What is wrong in a link is left out.
    browser.value("localStorage.clear()");
    for wrong in ["[[\"merge\",1,999999]]", "[[\"name\",1]]", "{}", "x"] {
        browser.open_url("about:blank");
        open(&mut browser, room_with_map(), &format!("#edits={wrong}"));
        assert_eq!(browser.value(&state), json!([null, true, before[0], before[1]]), "{wrong}");
    }
    assert_eq!(browser.errors, [] as [String; 0]);
}

#[test]
fn merging_can_be_cancelled_and_needs_two_objects() {
    let test = "merging_can_be_cancelled_and_needs_two_objects";
    let Some(mut browser) = room(test, (400, 850), "#frame=2") else { return };
    let (one, other, _) = two_objects(2);
    let is_open = "!document.getElementById('merging').hidden";
    browser.press("u");
    assert_eq!(browser.value(is_open), false, "nothing is selected");
    browser.value(&format!("splatsegPage.select({one})"));
    browser.press("u");
    assert_eq!(
        browser.value("[document.getElementById('merging').hidden, document.getElementById('merge').disabled]"),
        json!([false, true])
    );
    browser.press("u");
    assert_eq!(browser.value(is_open), true, "one object alone is not merged");
    browser.click_on(&format!("#tracks [data-object='{other}']"));
    let (left, _, width, _) = browser.place_of("#merging");
    assert!(left >= 0.0 && left + width <= 400.0, "{left} {width}");
    // Chosen twice is not chosen.
    browser.click_on(&format!("#tracks [data-object='{other}']"));
    assert_eq!(browser.value("document.getElementById('merge').disabled"), true);
    browser.press("Escape");
    assert_eq!(browser.value(is_open), false);
    assert_eq!(browser.value("document.documentElement.dataset.object"), one.to_string());
    assert_eq!(
        browser.value("[splatsegPage.run.into.size, document.querySelectorAll('.chosen').length]"),
        json!([0, 0])
    );
    assert_eq!(browser.errors, [] as [String; 0]);
}
