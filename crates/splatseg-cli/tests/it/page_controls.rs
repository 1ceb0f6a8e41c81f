//! The controls of the page of a run, in a real browser.

use crate::browser::Browser;
use crate::page_browser::{open, room_with_map, screenshot, selected};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};
use std::path::Path;

/// The page of the room, opened in a browser of this size.
pub fn room(test: &str, (width, height): (u32, u32), hash: &str) -> Option<Browser> {
    let mut browser = Browser::start(test, width, height)?;
    open(&mut browser, room_with_map(), hash);
    Some(browser)
}

/// An object that is in the map and in the frames.
pub fn object_in_map(browser: &mut Browser) -> u64 {
    browser
        .value("splatsegRun.objects.find(({ gaussians, frames }) => gaussians > 50 && frames > 1).id")
        .as_u64()
        .unwrap()
}

#[test]
fn the_picture_is_shown_without_its_overlay() {
    let test = "the_picture_is_shown_without_its_overlay";
    let Some(mut browser) = room(test, (1000, 720), "#frame=2") else { return };
    browser.wait_for(
        "document.getElementById('plain').naturalWidth > 0 && document.getElementById('picture').naturalWidth > 0",
    );
    let truth = image::open(room_with_map().join("pictures/000002.jpg")).unwrap().to_rgb8();
    let (left, top, width, height) = browser.place_of("#plain");
    let difference = |browser: &mut Browser| {
        let screen = screenshot(browser);
        let mut sum = 0.0;
        for step in 0..400 {
            let (across, down) = ((f64::from(step % 20) + 0.5) / 20.0, (f64::from(step / 20) + 0.5) / 20.0);
            let found = screen.get_pixel((left + across * width) as u32, (top + down * height) as u32);
            let expected =
                truth.get_pixel((across * f64::from(truth.width())) as u32, (down * f64::from(truth.height())) as u32);
            sum += (0..3).map(|at| f64::from(found[at].abs_diff(expected[at]))).sum::<f64>() / 3.0;
        }
        sum / 400.0
    };
    let with = difference(&mut browser);
    browser.click_on("#overlay");
    let without = difference(&mut browser);
    browser.press("o");
    browser.value("(() => { const opacity = document.getElementById('opacity'); opacity.value = '30'; opacity.dispatchEvent(new Event('input')); })()");
    let faint = difference(&mut browser);
    assert!(without < 6.0 && without + 3.0 < faint && faint + 3.0 < with, "{without} {faint} {with}");
    assert_eq!(browser.errors, [] as [String; 0]);
}

#[test]
fn the_timeline_has_a_row_for_each_object_and_goes_where_it_is_clicked() {
    let test = "the_timeline_has_a_row_for_each_object_and_goes_where_it_is_clicked";
    let Some(mut browser) = room(test, (1440, 900), "") else { return };
    let rows = "[...document.querySelectorAll('#tracks button')].map((row) => Number(row.dataset.object)).sort((one, other) => one - other)";
    assert_eq!(
        browser.value(rows),
        browser.value(
            "splatsegRun.objects.filter(({ seen, state }) => seen.length && state === 'remembered').map(({ id }) => id) \
             .sort((one, other) => one - other)"
        )
    );
    // The middle of the fourth of six frames, between the margins.
    let (left, top, width, height) = browser.place_of("#spans");
    browser.click(left + 8.0 + (width - 16.0) * 3.5 / 6.0, top + height / 2.0);
    browser
        .wait_for("document.documentElement.dataset.frame === '3' && document.getElementById('slider').value === '3'");
    let (left, top, width, height) = browser.place_of("#ticks");
    browser.drag((left + width / 2.0, top + height / 2.0), (left + width - 3.0, top + height / 2.0));
    browser.wait_for("document.documentElement.dataset.frame === '5'");
    // An object's bar has its colour where the object is seen, and only there.
    browser.value("document.getElementById('rows').scrollTop = 0");
    browser.value("new Promise((resolve) => requestAnimationFrame(() => requestAnimationFrame(resolve)))");
    let painted = browser.value(
        "(() => { const canvas = document.getElementById('spans'); const context = canvas.getContext('2d'); \
         const first = Number(document.querySelector('#tracks button').dataset.object); \
         const { color, seen } = splatsegRun.objects.find(({ id }) => id === first); \
         return [0, 1, 2, 3, 4].map((frame) => { const x = Math.round(8 + (canvas.clientWidth - 16) * (frame + 0.5) / 6); \
         const pixel = context.getImageData(x, 9, 1, 1).data; const isPainted = color.every((value, at) => value === pixel[at]); \
         return isPainted === seen.some(([from, to]) => from <= frame && frame <= to); }).every(Boolean); })()",
    );
    assert_eq!(painted, true);
    let id = object_in_map(&mut browser);
    browser.click_on(&format!("#tracks [data-object='{id}']"));
    assert_eq!(u64::from(selected(&mut browser)), id);
    browser.click_on("#filter");
    browser.call("Input.insertText", json!({ "text": id.to_string() }));
    let found = browser.value(rows);
    assert!(found.as_array().unwrap().iter().all(|row| row.to_string().starts_with(&id.to_string())), "{found}");
    assert_eq!(browser.errors, [] as [String; 0]);
}

