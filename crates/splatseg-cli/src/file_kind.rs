//! Kinds of output files at paths that options give. A file is replaced only by one of its own kind.

use super::Failure;
use super::output_folder::OverwritePolicy;
use serde::Deserialize;
use serde::de::{DeserializeOwned, IgnoredAny};
use splatseg_annotations::TRAJECTORY_HEADER;
use splatseg_output::{CocoFile, McapFile};
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

/// A kind of output file.
#[derive(Clone, Copy, Debug)]
pub struct FileKind {
    /// The option that names the file.
    pub option: &'static str,
    /// Description of the content, for errors.
    pub content: &'static str,
    /// Description of such a file, for errors.
    name: &'static str,
    /// Endings of such names, without the point; empty if all are allowed.
    endings: &'static [&'static str],
    sign: Sign,
}

/// How files of a kind are recognised.
#[derive(Clone, Copy, Debug)]
enum Sign {
    /// By their first bytes: they have one of these.
    Starts(&'static [&'static [u8]]),
    /// By what this function finds in them.
    Content(fn(File) -> bool),
}

impl FileKind {
    /// A saved memory.
    pub const MEMORY: Self = Self {
        option: "--save-memory",
        content: "the memory",
        name: "a saved memory",
        endings: &[],
        sign: Sign::Starts(&[b"ply\nformat binary_little_endian 1.0\ncomment splatseg memory "]),
    };
    /// The map of a live session.
    pub const MAP: Self = Self { option: "--map", content: "the map", ..Self::MEMORY };
    /// The list of objects beside the map of a live session.
    pub const OBJECTS: Self = Self {
        content: "the objects",
        name: "a list of objects by splatseg",
        sign: Sign::Starts(&[b"{\n  \"format\": \"splatseg-objects\""]),
        ..Self::MAP
    };
    /// A map that `merge` or `name` saves.
    pub const CHANGED_MAP: Self = Self { option: "--out", ..Self::MAP };
    /// Gaussians or points for other programs.
    pub const EXPORTED: Self = Self {
        option: "--out",
        content: "the Gaussians",
        name: "a PLY file that `splatseg export` wrote",
        endings: &["ply"],
        sign: Sign::Starts(&[b"ply\nformat binary_little_endian 1.0\ncomment exported by splatseg\n"]),
    };
    /// A mesh as PLY.
    pub const MESH: Self = Self { content: "the mesh", endings: &["glb", "ply"], ..Self::EXPORTED };
    /// A mesh as binary glTF.
    pub const GLTF: Self = Self { name: "a glTF file by splatseg", sign: Sign::Content(is_gltf), ..Self::MESH };
    /// A scene graph.
    pub const SCENE_GRAPH: Self = Self {
        option: "--out",
        content: "the scene graph",
        name: "a scene graph by splatseg",
        endings: &["json"],
        sign: Sign::Starts(&[b"{\n  \"format\": \"splatseg-scene-graph\""]),
    };
    /// Rooms and footprints of a plan.
    pub const PLAN: Self = Self {
        content: "the plan",
        name: "a plan by splatseg",
        sign: Sign::Starts(&[b"{\"format\":\"splatseg-plan\","]),
        ..Self::SCENE_GRAPH
    };
    /// The YAML file of a plan.
    pub const PLAN_YAML: Self = Self {
        name: "a map_server file by splatseg",
        endings: &["yaml"],
        sign: Sign::Starts(&[b"# Frame: the map's world, z up.\n", b"# Frame: the map's world turned so that "]),
        ..Self::PLAN
    };
    /// The image of a plan for `map_server`. It does not tell who wrote it.
    pub const PLAN_IMAGE: Self =
        Self { name: "a PGM image", endings: &["pgm"], sign: Sign::Starts(&[b"P5\n"]), ..Self::PLAN };
    /// The picture of a plan. It does not tell who wrote it.
    pub const PLAN_PICTURE: Self =
        Self { name: "a PNG image", endings: &["png"], sign: Sign::Starts(&[b"\x89PNG\r\n\x1a\n"]), ..Self::PLAN };
    /// A COCO file with all masks.
    pub const COCO: Self = Self {
        option: "--save-coco",
        content: "the masks",
        name: "a COCO file by splatseg",
        endings: &[],
        sign: Sign::Starts(&[CocoFile::START.as_bytes()]),
    };
    /// A recording for robotics viewers. Readers recognise it by its ending.
    pub const MCAP: Self = Self {
        option: "--save-mcap",
        content: "the recording",
        name: "a recording by splatseg",
        endings: &["mcap"],
        sign: Sign::Starts(McapFile::STARTS),
    };
    /// A converted scene.
    pub const CONVERTED: Self = Self { option: "OUT.mcap", ..Self::MCAP };
    /// The part of the stream that a live session used.
    pub const RECORDING: Self = Self { option: "--record", ..Self::MCAP };
    /// Poses of the frames that `locate` has found.
    pub const POSES: Self = Self {
        option: "--out",
        content: "the poses",
        name: "a file of poses by splatseg",
        endings: &[],
        sign: Sign::Starts(&[TRAJECTORY_HEADER.as_bytes()]),
    };
    /// All frames that `locate` has searched for.
    pub const LOCATED: Self = Self {
        option: "--json",
        content: "the frames",
        name: "a file that `splatseg locate --json` wrote",
        endings: &[],
        sign: Sign::Content(has::<LocatedKeys>),
    };
    /// Changes between two maps.
    pub const CHANGES: Self = Self {
        option: "--out",
        content: "the changes",
        name: "a file of changes by splatseg",
        endings: &[],
        sign: Sign::Content(has::<ChangesKeys>),
    };
    /// Scores of `eval`.
    pub const SCORES: Self = Self {
        option: "--json",
        content: "the scores",
        name: "a file of scores by `splatseg eval`",
        endings: &[],
        sign: Sign::Content(has_scores),
    };

