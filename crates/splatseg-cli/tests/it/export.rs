//! `splatseg export`: the content of the files, and errors.

use crate::support::{Ended, FEATURES, ROOM, file_names, finish, splatseg};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use std::sync::OnceLock;

/// Returns the saved memory of a run over a small room.
fn saved_map(more: &[&str]) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let map = folder.path().join("map.ply");
    let mut run = splatseg();
    run.args(["run", ROOM, "--out"]).arg(folder.path().join("out")).arg("--save-memory").arg(&map).args(more);
    let ended = finish(run.args(["--segmenter", "oracle"]));
    assert_eq!(ended.code, 0, "{}", ended.err);
    fs::read(map).unwrap()
}

/// Returns a folder with this memory as `map.ply`.
pub fn place() -> tempfile::TempDir {
    static MAP: OnceLock<Vec<u8>> = OnceLock::new();
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("map.ply"), MAP.get_or_init(|| saved_map(&[]))).unwrap();
    folder
}

fn export(folder: &Path, more: &[&str]) -> Ended {
    finish(splatseg().current_dir(folder).args(["export", "map.ply"]).args(more))
}

pub fn exported(folder: &Path, more: &[&str]) -> Ended {
    let ended = export(folder, more);
    assert_eq!((ended.code, ended.err.as_str()), (0, ""), "{}", ended.out);
    ended
}

/// Returns the error of an export that must fail and leave the folder unchanged.
pub fn refused(folder: &Path, more: &[&str]) -> String {
    let before = file_names(folder);
    let ended = export(folder, more);
    assert_eq!((ended.code, ended.out.as_str()), (2, ""), "{}", ended.err);
    assert_eq!(file_names(folder), before);
    ended.err
}

/// A PLY file: the values of each property, by name.
struct Ply(BTreeMap<String, Vec<f64>>);

impl Ply {
    fn read(path: &Path) -> Self {
        let bytes = fs::read(path).unwrap();
        let start = bytes.windows(11).position(|window| window == b"end_header\n").unwrap() + 11;
        let header = std::str::from_utf8(&bytes[..start]).unwrap();
        assert!(header.starts_with("ply\nformat binary_little_endian 1.0\n"));
        let count: usize =
            header.lines().find_map(|line| line.strip_prefix("element vertex ")).unwrap().parse().unwrap();
        let mut values: BTreeMap<String, Vec<f64>> = BTreeMap::new();
        let mut rest = &bytes[start..];
        for _ in 0..count {
            for property in header.lines().filter_map(|line| line.strip_prefix("property ")) {
                let (kind, name) = property.split_once(' ').unwrap();
                let size = if kind == "uchar" { 1 } else { 4 };
                let (word, after) = rest.split_at(size);
                rest = after;
                let value = match kind {
                    "uchar" => f64::from(word[0]),
                    "float" => f64::from(f32::from_le_bytes(word.try_into().unwrap())),
                    _ => f64::from(u32::from_le_bytes(word.try_into().unwrap())),
                };
                values.entry(name.to_owned()).or_default().push(value);
            }
        }
        // Only a saved memory has data after its vertices.
        assert!(rest.is_empty() || header.contains("splatseg memory"));
        Self(values)
    }

    fn len(&self) -> usize {
        self.0["x"].len()
    }

    fn ids(&self) -> Vec<u32> {
        self.0["segment_id"].iter().map(|id| *id as u32).collect()
    }

    fn objects(&self) -> BTreeSet<u32> {
        self.ids().into_iter().filter(|id| *id != 0).collect()
    }
}

#[test]
fn all_gaussians_keep_their_order_and_values() {
    let folder = place();
    let ended = exported(folder.path(), &["--out", "all.ply"]);
    let (map, all) = (Ply::read(&folder.path().join("map.ply")), Ply::read(&folder.path().join("all.ply")));
    for (name, values) in &all.0 {
        assert_eq!(values, &map.0[name], "{name}");
    }
    assert_eq!(all.0.len(), 18);
    assert!(all.objects().len() >= 5);
    assert_eq!(ended.out, format!("all.ply: {} Gaussians of {} objects\n", map.len(), map.objects().len()));
}

