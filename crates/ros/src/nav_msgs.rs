//! `nav_msgs`: maps. Paths and odometry are in `geometry_msgs.rs`, with the poses that they are made of.

use crate::{Header, Interface, Message, PoseMessage, Time};
use serde::{Deserialize, Serialize};

/// Place and size of a grid (`nav_msgs/msg/MapMetaData`).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MapMetaData {
    /// When the map was made.
    pub map_load_time: Time,
    /// Side of a cell, metres.
    pub resolution: f32,
    /// Number of cells along x.
    pub width: u32,
    /// Number of cells along y.
    pub height: u32,
    /// The corner of cell (0, 0) with the lowest x and y, in the frame of the message.
    pub origin: PoseMessage,
}

impl Message for MapMetaData {
    const INTERFACE: Interface = Interface {
        name: "nav_msgs/msg/MapMetaData",
        fields: "builtin_interfaces/Time map_load_time\nfloat32 resolution\nuint32 width\nuint32 height\n\
                 geometry_msgs/Pose origin\n",
        uses: &[&Time::INTERFACE, &PoseMessage::INTERFACE],
    };
}

/// Free, occupied and unknown cells (`nav_msgs/msg/OccupancyGrid`).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct OccupancyGrid {
    /// Time of the map, and its frame, with z up.
    pub header: Header,
    /// Place and size.
    pub info: MapMetaData,
    /// Row by row from the lowest y, each from the lowest x: 0 free to 100 occupied, -1 unknown.
    pub data: Vec<i8>,
}

impl Message for OccupancyGrid {
    const INTERFACE: Interface = Interface {
        name: "nav_msgs/msg/OccupancyGrid",
        fields: "std_msgs/Header header\nnav_msgs/MapMetaData info\nint8[] data\n",
        uses: &[&Header::INTERFACE, &MapMetaData::INTERFACE],
    };
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Point, Quaternion, from_cdr, to_cdr};

    #[test]
    fn the_layout_is_that_of_cdr() {
        let orientation = Quaternion { w: 1.0, ..Quaternion::default() };
        let origin = PoseMessage { position: Point { x: -1.5, y: 2.0, z: 0.0 }, orientation };
        let map_load_time = Time { sec: 5, nanosec: 6 };
        let info = MapMetaData { map_load_time, resolution: 0.05, width: 3, height: 1, origin };
        let header = Header { stamp: Time { sec: 7, nanosec: 8 }, frame_id: "map".to_owned() };
        let grid = OccupancyGrid { header, info, data: vec![-1, 0, 100] };
        let mut expected = vec![0, 1, 0, 0, 7, 0, 0, 0, 8, 0, 0, 0, 4, 0, 0, 0];
        expected.extend(b"map\0");
        expected.extend([5, 0, 0, 0, 6, 0, 0, 0]);
        expected.extend(0.05f32.to_le_bytes());
        expected.extend([3, 0, 0, 0, 1, 0, 0, 0]);
        // 36 bytes so far: numbers of eight bytes begin at a multiple of eight.
        expected.extend([0; 4]);
        [-1.5, 2.0, 0.0, 0.0, 0.0, 0.0, 1.0f64].iter().for_each(|number| expected.extend(number.to_le_bytes()));
        expected.extend([3, 0, 0, 0, 255, 0, 100]);
        assert_eq!(to_cdr(&grid).unwrap(), expected);
        assert_eq!(from_cdr::<OccupancyGrid>(&expected).unwrap(), grid);
        assert!(from_cdr::<OccupancyGrid>(&expected[..expected.len() - 1]).is_err());
    }
}
