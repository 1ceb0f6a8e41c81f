//! Recordings of an Azure Kinect in Matroska, in the ways in which files of others may differ.

use super::recording::jpeg_bytes;
use super::warnings::with_warnings;
use glam::{DMat3, DVec2, DVec3, dvec2};
use serde_json::json;
use splatseg_dataset::{DatasetSettings, open_scene};
use splatseg_geometry::{CameraFrame, Image};
use std::fs;
use std::path::PathBuf;

/// cx, cy, fx, fy, k1 to k6, two that are not used, p2, p1 of the depth and the colour camera, as of real devices.
pub const DEPTH_LENS: [f64; 14] =
    [0.5032, 0.5027, 0.4924, 0.4926, 6.0841, 4.3755, 0.2362, 6.4087, 6.4183, 1.2203, 0.0, 0.0, 6.5e-5, -5.5e-5];
pub const COLOR_LENS: [f64; 14] =
    [0.4987, 0.5021, 0.4782, 0.6374, 0.5844, -2.4942, 1.3603, 0.4648, -2.3362, 1.3012, 0.0, 0.0, -1.765e-4, 6.531e-4];
pub const MODEL: &str = "CALIBRATION_LensDistortionModelBrownConrady";

/// Returns rotation and translation of points from the depth camera to the colour camera, metres.
pub fn color_from_depth() -> (DMat3, DVec3) {
    (DMat3::from_rotation_x(-0.1027), DVec3::new(-0.03202, -0.00208, 0.00393))
}

/// Returns the content of `calibration.json`.
pub fn calibration() -> Vec<u8> {
    let camera = |location: &str, lens: [f64; 14], size: (u32, u32), rotation: DMat3, translation: DVec3| {
        json!({
            "Intrinsics": {"ModelParameterCount": 14, "ModelParameters": lens, "ModelType": MODEL},
            "Location": format!("CALIBRATION_CameraLocation{location}"),
            "MetricRadius": 1.74,
            "Rt": {"Rotation": rotation.transpose().to_cols_array(), "Translation": translation.to_array()},
            "SensorHeight": size.1,
            "SensorWidth": size.0,
        })
    };
    let (rotation, translation) = color_from_depth();
    let cameras = [
        camera("D0", DEPTH_LENS, (1024, 1024), DMat3::IDENTITY, DVec3::ZERO),
        camera("PV0", COLOR_LENS, (4096, 3072), rotation, translation),
    ];
    json!({"CalibrationInformation": {"Cameras": cameras}}).to_string().into_bytes()
}

/// A camera in a mode, as the SDK computes it. Independent of the reader.
#[derive(Clone, Copy)]
pub struct Camera {
    lens: [f64; 14],
    focal: DVec2,
    center: DVec2,
}

impl Camera {
    /// `sensor` is the size of the sensor's image at the mode's resolution, of which the mode's begins at `start`.
    pub fn new(lens: [f64; 14], sensor: (f64, f64), start: (f64, f64)) -> Self {
        let focal = dvec2(lens[2] * sensor.0, lens[3] * sensor.1);
        let center = dvec2(lens[0] * sensor.0 - start.0 - 0.5, lens[1] * sensor.1 - start.1 - 0.5);
        Self { lens, focal, center }
    }

    fn distort(&self, point: DVec2) -> DVec2 {
        let [_, _, _, _, k1, k2, k3, k4, k5, k6, _, _, p2, p1] = self.lens;
        let DVec2 { x, y } = point;
        let square = x * x + y * y;
        let factor = (1.0 + k1 * square + k2 * square.powi(2) + k3 * square.powi(3))
            / (1.0 + k4 * square + k5 * square.powi(2) + k6 * square.powi(3));
        dvec2(
            x * factor + p2 * (square + 2.0 * x * x) + 2.0 * p1 * x * y,
            y * factor + p1 * (square + 2.0 * y * y) + 2.0 * p2 * x * y,
        )
    }

    /// Returns where a point in front of the camera, z = 1, is seen.
    pub fn project(&self, point: DVec2) -> DVec2 {
        self.distort(point) * self.focal + self.center
    }

