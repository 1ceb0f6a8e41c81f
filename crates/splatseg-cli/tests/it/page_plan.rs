//! The floor plan on the page of a run: its data, and the view in a real browser.

use crate::browser::Browser;
use crate::page_browser::{open, screenshot, selected};
use crate::page_large::Folder;
use crate::support::{finish, map_with_floor, numbered_scene, splatseg};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};
use splatseg::pipeline::NamedMap;
use splatseg_objects::{ObjectList, ObjectLog, RemapLog};
use splatseg_output::{Page, RunEnd, RunOutput};
use splatseg_places::{Cell, FloorPlan, PlanSettings};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// A run on the demo's clip, with its map beside it. Several tests share it.
fn room() -> (PathBuf, PathBuf) {
    static OUT: OnceLock<PathBuf> = OnceLock::new();
    let folder = OUT.get_or_init(|| {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("page_plan");
        let _ = fs::remove_dir_all(&folder);
        let scene = numbered_scene(&folder, 6);
        let mut command = splatseg();
        command.arg("run").arg(scene).arg("--out").arg(folder.join("out"));
        let ended = finish(command.arg("--save-memory").arg(folder.join("map.ply")));
        assert_eq!(ended.code, 0, "{}", ended.err);
        folder
    });
    (folder.join("out"), folder.join("map.ply"))
}

/// The plan in a page's data.
fn plan_of(script: &Path) -> Value {
    let script = fs::read_to_string(script).unwrap();
    let data = script.strip_prefix("var splatsegRun=").unwrap().strip_suffix(";\n").unwrap();
    serde_json::from_str::<Value>(data).unwrap()["plan"].clone()
}

/// The codes of a plan's cells, decoded as `frame_ids.js` does.
fn codes(plan: &Value) -> Vec<u32> {
    let (width, height) = (plan["width"].as_u64().unwrap() as usize, plan["height"].as_u64().unwrap() as usize);
    let bytes = STANDARD.decode(plan["cells"].as_str().unwrap()).unwrap();
    let mut bytes = bytes.into_iter();
    let mut number = || {
        let (mut value, mut shift) = (0, 0);
        for byte in bytes.by_ref() {
            value |= u32::from(byte & 127) << shift;
            shift += 7;
            if byte < 128 {
                break;
            }
        }
        value
    };
    let mut found: Vec<u32> = Vec::new();
    while found.len() < width * height {
        for _ in 0..number() {
            found.push(if found.len() < width { 0 } else { found[found.len() - width] });
        }
        let (count, code) = (number(), number());
        found.extend(std::iter::repeat_n(code, count as usize));
    }
    found
}

#[test]
fn the_page_has_the_plan_of_the_saved_map() {
    let (out, map) = room();
    let found = plan_of(&out.join("viewer/run.js"));
    let plan = NamedMap::load(&map).unwrap().floor_plan(PlanSettings::default()).unwrap();
    let shape = &plan.grid().shape;
    assert_eq!((&found["width"], &found["height"]), (&json!(shape.width), &json!(shape.height)));
    let expected: Vec<u32> = (0..shape.len())
        .map(|cell| match plan.grid().cells[cell] {
            Cell::Unknown => 0,
            Cell::Occupied => 1,
            Cell::Free => 2 + plan.room_at(shape.center(cell)).map_or(0, |room| room.id),
        })
        .collect();
    assert!(codes(&found) == expected && expected.contains(&1) && expected.contains(&3));
    assert_eq!(found["rooms"].as_array().unwrap().len(), plan.rooms().len());
    let objects = found["objects"].as_array().unwrap();
    assert!(objects.len() > 5, "{}", objects.len());
    for object in objects {
        let outlines = &plan.footprints()[&(object["id"].as_u64().unwrap() as u32)].outlines;
        let corner = (outlines[0][0] - shape.origin) * 100.0;
        assert_eq!(object["outlines"][0][0], json!(corner.x.round() as i64));
        assert_eq!(object["outlines"].as_array().unwrap().len(), outlines.len());
    }
}

#[test]
fn a_fine_grid_is_drawn_with_larger_cells() {
    let folder = tempfile::tempdir().unwrap();
    let map = map_with_floor(folder.path());
    let map = NamedMap::load(map).unwrap();
    let fine = PlanSettings { resolution: 0.01, ..PlanSettings::default() };
    let (fine, coarse) = (map.floor_plan(fine).unwrap(), map.floor_plan(PlanSettings::default()).unwrap());
    assert!(fine.grid().shape.len() > 250_000, "{:?}", fine.grid().shape);
    let (from_fine, from_coarse) = (written(&map, &fine), written(&map, &coarse));
    let cells = |plan: &Value| plan["width"].as_u64().unwrap() * plan["height"].as_u64().unwrap();
    assert!(cells(&from_fine) <= 250_000 && cells(&from_fine) > 4 * cells(&from_coarse));
    assert_eq!(from_fine["resolution"], json!(0.02));
    let free = |plan: &Value| {
        let side = plan["resolution"].as_f64().unwrap();
        codes(plan).into_iter().filter(|found| *found > 1).count() as f64 * side * side
    };
    let (fine, coarse) = (free(&from_fine), free(&from_coarse));
    assert!((fine - coarse).abs() < 0.2 * coarse, "{fine} {coarse}");
}

