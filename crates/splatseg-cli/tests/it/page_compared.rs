//! Ground truth and other runs on the page of a run, in a real browser.

use crate::browser::Browser;
use crate::page_browser::{open, selected};
use crate::support::{finish, read_json, splatseg};
use serde_json::{Value, json};
use splatseg_dataset::{Scene, SyntheticScene, SyntheticSettings, read_segments_png};
use splatseg_geometry::SegmentMap;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

const SCENE: &str = "synthetic:frames=18,width=96,height=72,objects=6";
const FRAME: usize = 2;

fn run(folder: &Path, name: &str, more: &[&str]) -> PathBuf {
    let out = folder.join(name);
    let ended = finish(splatseg().args(["run", SCENE, "--online", "--out"]).arg(&out).args(more));
    assert_eq!(ended.code, 0, "{}", ended.err);
    out
}

/// Runs `eval --page`, which says what the page shows.
fn compare(out: &Path, gt: Option<&Path>) -> String {
    let mut command = splatseg();
    command.arg("eval").arg("--pred").arg(out).arg("--page");
    if let Some(gt) = gt {
        command.arg("--gt").arg(gt);
    }
    let ended = finish(&mut command);
    assert_eq!(ended.code, 0, "{}", ended.err);
    ended.err
}

/// The contents of `compared.js`.
fn comparison(out: &Path) -> Value {
    let text = fs::read_to_string(out.join("viewer/compared.js")).unwrap();
    serde_json::from_str(text.strip_prefix("var splatsegComparison=").unwrap().strip_suffix(";\n").unwrap()).unwrap()
}

/// For each of these ids, a pixel in the middle of its longest run in a row, as parts of width and height.
fn places(ids: &SegmentMap) -> BTreeMap<u32, (f64, f64)> {
    let mut best = BTreeMap::new();
    for row in 0..ids.height() {
        let mut start = 0;
        for column in 1..=ids.width() {
            let id = ids[(start, row)];
            if column < ids.width() && ids[(column, row)] == id {
                continue;
            }
            let middle = ((start + column) as f64 / 2.0 / ids.width() as f64, (row as f64 + 0.5) / ids.height() as f64);
            let longest = best.entry(id).or_insert((0, middle));
            *longest = if column - start > longest.0 { (column - start, middle) } else { *longest };
            start = column;
        }
    }
    best.into_iter().filter(|(id, (length, _))| *id > 0 && *length > 5).map(|(id, (_, place))| (id, place)).collect()
}