    /// Returns the point, z = 1, that a pixel sees.
    pub fn unproject(&self, pixel: DVec2) -> DVec2 {
        let wanted = (pixel - self.center) / self.focal;
        // What is missing is added, which converges slowly.
        (0..2000).fold(wanted, |point, _| point + 0.5 * (wanted - self.distort(point)))
    }
}

/// Returns an element whose size has eight bytes.
pub fn element(id: u32, data: &[u8]) -> Vec<u8> {
    let mut bytes = start(id);
    bytes.extend((1u64 << 56 | data.len() as u64).to_be_bytes());
    bytes.extend(data);
    bytes
}

/// Returns the start of an element whose size was not known.
pub fn unknown_size(id: u32) -> Vec<u8> {
    [start(id), vec![0x01, 255, 255, 255, 255, 255, 255, 255]].concat()
}

fn start(id: u32) -> Vec<u8> {
    id.to_be_bytes().into_iter().skip_while(|byte| *byte == 0).collect()
}

fn number(id: u32, value: u64) -> Vec<u8> {
    element(id, &value.to_be_bytes())
}

/// A track: number, name, codec, its private data, and the size of its images.
pub fn track(number_of: u64, name: &str, codec: &str, private: &[u8], size: (u64, u64)) -> Vec<u8> {
    let video = [number(0xB0, size.0), number(0xBA, size.1)].concat();
    let parts = [
        number(0xD7, number_of),
        number(0x73C5, 1000 + number_of),
        element(0x536E, name.as_bytes()),
        element(0x86, codec.as_bytes()),
        element(0x63A2, private),
        element(0xE0, &video),
    ];
    element(0xAE, &parts.concat())
}

/// Returns a BITMAPINFOHEADER with a format.
pub fn bitmap_header(four_cc: &[u8; 4]) -> Vec<u8> {
    [&[0; 16][..], four_cc, &[0; 20]].concat()
}

/// Where the parts of the head other than the tracks are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum HeadPlace {
    #[default]
    First,
    /// After the clusters, with a list at the start that says where.
    Last,
}

/// An image: number of its track, time in microseconds, and data.
pub type Block = (u8, u64, Vec<u8>);

/// Writes a recording.
#[derive(Clone, Default)]
pub struct MkvWriter {
    pub tracks: Vec<Vec<u8>>,
    pub tags: Vec<(String, String)>,
    pub calibration: Option<Vec<u8>>,
    pub blocks: Vec<Block>,
    pub head: HeadPlace,
    /// Sizes of segment and clusters are unknown, as in a stream.
    pub is_streamed: bool,
    /// Blocks are in groups.
    pub is_grouped: bool,
    /// Flags of all blocks.
    pub flags: u8,
}

pub const COLOR: u8 = 1;
pub const DEPTH: u8 = 2;
/// Sizes of small images of the shapes of NFOV and of 16:9.
pub const SMALL_DEPTH: (u64, u64) = (20, 18);
pub const SMALL_COLOR: (u64, u64) = (32, 18);
/// Microseconds between frames.
pub const PERIOD: u64 = 33_333;

impl MkvWriter {
    /// A recording with colour as JPEG and depth of a size.
    pub fn new(color: (u64, u64), depth: (u64, u64)) -> Self {
        let fourcc = "V_MS/VFW/FOURCC";
        Self {
            tracks: vec![
                track(COLOR.into(), "COLOR", fourcc, &bitmap_header(b"MJPG"), color),
                track(DEPTH.into(), "DEPTH", fourcc, &bitmap_header(b"b16g"), depth),
            ],
            tags: vec![("K4A_DEPTH_MODE".to_owned(), "NFOV_UNBINNED".to_owned())],
            calibration: Some(calibration()),
            ..Self::default()
        }
    }

