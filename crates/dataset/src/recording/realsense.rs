//! The dialect of recordings of RealSense's SDK, translated to the messages of ROS's drivers.
//!
//! Topics are named `/device_0/sensor_0/Depth_0/…`. Bags of ROS 1 (SDK up to 2.57) have camera infos without a frame, images
//! whose frame is a number, and extrinsics as `geometry_msgs/Transform` in `…/tf/N`: the transform *from* the reference N to
//! the stream. SQLite (from 2.58) has camera infos and extrinsics as text (`width=48;height=32;fx=40;…`), and from 2.59 also
//! as `CameraInfo` and `/tf_static`. The unit of depth is an option of the sensor in all of them.

use super::container::{Channel, FoundMessage, RecordSink};
use crate::DatasetError;
use crate::ros_topics::sdk_topics::SdkTopic;
use glam::{DMat3, DQuat, DVec3};
use splatseg_ros::{
    CameraInfo, CdrError, Header, Image, Message, Quaternion, TfMessage, Transform, TransformStamped, Vector3,
    from_cdr, to_cdr,
};
use std::collections::BTreeMap;

/// Passes topics and messages on to another receiver, translated.
pub(super) struct Translator<'a> {
    inner: &'a mut dyn RecordSink,
    channels: BTreeMap<u64, Translation>,
}

/// How the messages of a topic are translated.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Translation {
    /// An image gets the name of a frame.
    Image {
        frame: String,
    },
    /// A camera info gets the name of a frame, and a model of ROS.
    Info {
        frame: String,
    },
    InfoText {
        frame: String,
    },
    /// The transform from `reference` to `frame`.
    Extrinsics {
        frame: String,
        reference: String,
    },
    ExtrinsicsText {
        frame: String,
        reference: String,
    },
}

impl<'a> Translator<'a> {
    pub(super) fn new(inner: &'a mut dyn RecordSink) -> Self {
        Self { inner, channels: BTreeMap::new() }
    }
}

impl RecordSink for Translator<'_> {
    fn start_file(&mut self) {
        self.channels.clear();
        self.inner.start_file();
    }

    fn hold(&mut self, bytes: u64) -> Result<(), DatasetError> {
        self.inner.hold(bytes)
    }

    fn needs_images(&self) -> bool {
        self.inner.needs_images()
    }

    fn channel(&mut self, channel: &Channel<'_>) -> Result<(), DatasetError> {
        let translation = Some(channel).filter(|channel| channel.encoding == "cdr").and_then(translation);
        let type_name = translation.as_ref().map_or(channel.type_name, |translation| translation.type_name());
        if let Some(translation) = translation {
            self.channels.entry(channel.id).or_insert(translation);
        }
        self.inner.channel(&Channel { type_name, ..*channel })
    }

    fn message(&mut self, message: &FoundMessage<'_>) -> Result<(), DatasetError> {
        let (Some(translation), Ok(data)) = (self.channels.get(&message.channel), message.data) else {
            return self.inner.message(message);
        };
        let translated = translation.apply(data).map_err(|error| error.to_string());
        let data = translated.as_ref().map(Vec::as_slice).map_err(String::as_str);
        self.inner.message(&FoundMessage { data, ..*message })
    }
}

/// Returns how the messages of a topic are translated; `None` if they are not.
fn translation(channel: &Channel<'_>) -> Option<Translation> {
    let SdkTopic { frame, rest, .. } = SdkTopic::parse(channel.topic)?;
    let reference = || rest.strip_prefix("tf/").map(|number| format!("ref_{}", number.trim_start_matches("ref_")));
    let type_name = channel.type_name.replacen("/msg/", "/", 1);
    match type_name.as_str() {
        "sensor_msgs/Image" => Some(Translation::Image { frame }),
        "sensor_msgs/CameraInfo" => Some(Translation::Info { frame }),
        "geometry_msgs/Transform" => Some(Translation::Extrinsics { reference: reference()?, frame }),
        "std_msgs/String" if rest == "camera_info" => Some(Translation::InfoText { frame }),
        "std_msgs/String" => Some(Translation::ExtrinsicsText { reference: reference()?, frame }),
        _ => None,
    }
}