    /// The same kind, named by another option.
    pub fn with_option(self, option: &'static str) -> Self {
        Self { option, ..self }
    }

    /// Checks that a file of this kind may be written: its name has the right ending, and it replaces at most one of its
    /// kind, if `existing` allows that.
    pub fn check(&self, path: &Path, existing: OverwritePolicy) -> Result<(), Failure> {
        let wrong = |reason: String| Err(Failure::input(format!("{}: {reason}", path.display())));
        let is_ending =
            |ending: &&str| path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(ending));
        if !self.endings.is_empty() && !self.endings.iter().any(is_ending) {
            return wrong(format!("expected a name that ends in .{}", self.endings.join(" or .")));
        }
        if path.symlink_metadata().is_err() {
            return Ok(());
        }
        if existing == OverwritePolicy::Keep {
            return wrong("exists: give --overwrite to replace it".to_owned());
        }
        if !self.is_kind_of(path) {
            return wrong(format!("exists and is not {}: choose another file for {}", self.name, self.option));
        }
        Ok(())
    }

    /// Returns true if the file at `path` is of this kind.
    fn is_kind_of(&self, path: &Path) -> bool {
        // Of pipes and devices, nothing may be read.
        let open = || File::open(path).ok().filter(|_| path.is_file());
        let begins = |start: &&[u8]| {
            let mut found = vec![0; start.len()];
            open().is_some_and(|mut file| file.read_exact(&mut found).is_ok()) && found == **start
        };
        match self.sign {
            Sign::Starts(starts) => starts.iter().any(begins),
            Sign::Content(is_it) => open().is_some_and(is_it),
        }
    }
}

/// Returns true if a file is binary glTF that names splatseg as its generator.
fn is_gltf(mut file: File) -> bool {
    #[derive(Deserialize)]
    struct Document {
        asset: Asset,
    }
    #[derive(Deserialize)]
    struct Asset {
        generator: String,
    }
    // Magic, version and length of the file, then length and type of the JSON that follows.
    let mut head = [0; 20];
    if file.read_exact(&mut head).is_err() || !head.starts_with(b"glTF") {
        return false;
    }
    let length = u32::from_le_bytes([head[12], head[13], head[14], head[15]]);
    let json = BufReader::new(file.take(length.into()));
    serde_json::from_reader::<_, Document>(json).is_ok_and(|document| document.asset.generator.starts_with("splatseg"))
}