#[test]
fn the_clock_keeps_real_time_and_the_speed_changes_it() {
    let test = "the_clock_keeps_real_time_and_the_speed_changes_it";
    let Some(mut browser) = room(test, (1000, 720), "") else { return };
    let clock = |count: usize, stamps: &str, what: &str| {
        format!("(new splatsegPage.clock.constructor({count}, {stamps})).{what}")
    };
    let stamps = "[1700000000, 1700000000.5, 1700000003, 1700000003.5]";
    let mut value = |expression: &str| browser.value(expression);
    assert_eq!(value(&clock(4, stamps, "frameAt(2.9)")), 1);
    assert_eq!(value(&clock(4, stamps, "frameAt(3)")), 2);
    // After a gap, a frame does not last until the next one.
    assert_eq!(value(&clock(4, stamps, "endOf(1)")), 3.0);
    assert_eq!(value(&clock(4, "[0, 0.1, 9, 9.1]", "endOf(1)")), 0.6);
    assert_eq!(value(&clock(4, stamps, "textOf(1)")), "0.50 s · 2023-11-14 22:13:20.500 UTC");
    assert_eq!(value(&clock(2, "[5, 70.25]", "textOf(1)")), "1:05.25 · stamp 70.250 s");
    // Without stamps, or with wrong ones, it counts frames.
    for stamps in ["null", "[1, null, 2, 3]", "[2, 1, 3, 4]", "[1, 1, 1, 1]"] {
        assert_eq!(value(&clock(4, stamps, "isReal")), false, "{stamps}");
        assert_eq!(value(&clock(4, stamps, "tickText(0.2, 0.1)")), "2");
    }
    // Ten frames per second at a quarter of the speed: five steps take two seconds.
    let played = "(async () => { const start = performance.now(); document.getElementById('play').click(); \
        while (document.getElementById('play').getAttribute('aria-label') === 'Pause') await new Promise((resolve) => setTimeout(resolve, 5)); \
        return [performance.now() - start, document.documentElement.dataset.frame]; })()";
    value("document.getElementById('speed').value = '0.25'");
    let slow = value(played);
    assert!(slow[0].as_f64().unwrap() > 1900.0 && slow[1] == "5", "{slow}");
    value("document.getElementById('speed').value = '8'");
    let fast = value(played);
    assert!(fast[0].as_f64().unwrap() < slow[0].as_f64().unwrap() && fast[1] == "5", "{fast}");
    assert_eq!(browser.errors, [] as [String; 0]);
}