#[test]
fn some_objects_as_points_in_their_colours() {
    let folder = place();
    let map = Ply::read(&folder.path().join("map.ply"));
    let wanted: Vec<u32> = map.objects().into_iter().take(2).collect();
    let ids = format!("{},{}", wanted[0], wanted[1]);
    exported(folder.path(), &["--out", "new/two.ply", "--id", &ids, "--as", "points", "--color", "id"]);
    exported(folder.path(), &["--out", "true.ply", "--id", &ids, "--as", "points"]);
    let (two, seen) = (Ply::read(&folder.path().join("new/two.ply")), Ply::read(&folder.path().join("true.ply")));
    let places: Vec<usize> = (0..map.len()).filter(|index| wanted.contains(&map.ids()[*index])).collect();
    assert_eq!(two.0["x"], places.iter().map(|index| map.0["x"][*index]).collect::<Vec<_>>());
    assert_eq!(two.objects(), wanted.iter().copied().collect());
    let colors = |ply: &Ply, id: u32| -> BTreeSet<[u8; 3]> {
        let of = |index: usize| ["red", "green", "blue"].map(|channel| ply.0[channel][index] as u8);
        (0..ply.len()).filter(|index| ply.ids()[*index] == id).map(of).collect()
    };
    for id in wanted {
        assert_eq!(colors(&two, id), BTreeSet::from([splatseg_output::segment_color(id)]));
        assert!(colors(&seen, id).len() > 3, "a texture has many colours");
    }
}

#[test]
fn each_object_gets_a_file() {
    let folder = place();
    let ended = exported(folder.path(), &["--object-files", "objects", "--as", "points", "--out", "all.ply"]);
    let map = Ply::read(&folder.path().join("map.ply"));
    let mut gaussians = 0;
    for id in map.objects() {
        let object = Ply::read(&folder.path().join(format!("objects/{id}.ply")));
        assert_eq!(object.objects(), BTreeSet::from([id]));
        gaussians += object.len();
    }
    assert_eq!(file_names(&folder.path().join("objects")).len(), map.objects().len());
    assert_eq!(gaussians, map.ids().iter().filter(|id| **id != 0).count());
    let last = ended.out.lines().last().unwrap();
    let count = map.objects().len();
    assert_eq!(last, format!("objects: {count} files, {gaussians} points of {count} objects"));
}

#[test]
fn unsure_gaussians_are_left_out() {
    let folder = place();
    exported(folder.path(), &["--out", "all.ply"]);
    exported(folder.path(), &["--out", "sure.ply", "--min-confidence", "0.9"]);
    let (all, sure) = (Ply::read(&folder.path().join("all.ply")), Ply::read(&folder.path().join("sure.ply")));
    assert!(sure.len() < all.len() && sure.len() > all.len() / 2, "{} of {}", sure.len(), all.len());
    let error = refused(folder.path(), &["--out", "none.ply", "--min-confidence", "1.5"]);
    assert_eq!(error, "error: --min-confidence: found 1.5, expected a number from 0 to 1\n");
    assert!(refused(folder.path(), &["--out", "none.ply", "--min-confidence", "nan"]).contains("found NaN"));
}

#[test]
fn memories_of_features_are_exported_too() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("map.ply"), saved_map(&FEATURES)).unwrap();
    exported(folder.path(), &["--out", "all.ply", "--color", "id", "--min-confidence", "0.05"]);
    assert!(Ply::read(&folder.path().join("all.ply")).objects().len() >= 4);
}

#[test]
fn unknown_objects_are_reported_with_the_known_ids() {
    let folder = place();
    let known = Ply::read(&folder.path().join("map.ply")).objects();
    let error = refused(folder.path(), &["--out", "a.ply", "--id", "1,900,901,902"]);
    assert!(error.starts_with("error: map.ply: no Gaussian shows object 900 to 902; the ids are "), "{error}");
    assert!(error.trim_end().ends_with(&known.last().unwrap().to_string()), "{error}");
    assert!(
        refused(folder.path(), &["--out", "a.ply", "--id", "0"]).contains("no Gaussian shows object 0; the ids are")
    );
    assert_eq!(export(folder.path(), &["--out", "a.ply", "--id", "seven"]).code, 2);
    assert!(refused(folder.path(), &[]).contains("--out"));
}

#[test]
fn nothing_is_overwritten_without_the_option() {
    let folder = place();
    let path = |name: &str| folder.path().join(name);
    let map = fs::read(path("map.ply")).unwrap();
    fs::write(path("notes.txt"), "mine").unwrap();
    exported(folder.path(), &["--out", "a.ply"]);
    assert_eq!(refused(folder.path(), &["--out", "a.ply"]), "error: a.ply: exists: give --overwrite to replace it\n");
    exported(folder.path(), &["--out", "a.ply", "--as", "points", "--overwrite"]);
    assert!(fs::read_to_string(path("a.ply")).is_err() && !Ply::read(&path("a.ply")).0.contains_key("opacity"));
    let notes = refused(folder.path(), &["--out", "notes.txt", "--overwrite"]);
    assert_eq!(notes, "error: notes.txt: expected a name that ends in .ply\n");
    fs::write(path("scan.ply"), "ply\nformat ascii 1.0\n").unwrap();
    let scan = refused(folder.path(), &["--out", "scan.ply", "--overwrite"]);
    assert!(scan.contains("exists and is not a PLY file that `splatseg export` wrote"), "{scan}");
    for out in ["map.ply", "./a/../map.ply"] {
        let error = refused(folder.path(), &["--out", out, "--overwrite"]);
        assert!(error.contains("is the map: choose another file"), "{error}");
    }
    // One of the object files exists: none of the others is written.
    let id = Ply::read(&path("map.ply")).objects().pop_last().unwrap();
    fs::create_dir(path("objects")).unwrap();
    fs::copy(path("a.ply"), path(&format!("objects/{id}.ply"))).unwrap();
    let error = refused(folder.path(), &["--object-files", "objects"]);
    assert_eq!(error, format!("error: objects/{id}.ply: exists: give --overwrite to replace it\n"));
    assert_eq!(file_names(&path("objects")).len(), 1);
    let both = refused(folder.path(), &["--object-files", "new", "--out", &format!("new/{id}.ply")]);
    assert!(both.contains(&format!("is also the file of object {id}")), "{both}");
    exported(folder.path(), &["--object-files", "objects", "--overwrite"]);
    assert_eq!(
        (fs::read(path("map.ply")).unwrap(), fs::read_to_string(path("notes.txt")).unwrap()),
        (map, "mine".to_owned())
    );
}

