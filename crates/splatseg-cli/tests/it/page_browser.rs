//! The page of a run, opened from disk in a real browser.

use crate::browser::Browser;
use crate::support::{finish, numbered_scene, splatseg};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use image::RgbImage;
use serde_json::{Value, json};
use splatseg_dataset::read_segments_png;
use splatseg_objects::ObjectList;
use splatseg_output::segment_color;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

const FRAMES: usize = 6;

/// Runs on the rendered room, whose frame names are numbers. Returns the folder of results.
fn run_on_room(folder: &Path, more: &[&str]) -> PathBuf {
    let scene = numbered_scene(folder, FRAMES);
    // A name that would be harmful as HTML or in a URL.
    let out = folder.join("a #1 <b>100%");
    let ended = finish(splatseg().arg("run").arg(scene).arg("--out").arg(&out).args(more));
    assert_eq!(ended.code, 0, "{}", ended.err);
    out
}

/// Returns the results of a run shared by several tests.
pub fn room_with_map() -> &'static Path {
    static OUT: OnceLock<PathBuf> = OnceLock::new();
    OUT.get_or_init(|| {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("page_browser");
        let _ = std::fs::remove_dir_all(&folder);
        run_on_room(&folder, &[])
    })
}

/// Opens the page of a run, and waits until it is loaded.
pub fn open(browser: &mut Browser, out: &Path, hash: &str) {
    browser.open(&out.join("index.html"), hash);
    browser.wait_for("document.documentElement?.dataset.ready === 'yes'");
}

/// Returns the selected object. Asserts that the page's root, the list and the information agree.
pub fn selected(browser: &mut Browser) -> u32 {
    let found = browser.value(
        "(() => { const pressed = [...document.querySelectorAll('#list [aria-pressed=true]')]; \
         return { root: Number(document.documentElement.dataset.object), list: pressed.map((row) => Number(row.dataset.object)), \
         info: document.querySelector('#info h2')?.textContent ?? '' }; })()",
    );
    let id = found["root"].as_u64().unwrap() as u32;
    if id == 0 {
        assert_eq!((&found["list"], &found["info"]), (&json!([]), &json!("")));
    } else {
        assert_eq!((&found["list"], &found["info"]), (&json!([id]), &json!(format!("Object {id}"))));
    }
    id
}

pub fn screenshot(browser: &mut Browser) -> RgbImage {
    let png = STANDARD.decode(browser.screenshot()).unwrap();
    image::load_from_memory(&png).unwrap().to_rgb8()
}

/// Returns true if this colour has the greatest part in a pixel's: neighbours blend.
fn has_color(screen: &RgbImage, (x, y): (f64, f64), color: [u8; 3]) -> bool {
    let found = screen.get_pixel(x as u32, y as u32).0;
    found.iter().zip(color).all(|(a, b)| (f64::from(*a) - f64::from(b)).abs() < 70.0)
}

/// Returns the fraction of the picture's pixels that the marks darken.
fn dimmed_part(browser: &mut Browser) -> f64 {
    let part = browser.value(
        "(() => { const { width, height } = document.getElementById('marks'); \
         const pixels = document.getElementById('marks').getContext('2d').getImageData(0, 0, width, height).data; \
         return pixels.filter((value, index) => index % 4 === 3 && value > 0).length / (width * height); })()",
    );
    part.as_f64().unwrap()
}

#[test]
fn pixels_without_an_object_are_not_marked() {
    let Some(mut browser) = Browser::start("pixels_without_an_object_are_not_marked", 1000, 720) else { return };
    let folder = tempfile::tempdir().unwrap();
    let out = run_on_room(folder.path(), &["--set", "min_area=3000"]);
    let ids = read_segments_png(&out.join("segments/000003.png")).unwrap();
    assert!(ids.pixels().contains(&0), "no pixel is left without an object");
    open(&mut browser, &out, "#frame=3");
    assert_eq!((selected(&mut browser), dimmed_part(&mut browser)), (0, 0.0));
}

