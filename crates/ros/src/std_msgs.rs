//! `builtin_interfaces` and `std_msgs`.

use crate::{Interface, Message};
use serde::{Deserialize, Serialize};

/// A time (`builtin_interfaces/msg/Time`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Time {
    /// Seconds, usually since the Unix epoch.
    pub sec: i32,
    /// Nanoseconds, added to the seconds.
    pub nanosec: u32,
}

impl Time {
    /// The time in nanoseconds.
    pub fn nanoseconds(self) -> i64 {
        i64::from(self.sec) * 1_000_000_000 + i64::from(self.nanosec)
    }

    /// Converts from nanoseconds. Clamps the seconds to ±`i32::MAX`.
    pub fn from_nanoseconds(nanoseconds: i64) -> Self {
        let limit = i64::from(i32::MAX);
        let sec = nanoseconds.div_euclid(1_000_000_000).clamp(-limit, limit);
        Self { sec: sec as i32, nanosec: nanoseconds.rem_euclid(1_000_000_000) as u32 }
    }
}

impl Message for Time {
    const INTERFACE: Interface =
        Interface { name: "builtin_interfaces/msg/Time", fields: "int32 sec\nuint32 nanosec\n", uses: &[] };
}

/// A duration (`builtin_interfaces/msg/Duration`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Duration {
    /// Seconds.
    pub sec: i32,
    /// Nanoseconds, added to the seconds.
    pub nanosec: u32,
}

impl Message for Duration {
    const INTERFACE: Interface =
        Interface { name: "builtin_interfaces/msg/Duration", fields: "int32 sec\nuint32 nanosec\n", uses: &[] };
}

/// Time and coordinate frame of a message (`std_msgs/msg/Header`).
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Header {
    /// Time of the data.
    pub stamp: Time,
    /// The coordinate frame, e.g. `camera_color_optical_frame`.
    pub frame_id: String,
}

impl Message for Header {
    const INTERFACE: Interface = Interface {
        name: "std_msgs/msg/Header",
        fields: "builtin_interfaces/Time stamp\nstring frame_id\n",
        uses: &[&Time::INTERFACE],
    };
}

message! {
    /// A text (`std_msgs/msg/String`).
    TextMessage: Default, "std_msgs/msg/String", "string data\n", [] {
        /// The text.
        data: String,
    }
}

message! {
    /// A number (`std_msgs/msg/Float32`).
    Float32Message: Default, "std_msgs/msg/Float32", "float32 data\n", [] {
        /// The number.
        data: f32,
    }
}

/// A colour with components in [0, 1] (`std_msgs/msg/ColorRGBA`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ColorRgba {
    /// Red.
    pub r: f32,
    /// Green.
    pub g: f32,
    /// Blue.
    pub b: f32,
    /// Alpha; 1 is opaque.
    pub a: f32,
}

impl Message for ColorRgba {
    const INTERFACE: Interface =
        Interface { name: "std_msgs/msg/ColorRGBA", fields: "float32 r\nfloat32 g\nfloat32 b\nfloat32 a\n", uses: &[] };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_the_same_in_nanoseconds() {
        for time in [Time { sec: 1_700_000_000, nanosec: 999_999_999 }, Time { sec: -1, nanosec: 5 }, Time::default()] {
            assert_eq!(Time::from_nanoseconds(time.nanoseconds()), time);
        }
        assert_eq!(Time::from_nanoseconds(i64::MAX).sec, i32::MAX);
    }
}