/// Returns true if a file is a JSON object with the keys of `Keys`. Others may be between them.
fn has<Keys: DeserializeOwned>(file: File) -> bool {
    serde_json::from_reader::<_, Keys>(BufReader::new(file)).is_ok()
}

/// Keys of the file of `locate --json`.
#[derive(Deserialize)]
#[expect(dead_code, reason = "it matters only that they are there")]
struct LocatedKeys {
    map: IgnoredAny,
    scene: IgnoredAny,
    keyframes: IgnoredAny,
    mean_ms: IgnoredAny,
    results: IgnoredAny,
    version: IgnoredAny,
}

/// Keys of a file of changes.
#[derive(Deserialize)]
#[expect(dead_code, reason = "it matters only that they are there")]
struct ChangesKeys {
    gone: IgnoredAny,
    new: IgnoredAny,
    moved: IgnoredAny,
    unchanged: IgnoredAny,
    not_looked_at: IgnoredAny,
}

/// Returns true if a file has scores of `eval`: of a video, a mesh, or a trajectory.
fn has_scores(file: File) -> bool {
    #[derive(Deserialize)]
    #[expect(dead_code, reason = "it matters only that they are there")]
    struct Scores {
        predictions: String,
        version: String,
        min_truth_area: Option<IgnoredAny>,
        unseen_vertices: Option<IgnoredAny>,
        rpe_frames: Option<IgnoredAny>,
    }
    serde_json::from_reader::<_, Scores>(BufReader::new(file))
        .is_ok_and(|scores| scores.min_truth_area.or(scores.unseen_vertices).or(scores.rpe_frames).is_some())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn files_of_others_with_the_format_of_ours_are_not_ours() {
        let folder = tempfile::tempdir().unwrap();
        let is = |kind: FileKind, content: &[u8]| {
            let path = folder.path().join("file");
            fs::write(&path, content).unwrap();
            kind.is_kind_of(&path)
        };
        let ply = |comment: &str| format!("ply\nformat binary_little_endian 1.0\ncomment {comment}\n").into_bytes();
        assert!(is(FileKind::MEMORY, &ply("splatseg memory 5 kind evidence")));
        assert!(!is(FileKind::MEMORY, &ply("exported by splatseg")) && !is(FileKind::MEMORY, &ply("a scan")));
        assert!(is(FileKind::EXPORTED, &ply("exported by splatseg")));
        assert!(!is(FileKind::EXPORTED, &ply("splatseg memory 5")) && !is(FileKind::EXPORTED, &ply("a scan")));
        let glb = |generator: &str| {
            let json = format!("{{\"accessors\":[{{}}],\"asset\":{{\"generator\":\"{generator}\"}}}}  ");
            let length = (json.len() as u32).to_le_bytes();
            [b"glTF\x02\0\0\0\0\0\0\0".as_slice(), &length, b"JSON", json.as_bytes(), b"more"].concat()
        };
        assert!(is(FileKind::GLTF, &glb("splatseg 0.1.0")) && !is(FileKind::GLTF, &glb("Blender")));
        assert!(!is(FileKind::GLTF, b"glTF") && !is(FileKind::GLTF, b""));
        let scores: &[u8] = br#"{"vsq": 1.0, "min_truth_area": 0, "predictions": "out", "version": "0.1.0"}"#;
        assert!(is(FileKind::SCORES, scores));
        assert!(!is(FileKind::SCORES, br#"{"predictions": [1, 2], "version": "2.0", "rpe_frames": 1}"#));
        assert!(!is(FileKind::LOCATED, scores) && !is(FileKind::CHANGES, scores));
    }
}
