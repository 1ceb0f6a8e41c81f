//! The map of the page of a run, in a real browser.

use crate::browser::Browser;
use crate::page_browser::{open, room_with_map, screenshot, selected};
use crate::page_controls::{copy_without_pictures, object_in_map, room, run_data};
use serde_json::{Value, json};

fn number(browser: &mut Browser, expression: &str) -> f64 {
    browser.value(expression).as_f64().unwrap_or_else(|| panic!("{expression}"))
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
    // The list makes the map a little smaller. This place is in the middle of a wall.
    assert_eq!(screenshot(&mut browser).get_pixel(450, 250), own.get_pixel(450, 250));
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
fn changes_are_shown_in_the_map_of_their_time() {
    let test = "changes_are_shown_in_the_map_of_their_time";
    let Some(mut browser) = Browser::start(test, 1440, 900) else { return };
    let folder = tempfile::tempdir().unwrap();
    copy_without_pictures(room_with_map(), folder.path());
    let file = folder.path().join("viewer/run.js");
    let mut run = run_data(&file);
    let objects = run["objects"].as_array().unwrap();
    let in_map: Vec<&Value> = objects.iter().filter(|object| object["box"].is_object()).take(2).collect();
    let place = |object: &Value| json!({ "id": object["id"], "color": object["color"], "box": object["box"] });
    run["changes"] = json!({
        "gone": [place(in_map[0])], "new": [place(in_map[1])], "moved": [], "unchanged": 0, "not_looked_at": 0, "newly_seen": 0,
        "map_before": run["map"],
    });
    std::fs::write(&file, format!("var splatsegRun={run};\n")).unwrap();
    open(&mut browser, folder.path(), "");
    let shown = "[document.getElementById('time').value, splatsegPage.map.splats.uniforms.showAdded.value]";
    for (row, expected) in [(1, json!(["before", 0])), (2, json!(["after", 1]))] {
        browser.click_on(&format!("#changes-list li:nth-child({row}) button"));
        assert_eq!(browser.value(shown), expected);
    }
    assert_eq!(browser.errors, [] as [String; 0]);
}