/// The page's data about a plan.
fn written(map: &NamedMap, plan: &FloorPlan) -> Value {
    let folder = tempfile::tempdir().unwrap();
    let objects = ObjectList::new(&ObjectLog::default(), Some(map.memory.map()));
    let end = RunEnd {
        scene: "room",
        objects: &objects,
        map: Some(map.memory.map()),
        plan: Some(plan),
        pose_corrections: &[],
        remaps: &RemapLog::default(),
        changes: None,
    };
    Page::new().finish(&end, &mut Folder(folder.path())).unwrap();
    plan_of(&folder.path().join("viewer/run.js"))
}

/// A pixel inside of a footprint that no other covers, and its object: `[x, y, id]`. It lies in the middle of the widest
/// inner stretch of a row, which is wider than a text.
const OPEN_FOOTPRINT: &str = "(() => { const { plan, run } = splatsegPage; \
    const drawn = run.plan.objects.filter(({ id }) => run.byId.get(id)?.state === 'remembered'); \
    const crossings = ({ outlines }, y) => outlines.flatMap((line) => line.flatMap((x, at) => { if (at % 2) return []; \
        const [a, z, b] = [line[at + 1], line[(at + 2) % line.length], line[(at + 3) % line.length]]; \
        return a > y !== b > y ? [x + (y - a) / (b - a) * (z - x)] : []; })).sort((one, other) => one - other); \
    const covers = (object, x, y) => crossings(object, y).filter((edge) => edge < x).length % 2 === 1; \
    const pixels = plan.pixelOf(1, 0)[0] - plan.pixelOf(0, 0)[0]; \
    const found = drawn.map((object, place) => { const ys = object.outlines.flat().filter((_, at) => at % 2); let best = [0]; \
        for (let y = Math.min(...ys) + 0.5; y < Math.max(...ys); y++) { const edges = crossings(object, y); \
            for (let at = 0; at + 1 < edges.length; at += 2) { const x = (edges[at] + edges[at + 1]) / 2; \
                const wide = edges[at + 1] - edges[at]; \
                const isOpen = !drawn.slice(place + 1).some((other) => covers(other, x, y)); \
                if (wide > best[0] && isOpen) best = [wide, x / 100, y / 100]; } } \
        return [...best, object.id]; }).findLast(([wide]) => wide / 100 * pixels > 40); \
    return [...plan.pixelOf(found[1], found[2]), found[3]]; })()";

#[test]
fn the_plan_is_shown_in_place_of_the_map_and_its_objects_are_clicked() {
    let test = "the_plan_is_shown_in_place_of_the_map_and_its_objects_are_clicked";
    let Some(mut browser) = Browser::start(test, 1000, 720) else { return };
    open(&mut browser, &room().0, "");
    let shown = "[...document.querySelectorAll('#view, #plan, #axes, #measure')].filter((found) => found.offsetWidth || found.getBoundingClientRect().width).map(({ id }) => id)";
    assert_eq!(browser.value(shown), json!(["measure", "view", "axes"]));
    browser.press("p");
    assert_eq!(browser.value(shown), json!(["plan"]));
    assert_eq!(browser.value("document.getElementById('plan-button').ariaPressed"), "true");
    browser.wait_for("location.hash.includes('plan=1')");

    let place = browser.value(OPEN_FOOTPRINT);
    let (x, y, id) = (place[0].as_f64().unwrap(), place[1].as_f64().unwrap(), place[2].as_u64().unwrap() as u32);
    let color: [u8; 3] =
        serde_json::from_value(browser.value(&format!("splatsegPage.run.byId.get({id}).color"))).unwrap();
    let is_painted = |browser: &mut Browser| {
        browser.value("splatsegPage.plan.drawNow()");
        let screen = screenshot(browser);
        let near = |(x, y): (f64, f64)| {
            let found = screen.get_pixel(x as u32, y as u32).0;
            found.iter().zip(color).all(|(one, other)| one.abs_diff(other) < 60)
        };
        // Beside the text and the outline.
        (-18..=18).flat_map(|right| (-18..=18).map(move |down| (x + f64::from(right), y + f64::from(down)))).any(near)
    };
    assert!(is_painted(&mut browser), "{color:?} at {x} {y}");
    browser.click(x, y);
    assert_eq!(selected(&mut browser), id);
    assert!(is_painted(&mut browser));
    // A hidden object is not drawn, and what is below it is clicked.
    browser.press("h");
    browser.click(x, y);
    assert_ne!(selected(&mut browser), id);
    browser.click_on("#show-all");

    // Zoomed and moved; `r` shows the whole plan again.
    let corner = "splatsegPage.plan.pixelOf(0, 0).map(Math.round)";
    let before = browser.value(corner);
    browser.value("document.getElementById('plan').focus()");
    browser.press("+");
    browser.drag((x, y), (x + 40.0, y - 30.0));
    assert_ne!(browser.value(corner), before);
    browser.press("r");
    assert_eq!(browser.value(corner), before);
    browser.click_on("#plan-button");
    assert_eq!(browser.value(shown), json!(["measure", "view", "axes"]));

    // A link to the plan, on a phone.
    browser.resize(400, 800);
    open(&mut browser, &room().0, "#plan=1&frame=2");
    assert_eq!(browser.value(shown), json!(["plan"]));
    assert_eq!(browser.value("document.getElementById('plan').clientWidth <= 400"), true);
    assert_eq!(browser.errors, [] as [String; 0]);
}
