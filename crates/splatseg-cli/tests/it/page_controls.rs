//! The controls of the page of a run, in a real browser.

use crate::browser::Browser;
use crate::page_browser::{open, room_with_map, screenshot, selected};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};
use std::path::Path;

/// The page of the room, opened in a browser of this size.
fn room(test: &str, (width, height): (u32, u32), hash: &str) -> Option<Browser> {
    let mut browser = Browser::start(test, width, height)?;
    open(&mut browser, room_with_map(), hash);
    Some(browser)
}

fn number(browser: &mut Browser, expression: &str) -> f64 {
    browser.value(expression).as_f64().unwrap_or_else(|| panic!("{expression}"))
}

/// An object that is in the map and in the frames.
fn object_in_map(browser: &mut Browser) -> u64 {
    browser
        .value("splatsegRun.objects.find(({ gaussians, frames }) => gaussians > 50 && frames > 1).id")
        .as_u64()
        .unwrap()
}

/// Fractions of the drawn Gaussians beside the stage, and of the stage's width and height that the others span.
const SPAN: &str = "(() => { const { map } = splatsegPage; map.camera.updateMatrixWorld(); const { splats, camera } = map; \
    const place = camera.position.clone(); const [xs, ys] = [[], []]; let outside = 0; \
    for (let index = 0; index < splats.count; index++) { if (splats.isHidden(index, camera.position)) continue; \
    const { x, y } = place.fromArray(splats.positions, 3 * index).project(camera); xs.push(x); ys.push(y); \
    outside += Math.abs(x) > 1 || Math.abs(y) > 1 ? 1 : 0; } \
    const span = (values) => { const sorted = Float64Array.from(values).sort(); const at = (part) => sorted[Math.round(part * (sorted.length - 1))]; \
    return (at(0.995) - at(0.005)) / 2; }; return [outside / xs.length, span(xs), span(ys)]; })()";

#[test]
fn the_first_view_fits_the_map_in_any_window() {
    let test = "the_first_view_fits_the_map_in_any_window";
    let Some(mut browser) = room(test, (1440, 900), "") else { return };
    for (width, height) in [(1440, 900), (400, 850)] {
        browser.resize(width, height);
        browser.wait_for("splatsegPage.map.camera.aspect === document.getElementById('stage').clientWidth / document.getElementById('stage').clientHeight");
        let found = browser.value(SPAN);
        let [outside, across, down] = [0, 1, 2].map(|at| found[at].as_f64().unwrap());
        assert!(outside < 0.01, "{width}: {found}");
        assert!(across.max(down) > 0.8 && across.max(down) <= 1.0, "{width}: {found}");
        // Nothing lies beside a narrow page.
        assert_eq!(
            number(&mut browser, "document.documentElement.scrollWidth - document.documentElement.clientWidth"),
            0.0
        );
    }
    assert_eq!(browser.errors, [] as [String; 0]);
}

#[test]
fn near_walls_and_what_is_high_can_be_left_out() {
    let test = "near_walls_and_what_is_high_can_be_left_out";
    let Some(mut browser) = room(test, (1000, 720), "") else { return };
    let hidden = "(() => { const { splats, camera } = splatsegPage.map; let count = 0; \
        for (let index = 0; index < splats.count; index++) count += splats.isHidden(index, camera.position) ? 1 : 0; return count / splats.count; })()";
    // From behind what the cameras saw.
    browser.value(
        "(() => { const { map } = splatsegPage; const [x, y, z, ...target] = [...map.camera.position, ...map.controls.target]; \
         const back = [x, y, z].map((value, axis) => 2 * target[axis] - value); \
         map.view = [...back, ...target]; map.drawNow(); })()",
    );
    let cut = (number(&mut browser, hidden), screenshot(&mut browser));
    assert!(cut.0 > 0.05, "{}", cut.0);
    browser.click_on("#cut");
    let whole = (number(&mut browser, hidden), screenshot(&mut browser));
    assert_eq!(whole.0, 0.0);
    assert_ne!(cut.1, whole.1);
    browser.value("(() => { const ceiling = document.getElementById('ceiling'); ceiling.value = '50'; ceiling.dispatchEvent(new Event('input')); })()");
    let lower = number(&mut browser, hidden);
    assert!((0.05..0.95).contains(&lower), "{lower}");
    assert_ne!(screenshot(&mut browser), whole.1);
    assert_eq!(browser.errors, [] as [String; 0]);
}

