//! Definitions of message types, for the schemas in recordings.

use crate::{
    CameraInfo, CompressedImage, Float32Message, Image, Odometry, PoseStamped, PoseWithCovarianceStamped, TextMessage,
    TfMessage, TransformStamped,
};

/// The definition of a message type.
#[derive(Clone, Copy, Debug)]
pub struct Interface {
    /// Name, e.g. `sensor_msgs/msg/Image`.
    pub name: &'static str,
    /// Constants and fields, one per line.
    pub fields: &'static str,
    /// Types of the fields, except built-in types.
    pub uses: &'static [&'static Interface],
}

/// A message.
pub trait Message {
    /// The definition of its type.
    const INTERFACE: Interface;
}

impl Interface {
    /// Returns the definition of a type that a camera, its poses, its calibration or its options may have, e.g.
    /// `sensor_msgs/msg/Image`.
    pub fn of_camera(name: &str) -> Option<Self> {
        let all = [
            Image::INTERFACE,
            CompressedImage::INTERFACE,
            CameraInfo::INTERFACE,
            TfMessage::INTERFACE,
            Odometry::INTERFACE,
            PoseStamped::INTERFACE,
            PoseWithCovarianceStamped::INTERFACE,
            TransformStamped::INTERFACE,
            TextMessage::INTERFACE,
            Float32Message::INTERFACE,
        ];
        all.into_iter().find(|interface| interface.name == name)
    }

    /// Returns the definition followed by the definitions of all types used in it, as in recordings (`ros2msg`).
    pub fn schema(&self) -> String {
        let mut schema = self.fields.to_owned();
        let mut listed: Vec<&Interface> = self.uses.to_vec();
        let mut next = 0;
        while let Some(interface) = listed.get(next).copied() {
            next += 1;
            schema += &format!("{}\nMSG: {}\n{}", "=".repeat(80), interface.short_name(), interface.fields);
            for inner in interface.uses {
                if listed.iter().all(|known| known.name != inner.name) {
                    listed.push(inner);
                }
            }
        }
        schema
    }

    /// The name as used in fields, e.g. `sensor_msgs/Image`.
    fn short_name(&self) -> String {
        self.name.replace("/msg/", "/")
    }
}

/// Declares a message whose fields are messages, strings or numbers.
macro_rules! message {
    (
        $(#[doc = $doc:literal])+
        $name:ident $(: $extra:ident)?, $interface:literal, $fields:literal, [$($uses:ident),*] {
            $($(#[doc = $field_doc:literal])+ $field:ident: $type:ty,)+
        }
    ) => {
        $(#[doc = $doc])+
        #[derive(Clone, Debug, $($extra,)? PartialEq, Serialize, Deserialize)]
        pub struct $name {
            $($(#[doc = $field_doc])+ pub $field: $type,)+
        }

        impl Message for $name {
            const INTERFACE: Interface =
                Interface { name: $interface, fields: $fields, uses: &[$(&$uses::INTERFACE),*] };
        }
    };
}

#[cfg(test)]
mod tests {
    use crate::{Detection3dArray, DiagnosticArray, MarkerArray, Message, OccupancyGrid, Odometry};

    #[test]
    fn a_schema_defines_every_type_once() {
        let interfaces = [
            Odometry::INTERFACE,
            MarkerArray::INTERFACE,
            Detection3dArray::INTERFACE,
            DiagnosticArray::INTERFACE,
            OccupancyGrid::INTERFACE,
        ];
        for schema in interfaces.map(|interface| interface.schema()) {
            let defined: Vec<&str> = schema.lines().filter_map(|line| line.strip_prefix("MSG: ")).collect();
            for line in schema.lines().filter(|line| line.contains('/') && !line.starts_with("MSG: ")) {
                let used = line.split([' ', '[']).next().unwrap();
                assert_eq!(defined.iter().filter(|name| **name == used).count(), 1, "{used} in\n{schema}");
            }
        }
    }
}