impl Translation {
    /// Returns the type of the translated messages.
    fn type_name(&self) -> &'static str {
        match self {
            Self::Image { .. } => Image::INTERFACE.name,
            Self::Info { .. } | Self::InfoText { .. } => CameraInfo::INTERFACE.name,
            Self::Extrinsics { .. } | Self::ExtrinsicsText { .. } => TfMessage::INTERFACE.name,
        }
    }

    /// Translates a message.
    fn apply(&self, data: &[u8]) -> Result<Vec<u8>, CdrError> {
        match self {
            Self::Image { frame } => {
                let mut image: Image<'_> = from_cdr(data)?;
                if is_nameless(&image.header) {
                    frame.clone_into(&mut image.header.frame_id);
                }
                to_cdr(&image)
            }
            Self::Info { frame } => {
                let mut info: CameraInfo = from_cdr(data)?;
                if is_nameless(&info.header) {
                    frame.clone_into(&mut info.header.frame_id);
                }
                info.distortion_model = ros_model(&info.distortion_model);
                to_cdr(&info)
            }
            Self::InfoText { frame } => to_cdr(&info_of_text(&from_cdr::<String>(data)?, frame)?),
            Self::Extrinsics { frame, reference } => {
                let transform: Transform = from_cdr(data)?;
                let (shift, turn) = (transform.translation, transform.rotation);
                let turn = DQuat::from_xyzw(turn.x, turn.y, turn.z, turn.w);
                extrinsics(frame, reference, turn, DVec3::new(shift.x, shift.y, shift.z))
            }
            Self::ExtrinsicsText { frame, reference } => {
                let text: String = from_cdr(data)?;
                let rotation: [f64; 9] = numbers(&text, "rotation")?;
                let turn = DQuat::from_mat3(&DMat3::from_cols_array(&rotation));
                extrinsics(frame, reference, turn, DVec3::from_array(numbers(&text, "translation")?))
            }
        }
    }
}

/// Returns true if a header names no frame, or one by a number.
fn is_nameless(header: &Header) -> bool {
    header.frame_id.bytes().all(|byte| byte.is_ascii_digit())
}

/// Returns ROS's name of a model of the lens, as RealSense's driver for ROS gives it.
fn ros_model(model: &str) -> String {
    match model.to_ascii_lowercase().replace('_', " ").as_str() {
        "none" | "brown conrady" | "modified brown conrady" | "inverse brown conrady" => "plumb_bob".to_owned(),
        "kannala brandt4" => "equidistant".to_owned(),
        _ => model.to_owned(),
    }
}

/// Returns the value of a key in `key=value;key=value`.
fn value<'t>(text: &'t str, key: &str) -> Result<&'t str, CdrError> {
    let pairs = text.split(';').filter_map(|pair| pair.split_once('='));
    let found = pairs.into_iter().find(|(name, _)| name.trim() == key).map(|(_, value)| value.trim());
    found.ok_or_else(|| CdrError::Content(format!("found {text:?}, expected a value of {key}")))
}

/// Parses the numbers of a key, separated by commas.
fn list(text: &str, key: &str) -> Result<Vec<f64>, CdrError> {
    let value = value(text, key)?;
    let numbers = value.split(',').map(|number| number.trim().parse::<f64>());
    numbers
        .collect::<Result<_, _>>()
        .map_err(|_| CdrError::Content(format!("{key}: found {value:?}, expected numbers")))
}

fn numbers<const COUNT: usize>(text: &str, key: &str) -> Result<[f64; COUNT], CdrError> {
    let list = list(text, key)?;
    let found = list.len();
    list.try_into().map_err(|_| CdrError::Content(format!("{key}: found {found} numbers, expected {COUNT}")))
}