#[test]
fn a_link_shows_the_same() {
    let Some(mut browser) = room("a_link_shows_the_same", (1000, 720), "#frame=2") else { return };
    let id = object_in_map(&mut browser);
    browser.value(&format!(
        "(() => {{ splatsegPage.select({id}); document.getElementById('cut').click(); document.getElementById('overlay').click(); \
         const colors = document.getElementById('colors'); colors.value = 'true'; colors.dispatchEvent(new Event('change')); }})()"
    ));
    browser.press("h");
    let (left, top, width, height) = browser.place_of("#view");
    browser.drag((left + width / 2.0, top + height / 2.0), (left + width / 2.0 + 90.0, top + height / 2.0));
    // The address follows a moment later.
    browser.wait_for(
        "location.hash.includes(`view=${splatsegPage.map.view.map((value) => Number(value.toFixed(3))).join(',')}`) \
         && location.hash.includes('hide=')",
    );
    let state = "(() => { const { map } = splatsegPage; return [document.documentElement.dataset.frame, document.documentElement.dataset.object, \
        document.getElementById('cut').checked, document.getElementById('overlay').checked, document.getElementById('colors').value, \
        document.getElementById('show-all').textContent, map.view.map((value) => value.toFixed(2))]; })()";
    let (hash, expected) = (browser.value("location.hash"), browser.value(state));
    browser.open_url("about:blank");
    open(&mut browser, room_with_map(), hash.as_str().unwrap());
    assert_eq!(browser.value(state), expected);
    assert_eq!(expected[1], id.to_string());
    // Keys turn the map while it has the focus, and not the frame.
    browser.value("document.getElementById('view').focus()");
    browser.press("ArrowLeft");
    browser.press("+");
    let moved = browser.value(state);
    assert_eq!((&moved[0], moved[6] == expected[6]), (&expected[0], false));
    // What is wrong in a link is left out.
    browser.open_url("about:blank");
    open(&mut browser, room_with_map(), "#frame=-7&object=999999&view=1,2,x&overlay=no&hide=,,&height=abc");
    assert_eq!(browser.value("document.documentElement.dataset.frame"), "0");
    assert_eq!(selected(&mut browser), 0);
    assert_eq!(browser.errors, [] as [String; 0]);
}

#[test]
fn files_are_downloaded() {
    let Some(mut browser) = room("files_are_downloaded", (1000, 720), "") else { return };
    let mut saved = |button: &str| {
        let file = browser.value(&format!(
            "new Promise((resolve) => {{ URL.createObjectURL = (blob) => {{ const reader = new FileReader(); \
             reader.onload = () => resolve(reader.result.split(',')[1]); reader.readAsDataURL(blob); return 'data:,'; }}; \
             document.getElementById('{button}').click(); }})"
        ));
        STANDARD.decode(file.as_str().unwrap()).unwrap()
    };
    let run = run_data(&room_with_map().join("viewer/run.js"));
    let csv = String::from_utf8(saved("save-csv")).unwrap();
    let objects = run["objects"].as_array().unwrap();
    assert_eq!(csv.lines().count(), 1 + objects.len());
    assert!(
        csv.lines().nth(1).unwrap().starts_with(&format!("{},,{},", objects[0]["id"], objects[0]["frames"])),
        "{csv}"
    );
    assert!(saved("save-png").starts_with(b"\x89PNG"));
    let ply = saved("save-ply");
    let count = run["map"]["count"].as_u64().unwrap() as usize;
    let end = ply.windows(11).position(|window| window == b"end_header\n").unwrap() + 11;
    assert!(String::from_utf8_lossy(&ply[..end]).contains(&format!("element vertex {count}\n")));
    assert_eq!(ply.len(), end + 35 * count);
    let x = f64::from_le_bytes(ply[end..end + 8].try_into().unwrap());
    let (min, size) = (run["map"]["min"][0].as_f64().unwrap(), run["map"]["size"][0].as_f64().unwrap());
    let origin = run["origin"][0].as_f64().unwrap();
    assert!((origin + min - 1e-3..=origin + min + size + 1e-3).contains(&x), "{x}");
    assert_eq!(browser.errors, [] as [String; 0]);
}

