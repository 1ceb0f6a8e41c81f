//! The page of a large run: 300 objects, 100,000 Gaussians.

use crate::browser::Browser;
use glam::Vec3;
use serde_json::json;
use splatseg_geometry::{FrameAnchor, Image, Intrinsics, Pose, RgbdFrame, SegmentMap};
use splatseg_memory::{MemorySettings, SplatMemory};
use splatseg_objects::{ObjectList, ObjectLog, RemapLog};
use splatseg_odometry::PoseState;
use splatseg_output::{FrameRecord, OutputError, Page, ResultFolder, RunEnd, RunOutput, write_overlay_jpeg};
use splatseg_tracking::FrameOutput;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// Columns and rows of views of a tiled wall. Each view shows one part of the wall.
const VIEWS: (usize, usize) = (5, 4);
const TILES: (usize, usize) = (5, 3);
const CAMERA: Intrinsics = Intrinsics { fx: 200.0, fy: 200.0, cx: 159.5, cy: 119.5, width: 320, height: 240 };
const DISTANCE_M: f32 = 2.0;

/// A result folder without a manifest.
pub struct Folder<'a>(pub &'a Path);

impl ResultFolder for Folder<'_> {
    fn write(&mut self, file: &str, bytes: &[u8]) -> Result<(), OutputError> {
        let path = self.0.join(file);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
        Ok(())
    }

    fn remove(&mut self, file: &str) -> Result<(), OutputError> {
        let _ = fs::remove_file(self.0.join(file));
        Ok(())
    }

    fn path_of(&self, file: &str) -> PathBuf {
        self.0.join(file)
    }
}

/// Returns the frame of a view, and its segments.
fn view(number: usize) -> (RgbdFrame<'static>, SegmentMap) {
    let (width, height) = (CAMERA.width, CAMERA.height);
    let (across, down) = ((number % VIEWS.0) as f32, (number / VIEWS.0) as f32);
    let side = |pixels: usize, focal: f32| pixels as f32 * DISTANCE_M / focal;
    let position = Vec3::new(across * side(width, CAMERA.fx), down * side(height, CAMERA.fy), 0.0);
    let first = number * TILES.0 * TILES.1 + 1;
    let segments = Image::from_fn(width, height, |column, row| {
        let x = column * TILES.0 / width;
        let y = row * TILES.1 / height;
        (first + y * TILES.0 + x) as u32
    });
    let color = Image::from_fn(width, height, |column, row| [column as u8, row as u8, 40 * down as u8]);
    let depth = Image::filled(width, height, DISTANCE_M);
    let pose = Pose::from_translation(position.as_dvec3());
    (RgbdFrame::new(number.to_string(), color, depth, CAMERA, pose).unwrap(), segments)
}

/// Writes the page to a folder. Returns the number of Gaussians.
fn write_page(folder: &Path) -> usize {
    let mut memory = SplatMemory::new(MemorySettings::default(), 0, &mut |_| {}).unwrap();
    let (mut log, mut page) = (ObjectLog::default(), Page::new());
    fs::create_dir_all(folder.join("overlay")).unwrap();
    for number in 0..VIEWS.0 * VIEWS.1 {
        let (frame, segments) = view(number);
        (0..TILES.0 * TILES.1).for_each(|_| assert!(memory.new_segment().is_ok()));
        let recall = memory.recall(&frame);
        memory.update(recall, &segments, &BTreeSet::new()).unwrap();
        write_overlay_jpeg(&folder.join(format!("overlay/{number}.jpg")), frame.color(), &segments).unwrap();
        let objects = log.record(&FrameOutput::from_segments(segments.clone()));
        let record = FrameRecord {
            number,
            index: number,
            pose_state: PoseState::Given,
            file_name: number.to_string(),
            frame,
            segments,
            regions: None,
            objects,
            anchor: FrameAnchor::default(),
            remapped: Vec::new(),
        };
        page.add_frame(&record, &mut Folder(folder)).unwrap();
    }
    let objects = ObjectList::new(&log, Some(memory.map()));
    let (scene, map_at_end, remaps) = ("wall of tiles", Some(memory.map()), RemapLog::default());
    let end = RunEnd {
        scene,
        objects: &objects,
        map: map_at_end,
        plan: None,
        pose_corrections: &[],
        remaps: &remaps,
        changes: None,
    };
    page.finish(&end, &mut Folder(folder)).unwrap();
    memory.gaussian_count()
}

#[test]
fn three_hundred_objects_and_a_hundred_thousand_points_can_be_used() {
    let name = "three_hundred_objects_and_a_hundred_thousand_points_can_be_used";
    let Some(mut browser) = Browser::start(name, 1280, 800) else { return };
    let folder = tempfile::tempdir().unwrap();
    let gaussians = write_page(folder.path());
    assert!(gaussians > 100_000, "{gaussians}");
    browser.open(&folder.path().join("index.html"), "");
    browser.wait_for("document.documentElement?.dataset.ready === 'yes'");
    assert_eq!(browser.value("document.querySelectorAll('#list button').length"), 300);
    assert_eq!(browser.value("splatsegPage.map.splats.count"), 100_000);
    assert!(fs::metadata(folder.path().join("viewer/run.js")).unwrap().len() < 2_500_000);

    // Times loading, and a click in the map and in the list, without drawing, which is slow in software.
    let load_ms = browser.value("performance.getEntriesByType('navigation')[0].loadEventEnd").as_f64().unwrap();
    let drawing_ms = browser.value(
        "(() => { const { map } = splatsegPage; const gl = map.renderer.getContext(); const start = performance.now(); \
         for (let turn = 0; turn < 5; turn++) { map.drawNow(); gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4)); } \
         return (performance.now() - start) / 5; })()",
    );
    let selecting_ms = browser.value(
        "(() => { const start = performance.now(); for (let id = 1; id <= 20; id++) splatsegPage.select(id); \
         return (performance.now() - start) / 20; })()",
    );
    let (left, top, width, height) = browser.place_of("#view");
    browser.press("Escape");
    browser.click(left + width / 2.0, top + height / 2.0);
    let selected = browser.value("Number(document.documentElement.dataset.object)");
    assert!((1..=300).contains(&selected.as_u64().unwrap()), "{selected}");
    // Each tile was seen once, so all are tentative, and folded away.
    browser.click_on("#all");
    browser.click_on("#list [data-object='300']");
    browser.wait_for("document.documentElement.dataset.frame === '19'");
    assert_eq!(browser.value("document.querySelector('#list [aria-pressed=true]').dataset.object"), json!("300"));
    println!("{gaussians} Gaussians: loaded in {load_ms} ms, drawn in {drawing_ms} ms, selected in {selecting_ms} ms");
    assert!(load_ms < 15_000.0 && selecting_ms.as_f64().unwrap() < 500.0, "{load_ms} {selecting_ms}");
    assert_eq!(browser.errors, [] as [String; 0]);
}