#[test]
fn the_page_shows_ground_truth_in_the_colours_of_the_run_and_beside_it() {
    let test = "the_page_shows_ground_truth_in_the_colours_of_the_run_and_beside_it";
    let Some(mut browser) = Browser::start(test, 1440, 900) else { return };
    let folder = tempfile::tempdir().unwrap();
    let out = run(folder.path(), "out", &[]);
    let before = fs::read(out.join("index.html")).unwrap();
    let said = compare(&out, None);
    let found = comparison(&out);
    let figure = found["figure"].as_str().unwrap();
    assert!(said.contains(&format!("shows ground truth: {figure}")), "{said}");
    let scores = folder.path().join("scores.json");
    let ended = finish(splatseg().arg("eval").arg("--pred").arg(&out).arg("--json").arg(&scores));
    assert_eq!(ended.code, 0, "{}", ended.err);
    let vsq = read_json(&scores)["vsq"].as_f64().unwrap();
    assert!(figure.contains(&format!("VSQ {vsq:.1} %")), "{figure} {vsq}");
    // The rest of the page is the same.
    let text = String::from_utf8(fs::read(out.join("index.html")).unwrap()).unwrap();
    let script = "<script src=\"viewer/compared.js\"></script>\n";
    assert_eq!(text.replace(script, "").as_bytes(), before);

    open(&mut browser, &out, &format!("#frame={FRAME}"));
    let shown = "document.getElementById('ids').value";
    let has_own_overlay = "!document.getElementById('picture').hidden && document.getElementById('drawn').hidden";
    assert_eq!((browser.value(shown), browser.value(has_own_overlay)), (json!("own"), json!(true)));
    browser.press("x");
    browser.wait_for("!document.getElementById('drawn').hidden");
    assert_eq!(browser.value(shown), "other");
    // A click on a true object selects its partner, if it has one.
    let pairs = found["pairs"].as_array().unwrap();
    assert!(pairs.len() > 3, "{found}");
    let partner = |id: u32| pairs.iter().find(|pair| pair[0] == id).map_or(0, |pair| pair[1].as_u64().unwrap() as u32);
    let settings: SyntheticSettings = SCENE.parse().unwrap();
    let truth = SyntheticScene::new(settings).unwrap().read_ground_truth(FRAME).unwrap().unwrap();
    let (left, top, width, height) = browser.place_of("#marks");
    for (id, (across, down)) in places(&truth) {
        browser.press("Escape");
        browser.click(left + across * width, top + down * height);
        assert_eq!(selected(&mut browser), partner(id), "true object {id}");
    }
    // Both: own ids at the left of the line, true ones at the right.
    browser.press("Escape");
    browser.press("x");
    browser.wait_for("!document.getElementById('divider').hidden");
    let name = browser.value(&format!("splatsegRun.frames[{FRAME}]"));
    let own = read_segments_png(&out.join("segments").join(format!("{}.png", name.as_str().unwrap()))).unwrap();
    for (ids, at_left) in [(&own, true), (&truth, false)] {
        for (id, (across, down)) in
            places(ids).into_iter().filter(|(_, (across, _))| (*across < 0.48) == at_left && *across != 0.5)
        {
            browser.press("Escape");
            browser.click(left + across * width, top + down * height);
            assert_eq!(selected(&mut browser), if at_left { id } else { partner(id) }, "{id} at {across} {down}");
        }
    }
    // The link has the choice; the third time, own ids are shown again.
    browser.wait_for("location.hash.includes('ids=both')");
    browser.press("x");
    browser.wait_for(has_own_overlay);
    assert_eq!(browser.value("document.getElementById('figure').textContent"), format!("ground truth: {figure}"));
    assert_eq!(browser.errors, [] as [String; 0]);
}

#[test]
fn two_runs_of_a_scene_are_compared() {
    let folder = tempfile::tempdir().unwrap();
    let out = run(folder.path(), "out", &[]);
    // With itself, a run agrees.
    compare(&out, Some(&out));
    let found = comparison(&out);
    let figure = found["figure"].as_str().unwrap();
    assert!(figure.contains("100.0 % of their pixels · VSQ 100.0 %, AQ 100.0 %"), "{figure}");
    assert!(found["pairs"].as_array().unwrap().iter().all(|pair| pair[0] == pair[1]), "{found}");
    let other = run(folder.path(), "other", &["--method", "fastsam"]);
    compare(&out, Some(&other));
    let found = comparison(&out);
    assert_eq!(found["name"], other.display().to_string());
    assert!(!found["figure"].as_str().unwrap().contains("VSQ 100.0"), "{found}");
    // The files are the run's: a later one may replace them.
    run(folder.path(), "out", &["--overwrite"]);
    assert!(!out.join("viewer/compared.js").exists() && !out.join("viewer/compared-000.js").exists());
    // A folder without a page is refused.
    let ended = finish(splatseg().arg("eval").arg("--pred").arg(out.join("segments")).args(["--gt", SCENE, "--page"]));
    assert_eq!(ended.code, 0, "{}", ended.err);
    fs::remove_file(out.join("index.html")).unwrap();
    let ended = finish(splatseg().arg("eval").arg("--pred").arg(&out).arg("--page"));
    assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{}", ended.err);
    assert!(ended.err.contains("--page: found no page"), "{}", ended.err);
}