/// Returns the camera info that a text states.
fn info_of_text(text: &str, frame: &str) -> Result<CameraInfo, CdrError> {
    let number = |key: &str| numbers::<1>(text, key).map(|[number]| number);
    let (fx, fy, cx, cy) = (number("fx")?, number("fy")?, number("ppx")?, number("ppy")?);
    let mut d = list(text, "coeffs")?;
    let distortion_model = ros_model(value(text, "model")?);
    if distortion_model == "equidistant" {
        d.truncate(4);
    }
    Ok(CameraInfo {
        header: Header { frame_id: frame.to_owned(), ..Header::default() },
        // Out of range, they saturate.
        width: number("width")? as u32,
        height: number("height")? as u32,
        distortion_model,
        d,
        k: [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        p: [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
        ..CameraInfo::default()
    })
}

/// Returns the place of `frame` in `reference` as a message of `/tf_static`, given the rotation and shift of points from
/// `reference` to `frame`.
pub(super) fn extrinsics(frame: &str, reference: &str, turn: DQuat, shift: DVec3) -> Result<Vec<u8>, CdrError> {
    let inverse = turn.normalize().conjugate();
    let shift = -(inverse * shift);
    let [x, y, z, w] = inverse.to_array();
    let transform =
        Transform { translation: Vector3 { x: shift.x, y: shift.y, z: shift.z }, rotation: Quaternion { x, y, z, w } };
    let header = Header { frame_id: reference.to_owned(), ..Header::default() };
    let stamped = TransformStamped { header, child_frame_id: frame.to_owned(), transform };
    to_cdr(&TfMessage { transforms: vec![stamped] })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn translated(topic: &str, type_name: &str, data: &[u8]) -> Vec<u8> {
        let channel = Channel { id: 0, topic, type_name, encoding: "cdr" };
        translation(&channel).unwrap().apply(data).unwrap()
    }

    #[test]
    fn texts_are_translated() {
        let text = "width=48;height=32;fx=40;ppx=23.5;fy=41;ppy=15.5;model=Inverse Brown Conrady;coeffs=0,1,2,3,4";
        let topic = "/device_0/sensor_0/Depth_0/camera_info";
        let info: CameraInfo = from_cdr(&translated(topic, "std_msgs/msg/String", &to_cdr(&text).unwrap())).unwrap();
        assert_eq!((info.header.frame_id.as_str(), info.width, info.height), ("Depth", 48, 32));
        assert_eq!((info.k[0], info.k[4], info.k[2], info.k[5]), (40.0, 41.0, 23.5, 15.5));
        assert_eq!((info.distortion_model.as_str(), info.d), ("plumb_bob", vec![0.0, 1.0, 2.0, 3.0, 4.0]));
        let error = info_of_text("width=48;fx=2", "Depth").unwrap_err().to_string();
        assert!(error.ends_with("found \"width=48;fx=2\", expected a value of fy"), "{error}");
        let error = info_of_text("fx=1;fy=2;ppx=3;ppy=a", "Depth").unwrap_err().to_string();
        assert!(error.ends_with("ppy: found \"a\", expected numbers"), "{error}");
    }

    /// The SDK itself writes this transform as text, as a `Transform`, and to `/tf_static`.
    #[test]
    fn extrinsics_are_those_that_the_sdk_writes_to_tf_static() {
        let text = "rotation=0.999800,0.000000,-0.019999,0.000000,1.000000,0.000000,0.019999,0.000000,0.999800;\
                    translation=0.015000,0.002000,-0.001000";
        let topic = "/device_0/sensor_1/Color_0/tf/";
        let of_text = translated(&format!("{topic}ref_1"), "std_msgs/msg/String", &to_cdr(&text.to_owned()).unwrap());
        let stored = Transform {
            translation: Vector3 { x: 0.015, y: 0.002, z: -0.001 },
            rotation: Quaternion { x: 0.0, y: -0.009_999_833, z: 0.0, w: -0.999_95 },
        };
        let of_transform = translated(&format!("{topic}1"), "geometry_msgs/msg/Transform", &to_cdr(&stored).unwrap());
        for cdr in [of_text, of_transform] {
            let message: TfMessage = from_cdr(&cdr).unwrap();
            let one = &message.transforms[0];
            assert_eq!((one.header.frame_id.as_str(), one.child_frame_id.as_str()), ("ref_1", "Color"));
            let (shift, turn) = (&one.transform.translation, &one.transform.rotation);
            let sign = turn.w.signum();
            let found = [shift.x, shift.y, shift.z, sign * turn.x, sign * turn.y, sign * turn.z, sign * turn.w];
            let expected = [-0.015_016_998, -0.002, 0.000_699_820, 0.0, -0.009_999_833, 0.0, 0.999_95];
            for (found, expected) in found.into_iter().zip(expected) {
                assert!((found - expected).abs() < 2e-6, "{found} {expected}");
            }
        }
    }

    #[test]
    fn other_topics_are_left_alone() {
        for (topic, type_name) in [
            ("/camera/color/camera_info", "sensor_msgs/msg/CameraInfo"),
            ("/device_0/sensor_0/Depth_0/info", "std_msgs/msg/String"),
            ("/device_0/sensor_0/Depth_0/image/metadata", "std_msgs/msg/String"),
            ("/tf_static", "tf2_msgs/msg/TFMessage"),
        ] {
            assert_eq!(translation(&Channel { id: 0, topic, type_name, encoding: "cdr" }), None, "{topic}");
        }
    }
}
