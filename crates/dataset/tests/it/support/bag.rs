//! Writing of bags of ROS 1, version 2.0.

use bzip2::write::BzEncoder;
use std::io::Write;

/// Compression of chunks.
#[derive(Clone, Copy, Debug)]
pub enum Chunks {
    /// Records outside chunks.
    Without,
    Plain,
    Lz4,
    Bz2,
}

const HEADER: &str = "MSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n";
const IMAGE: &str =
    "Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\nuint8[] data\n";
const INFO: &str = "Header header\nuint32 height\nuint32 width\nstring distortion_model\nfloat64[] D\nfloat64[9] K\n\
                    float64[9] R\nfloat64[12] P\n";
const TF: &str = "geometry_msgs/TransformStamped[] transforms\n====\nMSG: geometry_msgs/TransformStamped\nHeader header\n\
                  string child_frame_id\nTransform transform\n====\nMSG: geometry_msgs/Transform\nVector3 translation\n\
                  Quaternion rotation\n====\nMSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n====\n\
                  MSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n";

/// Returns bytes after their length.
pub fn part(bytes: &[u8]) -> Vec<u8> {
    [&(bytes.len() as u32).to_le_bytes(), bytes].concat()
}

fn fields(list: &[(&str, &[u8])]) -> Vec<u8> {
    list.iter().flat_map(|(name, value)| part(&[name.as_bytes(), b"=", value].concat())).collect()
}

fn record(header: &[(&str, &[u8])], data: &[u8]) -> Vec<u8> {
    [part(&fields(header)), part(data)].concat()
}

/// Returns a header with a frame; `time` in milliseconds after 100 s.
pub fn header(time: u32, frame: &str) -> Vec<u8> {
    [[time, 100, 1_000_000 * time].map(u32::to_le_bytes).concat(), part(frame.as_bytes())].concat()
}

/// Returns the start of a bag.
pub fn start() -> Vec<u8> {
    let numbers = [("op", &[3][..]), ("index_pos", &[0; 8]), ("conn_count", &[0; 4]), ("chunk_count", &[0; 4])];
    [b"#ROSBAG V2.0\n".to_vec(), record(&numbers, &[b' '; 8])].concat()
}

/// Returns the record of a connection.
pub fn connection(number: u32, topic: &str, type_name: &str, definition: &str) -> Vec<u8> {
    let content =
        [("topic", topic.as_bytes()), ("type", type_name.as_bytes()), ("message_definition", definition.as_bytes())];
    record(&[("op", &[7]), ("conn", &number.to_le_bytes()), ("topic", topic.as_bytes())], &fields(&content))
}

/// Returns the record of a message, recorded at `time` as in [`header`].
pub fn message(number: u32, time: u32, data: &[u8]) -> Vec<u8> {
    let recorded = [100u32, 1_000_000 * time].map(u32::to_le_bytes).concat();
    record(&[("op", &[2]), ("conn", &number.to_le_bytes()), ("time", &recorded)], data)
}

/// Returns a chunk of records.
fn chunk(records: &[u8], chunks: Chunks) -> Vec<u8> {
    let (name, packed) = match chunks {
        Chunks::Without => return records.to_vec(),
        Chunks::Plain => ("none", records.to_vec()),
        Chunks::Lz4 => ("lz4", {
            let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
            encoder.write_all(records).expect("bytes in memory");
            encoder.finish().expect("bytes in memory")
        }),
        Chunks::Bz2 => ("bz2", {
            let mut encoder = BzEncoder::new(Vec::new(), bzip2::Compression::fast());
            encoder.write_all(records).expect("bytes in memory");
            encoder.finish().expect("bytes in memory")
        }),
    };
    let size = (records.len() as u32).to_le_bytes();
    record(&[("op", &[5]), ("compression", name.as_bytes()), ("size", &size)], &packed)
}

/// Returns a bag of two frames of 8x6 pixels with a pose each.
pub fn small(chunks: Chunks) -> Vec<u8> {
    let with_header = |definition: &str| format!("{definition}====\n{HEADER}");
    let topics = [
        ("/color/image_raw", "sensor_msgs/Image", IMAGE),
        ("/color/camera_info", "sensor_msgs/CameraInfo", INFO),
        ("/depth/image_raw", "sensor_msgs/Image", IMAGE),
        ("/tf", "tf2_msgs/TFMessage", TF),
    ];
    let connections = (0..)
        .zip(topics)
        .map(|(number, (topic, type_name, definition))| connection(number, topic, type_name, &with_header(definition)));
    let mut records: Vec<u8> = connections.flatten().collect();
    let numbers = |numbers: &[f64]| numbers.iter().flat_map(|number| number.to_le_bytes()).collect::<Vec<u8>>();
    let size = [6u32, 8].map(u32::to_le_bytes).concat();
    let image = |time: u32, encoding: &str, pixel: &[u8]| {
        let step = (8 * pixel.len() as u32).to_le_bytes();
        let data = part(&pixel.repeat(48));
        [&header(time, "camera")[..], &size, &part(encoding.as_bytes()), &[0], &step, &data].concat()
    };
    let k = [8.0, 0.0, 3.5, 0.0, 8.0, 2.5, 0.0, 0.0, 1.0];
    let info = [&header(0, "camera")[..], &size, &part(b"plumb_bob"), &[0; 4], &numbers(&k), &[0; 8 * 21]].concat();
    records.extend(message(1, 0, &info));
    for frame in 0..2 {
        let time = 33 * frame;
        let pose = [1.0 + 0.1 * f64::from(frame), 2.0, 3.0, 0.0, 0.0, 0.0, 1.0];
        let tf = [&1u32.to_le_bytes()[..], &header(time, "map"), &part(b"camera"), &numbers(&pose)].concat();
        records.extend(message(3, time, &tf));
        records.extend(message(0, time, &image(time, "rgb8", &[200, 100, 10 * frame as u8])));
        records.extend(message(2, time, &image(time, "16UC1", &(1000 + 100 * frame as u16).to_le_bytes())));
    }
    [start(), chunk(&records, chunks)].concat()
}