#[test]
fn help_opens_by_key_and_all_controls_have_names() {
    let test = "help_opens_by_key_and_all_controls_have_names";
    let Some(mut browser) = room(test, (400, 850), "") else { return };
    let id = object_in_map(&mut browser);
    browser.value(&format!("splatsegPage.select({id})"));
    browser.press("?");
    assert_eq!(browser.value("document.getElementById('help').open"), true);
    // Keys belong to the help while it is open.
    browser.press("i");
    browser.click_on("#help button");
    assert_eq!(browser.value("document.getElementById('help').open"), false);
    assert_eq!(u64::from(selected(&mut browser)), id);
    assert_eq!(browser.value("document.getElementById('show-all').hidden"), true);
    let nameless = "[...document.querySelectorAll('button, input, select, summary')].filter((control) => !control.hidden && \
        !(control.textContent.trim() && control.matches('button, summary')) && !control.getAttribute('aria-label') && !control.labels?.length).map((control) => control.id)";
    assert_eq!(browser.value(nameless), json!([]));
    for scheme in ["light", "dark"] {
        browser.prefer_scheme(scheme);
        assert_contrast(&mut browser, scheme);
    }
    assert_eq!(browser.errors, [] as [String; 0]);
}

/// Asserts that text stands out from its ground as WCAG 2 asks (1.4.3): a contrast of 4.5.
fn assert_contrast(browser: &mut Browser, scheme: &str) {
    let colors = browser.value(
        "(() => { const style = getComputedStyle(document.documentElement); \
         return [['--ink', '--paper'], ['--muted', '--paper'], ['--muted', '--raised'], ['--muted', '--stage'], ['--paper', '--accent'], ['--paper', '--ink']] \
         .map((pair) => pair.map((name) => style.getPropertyValue(name).trim())); })()",
    );
    let luminance = |text: &Value| -> f64 {
        let hex = u32::from_str_radix(text.as_str().unwrap().trim_start_matches('#'), 16).unwrap();
        let channel = |shift: u32| {
            let value = f64::from((hex >> shift) & 255) / 255.0;
            if value <= 0.03928 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
        };
        0.2126 * channel(16) + 0.7152 * channel(8) + 0.0722 * channel(0)
    };
    for pair in colors.as_array().unwrap() {
        let (one, other) = (luminance(&pair[0]), luminance(&pair[1]));
        let contrast = (one.max(other) + 0.05) / (one.min(other) + 0.05);
        assert!(contrast >= 4.5, "{scheme}: {pair} {contrast}");
    }
}

/// The data of a run's page.
pub fn run_data(file: &Path) -> Value {
    let script = std::fs::read_to_string(file).unwrap();
    serde_json::from_str(script.strip_prefix("var splatsegRun=").unwrap().strip_suffix(";\n").unwrap()).unwrap()
}

#[test]
fn a_run_without_plain_pictures_shows_its_overlays() {
    let test = "a_run_without_plain_pictures_shows_its_overlays";
    let Some(mut browser) = Browser::start(test, 1000, 720) else { return };
    let folder = tempfile::tempdir().unwrap();
    copy_without_pictures(room_with_map(), folder.path());
    open(&mut browser, folder.path(), "#overlay=0");
    browser
        .wait_for("document.getElementById('plain').hidden && document.getElementById('picture').style.opacity === ''");
    assert_eq!(browser.errors, [] as [String; 0]);
}

/// Copies the page of a run that was made before the page had pictures without overlay.
pub fn copy_without_pictures(from: &Path, to: &Path) {
    std::fs::copy(from.join("index.html"), to.join("index.html")).unwrap();
    for folder in ["viewer", "overlay"] {
        std::fs::create_dir(to.join(folder)).unwrap();
        for file in std::fs::read_dir(from.join(folder)).unwrap().map(Result::unwrap) {
            if file.file_type().unwrap().is_file() {
                std::fs::copy(file.path(), to.join(folder).join(file.file_name())).unwrap();
            }
        }
    }
}