/// A saved map is a PLY file, too, but no export may replace it.
#[test]
fn no_saved_map_is_replaced() {
    let folder = place();
    let path = |name: &str| folder.path().join(name);
    let map = fs::read(path("map.ply")).unwrap();
    let id = Ply::read(&path("map.ply")).objects().pop_last().unwrap();
    fs::create_dir(path("objects")).unwrap();
    let copies = ["home.ply".to_owned(), format!("objects/{id}.ply")];
    copies.iter().for_each(|copy| fs::write(path(copy), &map).unwrap());
    for form in ["gaussians", "points", "mesh"] {
        for to in [["--out", "home.ply"], ["--object-files", "objects"]] {
            let error = refused(folder.path(), &[&["--as", form, "--overwrite"][..], &to].concat());
            assert!(error.contains("exists and is not a PLY file that `splatseg export` wrote"), "{form}: {error}");
        }
    }
    copies.iter().for_each(|copy| assert!(fs::read(path(copy)).unwrap() == map, "{copy}"));
}

#[test]
fn names_end_as_what_is_written() {
    let folder = place();
    for (form, out, endings) in [
        ("mesh", "m.obj", ".glb or .ply"),
        ("mesh", "M.gltf", ".glb or .ply"),
        ("mesh", "m", ".glb or .ply"),
        ("points", "p.glb", ".ply"),
        ("gaussians", "g.splat", ".ply"),
        ("scene-graph", "g.xml", ".json"),
    ] {
        let error = refused(folder.path(), &["--as", form, "--out", out]);
        assert_eq!(error, format!("error: {out}: expected a name that ends in {endings}\n"));
    }
}

#[test]
fn a_plan_replaces_no_files_of_others() {
    let folder = place();
    let notes = "{ \"mine\": true }";
    for (ending, expected) in [
        ("json", "u.json: exists and is not a plan by splatseg"),
        ("yaml", "u.yaml: exists and is not a map_server file by splatseg"),
        ("png", "u.png: exists and is not a PNG image"),
        ("pgm", "u.pgm: exists and is not a PGM image"),
    ] {
        let file = folder.path().join(format!("u.{ending}"));
        fs::write(&file, notes).unwrap();
        let error = refused(folder.path(), &["--as", "occupancy", "--out", "u", "--overwrite"]);
        assert!(error.contains(expected), "{error}");
        assert_eq!(fs::read_to_string(&file).unwrap(), notes);
        fs::remove_file(file).unwrap();
    }
    for (ending, content) in [("pgm", &b"P5\n1 1\n255\n0"[..]), ("png", b"\x89PNG\r\n\x1a\nmine")] {
        let file = folder.path().join(format!("u.{ending}"));
        fs::write(&file, content).unwrap();
        let error = refused(folder.path(), &["--as", "occupancy", "--out", "u", "--overwrite"]);
        assert!(error.contains("so it is not known to be of a plan"), "{error}");
        assert_eq!(fs::read(&file).unwrap(), content);
        fs::remove_file(file).unwrap();
    }
}

#[test]
fn other_files_are_refused() {
    let folder = place();
    exported(folder.path(), &["--out", "a.ply"]);
    let error = finish(splatseg().current_dir(folder.path()).args(["export", "a.ply", "--out", "b.ply"]));
    assert_eq!(error.code, 2);
    assert!(error.err.contains("a.ply: a PLY file, but not a splatseg memory"), "{}", error.err);
    let map = folder.path().join("map.ply");
    let bytes = fs::read(&map).unwrap();
    fs::write(&map, &bytes[..bytes.len() - 9]).unwrap();
    assert!(refused(folder.path(), &["--out", "b.ply"]).contains("cut off or damaged"));
    fs::remove_file(&map).unwrap();
    assert!(refused(folder.path(), &["--out", "b.ply"]).contains("map.ply"));
}