#[test]
fn a_selection_dims_the_other_objects_in_their_own_colours() {
    let test = "a_selection_dims_the_other_objects_in_their_own_colours";
    let Some(mut browser) = room(test, (1000, 720), "#colors=true") else { return };
    browser.click_on("#path");
    let id = object_in_map(&mut browser);
    let before = screenshot(&mut browser);
    browser.value(&format!(
        "(() => {{ splatsegPage.select({id}); splatsegPage.map.box.visible = false; splatsegPage.map.drawNow(); }})()"
    ));
    let after = screenshot(&mut browser);
    let (left, top, width, height) = browser.place_of("#view");
    let ground = *before.get_pixel(left as u32 + 20, top as u32 + 20);
    let (mut kept, mut dimmed, mut other) = (0, 0, 0);
    for (column, row) in (0..20).flat_map(|column| (2..18).map(move |row| (column, row))) {
        let x = (left + width * (f64::from(column) + 0.5) / 20.0) as u32;
        let y = (top + height * (f64::from(row) + 0.5) / 20.0) as u32;
        let (old, new) = (before.get_pixel(x, y), after.get_pixel(x, y));
        let is_close = |part: f64| {
            (0..3).all(|channel| {
                let expected = f64::from(old[channel]) * (1.0 - part) + f64::from(ground[channel]) * part;
                (expected - f64::from(new[channel])).abs() < 8.0
            })
        };
        match (is_close(0.0), is_close(0.62)) {
            (_, true) => dimmed += 1,
            (true, false) => kept += 1,
            (false, false) => other += 1,
        }
    }
    assert!(dimmed > 100 && other < 40, "{dimmed} dimmed, {kept} kept, {other} neither");
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
    let mut difference = |browser: &mut Browser| {
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
fn objects_are_isolated_and_hidden() {
    let Some(mut browser) = room("objects_are_isolated_and_hidden", (1000, 720), "") else { return };
    let id = object_in_map(&mut browser);
    let shown = format!(
        "(() => {{ const {{ splats }} = splatsegPage.map; const of = (wanted) => splats.shown.filter((value, index) => value && (splats.ids[index] === {id}) === wanted).length; return [of(true) > 0, of(false) > 0]; }})()"
    );
    let all = screenshot(&mut browser);
    browser.click_on(&format!("#list [data-object='{id}']"));
    browser.press("i");
    assert_eq!(browser.value(&shown), json!([true, false]));
    assert_eq!(
        browser
            .value("[...document.querySelectorAll('#info [aria-pressed=true]')].map((button) => button.textContent)"),
        json!(["Isolate"])
    );
    assert_ne!(screenshot(&mut browser), all);
    // Another object alone, then no object: all.
    browser.press("Escape");
    assert_eq!(browser.value(&shown), json!([true, true]));
    browser.click_on(&format!("#list [data-object='{id}']"));
    browser.press("h");
    assert_eq!(browser.value(&shown), json!([false, true]));
    assert_eq!(browser.value("document.getElementById('show-all').textContent"), "Show 1 hidden");
    browser.click_on("#show-all");
    assert_eq!(browser.value(&shown), json!([true, true]));
    assert_eq!(browser.errors, [] as [String; 0]);
}

#[test]
fn the_timeline_has_a_row_for_each_object_and_goes_where_it_is_clicked() {
    let test = "the_timeline_has_a_row_for_each_object_and_goes_where_it_is_clicked";
    let Some(mut browser) = room(test, (1440, 900), "") else { return };
    let rows = "[...document.querySelectorAll('#tracks button')].map((row) => Number(row.dataset.object)).sort((one, other) => one - other)";
    assert_eq!(
        browser.value(rows),
        browser.value("splatsegRun.objects.filter(({ seen }) => seen.length).map(({ id }) => id)")
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
fn axes_scale_and_measured_lengths_are_true() {
    let test = "axes_scale_and_measured_lengths_are_true";
    let Some(mut browser) = room(test, (1000, 720), "") else { return };
    browser.value("splatsegPage.map.drawNow()");
    // The bar against two places beside each other in the middle of the view.
    let found = browser.value(
        "(() => { const { map } = splatsegPage; const { camera, controls } = map; camera.updateMatrixWorld(); \
         const right = controls.target.clone().setFromMatrixColumn(camera.matrixWorld, 0); const stage = document.getElementById('stage'); \
         const x = (place) => place.project(camera).x * stage.clientWidth / 2; \
         const metre = x(controls.target.clone().add(right)) - x(controls.target.clone()); \
         const [, length, unit] = document.getElementById('scale-length').textContent.match(/^(\\d+) (m|cm|mm)$/); \
         const metres = length * { m: 1, cm: 0.01, mm: 0.001 }[unit]; \
         return [document.getElementById('scale-bar').getBoundingClientRect().width, metres * metre]; })()",
    );
    let (bar, expected) = (found[0].as_f64().unwrap(), found[1].as_f64().unwrap());
    assert!((bar - expected).abs() < 1.0 && (50.0..=141.0).contains(&bar), "{bar} {expected}");
    // An axis points where a step along it leads.
    let axis = browser.value(
        "(() => { const { camera, controls } = splatsegPage.map; camera.updateMatrixWorld(); \
         const line = document.querySelector('#axis-z line'); const from = controls.target.clone().project(camera); \
         const to = controls.target.clone(); to.z += 0.01; to.project(camera); \
         const shown = [Number(line.getAttribute('x2')), -Number(line.getAttribute('y2'))]; const true_ = [(to.x - from.x) * camera.aspect, to.y - from.y]; \
         return (shown[0] * true_[0] + shown[1] * true_[1]) / Math.hypot(...shown) / Math.hypot(...true_); })()",
    );
    assert!(axis.as_f64().unwrap() > 0.99, "{axis}");
    browser.press("m");
    let (left, top, width, height) = browser.place_of("#view");
    browser.click(left + 0.45 * width, top + 0.5 * height);
    assert_eq!(browser.value("document.getElementById('length').textContent"), "Click the other place.");
    browser.click(left + 0.55 * width, top + 0.55 * height);
    let length = number(&mut browser, "splatsegPage.map.measure.length");
    assert_eq!(browser.value("document.getElementById('length').textContent"), format!("{length:.3} m"));
    assert!((0.02..5.0).contains(&length), "{length}");
    assert_eq!(selected(&mut browser), 0, "measuring does not select");
    browser.press("Escape");
    assert_eq!(browser.value("document.getElementById('length').hidden"), true);
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
    browser.wait_for("location.hash.includes('view=') && location.hash.includes('hide=')");
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
    let run: Value = {
        let script = std::fs::read_to_string(room_with_map().join("viewer/run.js")).unwrap();
        serde_json::from_str(script.trim_start_matches("var splatsegRun=").trim_end_matches(";\n")).unwrap()
    };
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
fn another_run_is_compared() {
    let Some(mut browser) = room("another_run_is_compared", (1440, 900), "") else { return };
    let choose = |text: &str| {
        format!(
            "(() => {{ const files = new DataTransfer(); files.items.add(new File([{text}], 'run.js')); \
             const input = document.getElementById('other-file'); input.files = files.files; input.dispatchEvent(new Event('change')); }})()"
        )
    };
    // The same run, moved by two metres, of one object.
    let own = screenshot(&mut browser);
    browser.value(&choose(
        "'var splatsegRun=' + JSON.stringify({ ...splatsegRun, scene: 'moved', objects: splatsegRun.objects.slice(0, 1), \
         origin: splatsegRun.origin.map((value) => value + 2) }) + ';'",
    ));
    browser.wait_for("document.getElementById('other').value === 'other'");
    assert_ne!(screenshot(&mut browser), own);
    let moved = browser.value(
        "[0, 1, 2].map((axis) => Math.round(100 * (splatsegPage.map.other.positions[axis] - splatsegPage.map.splats.positions[axis])))",
    );
    assert_eq!(moved, json!([200, 200, 200]));
    let text = browser.value("document.getElementById('other').selectedOptions[0].textContent");
    assert!(text.as_str().unwrap().starts_with("moved: 1 object, "), "{text}");
    // The key returns to this run, unless it chooses in the list.
    browser.value("document.activeElement.blur()");
    browser.press("c");
    assert_eq!(browser.value("document.getElementById('other').value"), "this");
    assert_eq!(screenshot(&mut browser).get_pixel(400, 400), own.get_pixel(400, 400));
    // Nothing in the file is executed.
    for text in ["'window.harm = 1'", "'var splatsegRun=window.harm = 1;'", "'var splatsegRun={};'"] {
        browser.value("document.getElementById('map-note').hidden = true");
        browser.value(&choose(text));
        browser.wait_for("!document.getElementById('map-note').hidden");
    }
    assert_eq!(browser.value("window.harm === undefined"), true);
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
    let nameless = "[...document.querySelectorAll('button, input, select, summary')].filter((control) => \
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
fn copy_without_pictures(from: &Path, to: &Path) {
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
