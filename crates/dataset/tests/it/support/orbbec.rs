//! Writing of bags as version 2 of Orbbec's SDK does.

use super::bag::{connection, header, message, part, start};
use super::recording::jpeg_bytes;
use splatseg_geometry::Image;

/// Sizes `(width, height)` and focal lengths of the cameras.
const COLOR: (usize, usize) = (48, 36);
const DEPTH: (usize, usize) = (32, 24);
const FOCAL: [f32; 2] = [30.0, 20.0];
const MILLIMETRES: u16 = 2000;

/// How a recording is written.
#[derive(Clone)]
pub struct OrbbecWriter {
    /// True for versions since May 2025.
    pub is_new: bool,
    pub color_encoding: &'static str,
    /// Settings of the camera: number and value.
    pub properties: Vec<(u32, Vec<u8>)>,
    /// Number of depth units per millimetre.
    pub per_millimetre: u16,
    /// Model of the lens of colour (`OBCameraDistortionModel`), and k1.
    pub lens: (u8, f32),
}

impl Default for OrbbecWriter {
    fn default() -> Self {
        let properties = vec![(2, vec![0; 8]), (85, vec![1]), (42, vec![0])];
        Self { is_new: true, color_encoding: "mjpg", properties, per_millimetre: 1, lens: (0, 0.0) }
    }
}

fn floats(numbers: &[f32]) -> Vec<u8> {
    numbers.iter().flat_map(|number| number.to_le_bytes()).collect()
}

impl OrbbecWriter {
    /// Returns the bag: frames 0 to 2.
    pub fn bytes(&self) -> Vec<u8> {
        let mut bytes = start();
        let extra = if self.is_new { "uint8[] metadata\nuint32 metadatasize\n" } else { "uint32 metadatasize\n" };
        let image = format!("Header header\nuint32 height\nuint64 number\n{extra}");
        let topics = [
            ("/cam/property", "custom_msg/OBProperty", "uint8 propertyId\nuint8[] data\n"),
            ("/cam/sensor_2/frameType_2", "sensor_msgs/Image", image.as_str()),
            ("/cam/sensor_3/frameType_3", "sensor_msgs/Image", image.as_str()),
            ("/cam/streamProfileType_2", "custom_msg/OBStreamProfileInfo", "uint8 streamType\n"),
            ("/cam/streamProfileType_3", "custom_msg/OBStreamProfileInfo", "uint8 streamType\n"),
        ];
        for (number, (topic, type_name, definition)) in (0u32..).zip(topics) {
            bytes.extend(connection(number, topic, type_name, definition));
        }
        let mut add = |number: u32, frame: u32, data: &[u8]| bytes.extend(message(number, 33 * frame, data));
        for (number, value) in &self.properties {
            let size = (value.len() as u32).to_le_bytes();
            add(0, 0, &[&header(0, "")[..], &number.to_le_bytes(), &part(value), &size].concat());
        }
        for frame in 0..3 {
            add(1, frame, &self.color(frame));
            add(2, frame, &self.depth(frame));
        }
        add(3, 0, &self.profile(2, COLOR, FOCAL[0]));
        add(4, 0, &self.profile(3, DEPTH, FOCAL[1]));
        bytes
    }

    fn image(&self, frame: u32, (width, height): (usize, usize), encoding: &str, step: u32, data: &[u8]) -> Vec<u8> {
        let numbers = |numbers: &[u64]| numbers.iter().flat_map(|number| number.to_le_bytes()).collect::<Vec<u8>>();
        let (metadata, length) = ([7; 5], 5u32.to_le_bytes());
        let mut bytes = header(33 * frame, "");
        bytes.extend([height as u32, width as u32].map(u32::to_le_bytes).concat());
        bytes.extend([part(encoding.as_bytes()), vec![0], step.to_le_bytes().to_vec()].concat());
        // Microseconds: their upper half would be the length of the metadata if the definition in the bag were right.
        let times = [frame.into(), 1_700_000_000_000_000, 1_700_000_000_000_000, 1_700_000_000_000_000];
        if self.is_new {
            bytes.extend([part(data), 0f32.to_le_bytes().to_vec(), numbers(&times)].concat());
            bytes.extend([part(&metadata), length.to_vec(), vec![8]].concat());
        } else {
            let data = [&metadata, data].concat();
            bytes.extend([length.to_vec(), part(&data), numbers(&times)].concat());
        }
        bytes
    }

    /// Red everywhere, green by frame.
    fn color(&self, frame: u32) -> Vec<u8> {
        let pixel = [200, 40 * frame as u8, 10];
        let pixels = Image::from_fn(COLOR.0, COLOR.1, |_, _| pixel);
        let (step, data) = match self.color_encoding {
            "mjpg" => (0, jpeg_bytes(&pixels)),
            "rgb8" => (3 * COLOR.0 as u32, pixels.pixels().iter().flatten().copied().collect()),
            other => panic!("{other}"),
        };
        self.image(frame, COLOR, self.color_encoding, step, &data)
    }

    fn depth(&self, frame: u32) -> Vec<u8> {
        let unit = (MILLIMETRES + 100 * frame as u16) * self.per_millimetre;
        let data: Vec<u8> = unit.to_le_bytes().repeat(DEPTH.0 * DEPTH.1);
        self.image(frame, DEPTH, "mono16", 2 * DEPTH.0 as u32, &data)
    }

    /// A camera whose depth is 300 mm to the right of colour: points move to the right.
    fn profile(&self, sensor: u8, (width, height): (usize, usize), focal: f32) -> Vec<u8> {
        let place = if sensor == 3 { [300.0, 0.0, 0.0] } else { [0.0; 3] };
        let turn = if sensor == 3 { [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0] } else { [0.0; 9] };
        let center = [(width as f32 - 1.0) / 2.0, (height as f32 - 1.0) / 2.0];
        let (model, k1) = if sensor == 2 { self.lens } else { (0, 0.0) };
        let sizes = [width as u16, height as u16, 30].map(u16::to_le_bytes).concat();
        let camera = [focal, focal, center[0], center[1]];
        let lens = [k1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let parts =
            [vec![sensor, 28], floats(&turn), floats(&place), sizes, floats(&camera), floats(&lens), vec![model]];
        [header(0, ""), parts.concat()].concat()
    }
}
