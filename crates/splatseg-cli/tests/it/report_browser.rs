//! The benchmark's report: complete in one file, and working in a real browser.

use crate::support::{OTHER_ROOM, ROOM, bench};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Elements without a closing tag.
const VOID: [&str; 6] = ["meta", "link", "img", "input", "br", "hr"];

fn report(folder: &Path) -> PathBuf {
    let ended = bench(&[ROOM, OTHER_ROOM], folder, &["--max-frames", "16"]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    folder.join("report.html")
}

/// Returns the text between two marks.
fn between<'a>(text: &'a str, start: &str, end: &str) -> &'a str {
    let from = text.find(start).unwrap() + start.len();
    &text[from..from + text[from..].find(end).unwrap()]
}

#[test]
fn the_page_is_one_file_and_its_elements_are_closed() {
    let folder = tempfile::tempdir().unwrap();
    let page = fs::read_to_string(report(folder.path())).unwrap();
    assert!(page.len() < 2_000_000, "{} bytes", page.len());
    for reference in ["http:", "https:", "src=\"/", "href=\"/", "@import", "url("] {
        assert!(!page.contains(reference), "{reference}");
    }
    let data: Value = serde_json::from_str(between(&page, "id=\"benchmark\">", "</script>")).unwrap();
    for strip in data["strips"].as_array().unwrap() {
        let frames = strip["frames"].as_array().unwrap().len();
        assert_eq!(frames, 16);
        let panels = strip["panels"].as_array().unwrap();
        assert_eq!(panels.len(), 4);
        for image in panels.iter().flat_map(|panel| panel["images"].as_array().unwrap()) {
            assert!(image.as_str().unwrap().starts_with("data:image/jpeg;base64,"));
        }
    }
    check_closed(&page);
}

/// Asserts that every opened element is closed, in order.
fn check_closed(page: &str) {
    let mut open: Vec<&str> = Vec::new();
    let mut rest = page.strip_prefix("<!DOCTYPE html>").unwrap();
    while let Some(start) = rest.find('<') {
        rest = &rest[start + 1..];
        let tag = &rest[..rest.find('>').unwrap()];
        rest = &rest[tag.len() + 1..];
        if let Some(name) = tag.strip_prefix('/') {
            assert_eq!(open.pop(), Some(name));
            continue;
        }
        let name = tag.split([' ', '\n']).next().unwrap();
        if !VOID.contains(&name) {
            open.push(name);
        }
        if name == "script" || name == "style" {
            rest = &rest[rest.find(&format!("</{name}>")).unwrap()..];
        }
    }
    assert_eq!(open, [] as [&str; 0]);
}

/// Returns the page's elements after its scripts have run, or `None` without a browser.
fn dom(page: &Path, hash: &str) -> Option<String> {
    let profile = tempfile::tempdir().unwrap();
    let mut browser = Command::new("chromium");
    browser.args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"]);
    browser.args(["--disable-background-networking", "--disable-component-update", "--disable-sync", "--dump-dom"]);
    browser.arg(format!("--user-data-dir={}", profile.path().display()));
    let output = match browser.arg(format!("file://{}{hash}", page.display())).output() {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return None,
        output => output.unwrap(),
    };
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Some(String::from_utf8(output.stdout).unwrap())
}

#[test]
fn sliders_move_and_charts_are_drawn_in_a_browser() {
    let folder = tempfile::tempdir().unwrap();
    let page = report(folder.path());
    let Some(start) = dom(&page, "") else {
        let test = "sliders_move_and_charts_are_drawn_in_a_browser";
        return splatseg_test_scenes::skipped(test, "chromium is not installed");
    };
    let moved = dom(&page, "#frame=7").unwrap();
    assert!(start.contains("data-ready=\"yes\""), "the script did not run to its end");
    // VSQ over k and two scatter plots; for each scene, Gaussians and the stages of two methods.
    assert_eq!(start.matches("<svg ").count(), 3 + 2 * 3);
    assert!(start.matches("class=\"curve ").count() >= 4 && start.matches("class=\"area ").count() >= 4);
    for drawing in start.split("<svg ").skip(1) {
        let drawing = &drawing[..drawing.find("</svg>").unwrap()];
        assert!(!drawing.contains("NaN") && !drawing.contains("inf"), "{drawing}");
    }

    let data: Value = serde_json::from_str(between(&start, "id=\"benchmark\">", "</script>")).unwrap();
    for (page, frame) in [(&start, 0), (&moved, 7)] {
        let strip = &data["strips"][0];
        assert_eq!(between(page, "<output>", "</output>"), strip["frames"][frame].as_str().unwrap());
        for panel in strip["panels"].as_array().unwrap() {
            let image = format!("<img alt=\"{}\" src=\"", panel["label"].as_str().unwrap());
            assert_eq!(between(page, &image, "\""), panel["images"][frame].as_str().unwrap());
        }
    }
}