    pub fn bytes(&self) -> Vec<u8> {
        let attachments = self.calibration.as_ref().map(|file| {
            let parts = [element(0x466E, b"calibration.json"), element(0x465C, file)].concat();
            element(0x1941_A469, &element(0x61A7, &parts))
        });
        let simple = |(name, value): &(String, String)| {
            let parts = [element(0x45A3, name.as_bytes()), element(0x4487, value.as_bytes())].concat();
            element(0x7373, &element(0x67C8, &parts))
        };
        let tags: Vec<u8> = self.tags.iter().flat_map(simple).collect();
        let attachments = attachments.unwrap_or_default();
        let tags = element(0x1254_C367, &tags);
        let info = element(0x1549_A966, &number(0x002A_D7B1, 1000));
        let tracks = element(0x1654_AE6B, &self.tracks.concat());
        let clusters: Vec<u8> = self.blocks.iter().flat_map(|block| self.cluster(block)).collect();
        let seek = |id: u32, at: u64| element(0x4DBB, &[element(0x53AB, &start(id)), number(0x53AC, at)].concat());
        let seeks = |at: [u64; 2]| element(0x114D_9B74, &[seek(0x1941_A469, at[0]), seek(0x1254_C367, at[1])].concat());
        let segment = match self.head {
            HeadPlace::First => [info, tracks, attachments, tags, clusters].concat(),
            HeadPlace::Last => {
                let before = (seeks([0, 0]).len() + info.len() + tracks.len() + clusters.len()) as u64;
                let list = seeks([before, before + attachments.len() as u64]);
                [list, info, tracks, clusters, attachments, tags].concat()
            }
        };
        let ebml = element(0x1A45_DFA3, &element(0x4282, b"matroska"));
        let segment = if self.is_streamed {
            [unknown_size(0x1853_8067), segment].concat()
        } else {
            element(0x1853_8067, &segment)
        };
        [ebml, segment].concat()
    }

    /// A cluster that begins 100 microseconds after its only block.
    fn cluster(&self, (track, time, data): &Block) -> Vec<u8> {
        let block = [&[0x80 | track][..], &(-100i16).to_be_bytes(), &[self.flags], data].concat();
        let block = if self.is_grouped { element(0xA0, &element(0xA1, &block)) } else { element(0xA3, &block) };
        let parts = [number(0xE7, time + 100), block].concat();
        if self.is_streamed { [unknown_size(0x1F43_B675), parts].concat() } else { element(0x1F43_B675, &parts) }
    }
}

pub fn jpeg((width, height): (u64, u64), value: u8) -> Vec<u8> {
    jpeg_bytes(&Image::filled(width as usize, height as usize, [value; 3]))
}

pub fn depth_bytes(millimetres: impl IntoIterator<Item = u16>) -> Vec<u8> {
    millimetres.into_iter().flat_map(u16::to_be_bytes).collect()
}

/// A recording of some frames: depth has 1000 millimetres and more by 100 for each frame, and comes later by a time.
pub fn small(frames: u64, delay: u64) -> MkvWriter {
    let mut writer = MkvWriter::new(SMALL_COLOR, SMALL_DEPTH);
    let pixels = (SMALL_DEPTH.0 * SMALL_DEPTH.1) as usize;
    for number in 0..frames {
        writer.blocks.push((COLOR, number * PERIOD, jpeg(SMALL_COLOR, 10 * number as u8)));
        let depth = depth_bytes(std::iter::repeat_n(1000 + 100 * number as u16, pixels));
        writer.blocks.push((DEPTH, number * PERIOD + delay, depth));
    }
    writer
}

/// Writes a recording, and returns its folder and path.
pub fn written(bytes: &[u8]) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mkv");
    fs::write(&path, bytes).unwrap();
    (folder, path)
}

/// Returns the damage to a recording of these bytes, and its frames or the error.
pub fn read(bytes: &[u8]) -> (Vec<String>, Result<Vec<CameraFrame<'static>>, String>) {
    let (_folder, path) = written(bytes);
    let without = |text: String| text.replace(&path.display().to_string(), "a.mkv");
    let settings = DatasetSettings::default();
    let (scene, warnings) = with_warnings(|| open_scene(&path, &settings));
    let frames = scene.map_err(|error| without(error.to_string())).map(|scene| {
        let frame = |index| scene.read_recorded(index).map(|read| read.frame).ok();
        (0..scene.frame_count()).filter_map(frame).collect()
    });
    (warnings.into_iter().map(without).collect(), frames)
}