#[test]
fn clicks_in_list_picture_and_map_mark_the_object_everywhere() {
    let name = "clicks_in_list_picture_and_map_mark_the_object_everywhere";
    let Some(mut browser) = Browser::start(name, 1000, 720) else { return };
    let out = room_with_map();
    open(&mut browser, out, "#frame=3");
    assert_eq!(browser.value("document.documentElement.dataset.frame"), "3");
    assert_eq!(selected(&mut browser), 0);

    // In the picture: selects the object whose id the run wrote there.
    let ids = read_segments_png(&out.join("segments/000003.png")).unwrap();
    let (left, top, width, height) = browser.place_of("#picture");
    let mut in_picture = Vec::new();
    for (across, down) in [(0.25, 0.3), (0.5, 0.5), (0.7, 0.8)] {
        browser.click(left + across * width, top + down * height);
        let at = ((across * ids.width() as f64) as usize, (down * ids.height() as f64) as usize);
        let id = selected(&mut browser);
        assert_eq!(id, ids[at], "at {at:?}");
        let shown = ids.pixels().iter().filter(|found| **found == id).count() as f64 / ids.pixels().len() as f64;
        assert!((dimmed_part(&mut browser) - (1.0 - shown)).abs() < 0.02);
        in_picture.push(id);
    }

    // In the map: selects the object whose colour is there.
    browser.press("Escape");
    assert_eq!((selected(&mut browser), dimmed_part(&mut browser)), (0, 0.0));
    browser.click_on("#path");
    let (left, top, width, height) = browser.place_of("#view");
    let before = screenshot(&mut browser);
    let (mut hits, mut others) = (0, 0);
    for step in 0..16 {
        let (across, down) = (0.3 + 0.12 * f64::from(step % 4), 0.35 + 0.1 * f64::from(step / 4));
        let at = ((left + across * width).floor() + 0.5, (top + down * height).floor() + 0.5);
        browser.click(at.0, at.1);
        let id = selected(&mut browser);
        if id != 0 {
            let is_hit = has_color(&before, at, segment_color(id));
            (hits, others) = (hits + u32::from(is_hit), others + u32::from(!is_hit));
            assert!(
                browser.value("document.getElementById('info').textContent").as_str().unwrap().contains("Gaussian")
            );
        }
    }
    // Where two objects meet within a pixel, either may be found.
    assert!(hits >= 10 && others <= 1, "{hits} clicks selected what was there, {others} something else");

    // In the list: if this frame does not show the object, the video jumps to the frame that shows it best.
    browser.press("Escape");
    browser.click_on(&format!("#list [data-object='{}']", in_picture[0]));
    assert_eq!(selected(&mut browser), in_picture[0]);
    assert!(dimmed_part(&mut browser) > 0.2);
    let elsewhere = "splatsegRun.objects.find(({ seen, state }) => state === 'remembered' \
                     && !seen.some(([first, last]) => first <= 3 && last >= 3))";
    let object = browser.value(elsewhere);
    browser.click_on(&format!("#list [data-object='{}']", object["id"]));
    browser.wait_for(&format!("document.documentElement.dataset.frame === '{}'", object["best"]));
    assert_eq!(json!(selected(&mut browser)), object["id"]);
    assert!(dimmed_part(&mut browser) > 0.2);
    assert_eq!(browser.errors, [] as [String; 0]);
}

#[test]
fn the_video_plays_and_keys_move_it() {
    let Some(mut browser) = Browser::start("the_video_plays_and_keys_move_it", 1000, 720) else { return };
    let out = room_with_map();
    open(&mut browser, out, "");
    let is_at = |frame: usize| {
        format!(
            "document.documentElement.dataset.frame === '{frame}' && document.getElementById('slider').value === '{frame}' \
             && document.getElementById('picture').src.endsWith('/overlay/00000{frame}.jpg')"
        )
    };
    browser.wait_for("document.getElementById('picture').naturalWidth > 0");
    for (key, frame) in [("ArrowRight", 1), ("ArrowRight", 2), ("ArrowLeft", 1), ("End", FRAMES - 1), ("Home", 0)] {
        browser.press(key);
        browser.wait_for(&is_at(frame));
    }
    browser.click_on("#play");
    browser.wait_for(&is_at(FRAMES - 1));
    browser.wait_for("document.getElementById('play').getAttribute('aria-label') === 'Play'");

    // The map turns with the mouse, and a drag does not count as a click.
    let (left, top, width, height) = browser.place_of("#view");
    let still = screenshot(&mut browser);
    let middle = (left + width / 2.0, top + height / 2.0);
    browser.drag(middle, (middle.0 + 120.0, middle.1 + 40.0));
    assert_ne!(screenshot(&mut browser), still);
    assert_eq!(selected(&mut browser), 0);

    // The list's filters: objects in this frame, then an id.
    let rows =
        "[...document.querySelectorAll('#list li:not([hidden]) button')].map((row) => Number(row.dataset.object))";
    browser.click_on("#present");
    let ids = read_segments_png(&out.join(format!("segments/00000{}.png", FRAMES - 1))).unwrap();
    // Those that count, the longest seen first.
    let list: ObjectList = serde_json::from_str(&fs::read_to_string(out.join("objects.json")).unwrap()).unwrap();
    let areas = ids.areas();
    let shown = list.objects.iter().map(|object| object.id).filter(|id| areas.contains_key(id));
    let expected: Vec<u32> = shown.collect();
    assert_eq!(browser.value(rows), json!(expected));
    assert_eq!(
        browser.value("document.getElementById('all').parentElement.hidden"),
        json!(list.not_counted.is_empty())
    );
    browser.click_on("#filter");
    browser.call("Input.insertText", json!({ "text": format!("#{}", expected[0]) }));
    let found = browser.value(rows);
    let starts = |id: &Value| id.to_string().starts_with(&expected[0].to_string());
    assert!(!found.as_array().unwrap().is_empty() && found.as_array().unwrap().iter().all(starts), "{found}");
    assert_eq!(browser.errors, [] as [String; 0]);
}

#[test]
fn a_method_without_a_memory_shows_video_and_list() {
    let Some(mut browser) = Browser::start("a_method_without_a_memory_shows_video_and_list", 900, 700) else { return };
    let folder = tempfile::tempdir().unwrap();
    let out = run_on_room(folder.path(), &["--method", "fastsam"]);
    open(&mut browser, &out, "");
    let note = browser.value("document.getElementById('map-note').textContent");
    assert_eq!(note, "This method keeps no map, so there is nothing to show in 3D.");
    let (left, top, width, height) = browser.place_of("#picture");
    browser.click(left + width / 2.0, top + height / 2.0);
    assert_ne!(selected(&mut browser), 0);
    assert_eq!(browser.errors, [] as [String; 0]);
}

#[test]
fn the_page_can_be_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let out = run_on_room(folder.path(), &["--no-page"]);
    for name in ["index.html", "viewer", "pictures"] {
        assert!(!out.join(name).exists(), "{name}");
    }
}
