//! Topics that RealSense's SDK and Viewer name: `/device_0/sensor_0/Depth_0/image/data`.

use super::contents::{Content, Contents};

/// The parts of a topic's name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct SdkTopic<'a> {
    /// The sensor, e.g. `/device_0/sensor_0`.
    pub(crate) sensor: &'a str,
    /// The coordinate frame of the stream, as the SDK names it in `/tf_static`: `Depth`, `Color`, `Infrared_1`.
    pub(crate) frame: String,
    /// The part of the topic after the stream, e.g. `image/data`.
    pub(crate) rest: &'a str,
}

impl<'a> SdkTopic<'a> {
    /// Parses the name of a topic; `None` for those of others.
    pub(crate) fn parse(topic: &'a str) -> Option<Self> {
        let (sensor, device, rest) = sensor_of(topic)?;
        let (stream, rest) = rest.split_once('/')?;
        let name = stream.strip_suffix("_0").unwrap_or(stream);
        let frame = if device == "0" { name.to_owned() } else { format!("device_{device}/{name}") };
        Some(Self { sensor, frame, rest })
    }
}

/// Splits a topic's name into its sensor, the number of its device, and the rest. Orbbec's SDK has one device, `/cam`.
fn sensor_of(topic: &str) -> Option<(&str, &str, &str)> {
    let (device, rest) = match topic.strip_prefix("/cam/") {
        Some(rest) => ("0", rest),
        None => topic.strip_prefix("/device_")?.split_once('/')?,
    };
    let (sensor, rest) = rest.strip_prefix("sensor_")?.split_once('/')?;
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    if !is_number(device) || !is_number(sensor) {
        return None;
    }
    let end = topic.len() - rest.len() - 1;
    Some((topic.get(..end)?, device, rest))
}

/// Returns true if a topic has the unit of a sensor's depth.
pub(crate) fn is_depth_unit(topic: &str) -> bool {
    let names = ["option/Depth_Units/value", "option/Depth Units/value", "depth_unit"];
    sensor_of(topic).is_some_and(|(_, _, rest)| names.contains(&rest))
}

/// Returns true if a topic has the place of a stream on its camera.
pub(crate) fn is_extrinsics(topic: &str) -> bool {
    SdkTopic::parse(topic).is_some_and(|topic| topic.rest.starts_with("tf/"))
}

impl Contents {
    /// Returns the topic and the unit of the depth of another topic, metres, if its camera states it.
    pub(crate) fn depth_unit_of(&self, depth: &str) -> Option<(&str, f64)> {
        let (sensor, ..) = sensor_of(depth)?;
        let of_sensor = |name: &str| sensor_of(name).is_some_and(|(other, ..)| other == sensor);
        self.topics.iter().find_map(|topic| match topic.content {
            Content::DepthUnit { metres: Some(metres) } if of_sensor(&topic.name) => {
                Some((topic.name.as_str(), metres))
            }
            _ => None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_parsed() {
        let parts = |topic| {
            let SdkTopic { sensor, frame, rest } = SdkTopic::parse(topic)?;
            Some((sensor, frame, rest))
        };
        let depth = "/device_0/sensor_0/Depth_0/image/data";
        assert_eq!(parts(depth), Some(("/device_0/sensor_0", "Depth".to_owned(), "image/data")));
        let infrared = "/device_2/sensor_11/Infrared_1/info/camera_info";
        let expected = ("/device_2/sensor_11", "device_2/Infrared_1".to_owned(), "info/camera_info");
        assert_eq!(parts(infrared), Some(expected));
        for other in ["/device_0/info", "/device_x/sensor_0/a/b", "/camera/color", "/device_0/sensor_/a/b", ""] {
            assert_eq!(parts(other), None, "{other}");
        }
        assert!(is_depth_unit("/device_0/sensor_0/option/Depth_Units/value") && !is_depth_unit(depth));
        assert!(is_depth_unit("/device_0/sensor_0/option/Depth Units/value"));
        assert!(!is_depth_unit("/option/Depth_Units/value"));
        assert!(is_extrinsics("/device_0/sensor_1/Color_0/tf/ref_1") && !is_extrinsics("/tf_static"));
    }
}
