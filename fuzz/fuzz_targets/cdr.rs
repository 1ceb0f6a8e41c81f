//! ROS 2 messages in CDR.
#![no_main]

use libfuzzer_sys::fuzz_target;
use splatseg_fuzz as _; // its limit on memory
use splatseg_ros::{
    CameraInfo, CompressedImage, Image, MarkerArray, Odometry, PointCloud2, PoseStamped, TfMessage, from_cdr, to_cdr,
};

fuzz_target!(|bytes: &[u8]| {
    let _ = from_cdr::<Image<'_>>(bytes);
    let _ = from_cdr::<CompressedImage<'_>>(bytes);
    let _ = from_cdr::<PointCloud2<'_>>(bytes);
    let _ = from_cdr::<MarkerArray<'_>>(bytes);
    let _ = from_cdr::<CameraInfo>(bytes);
    let _ = from_cdr::<Odometry>(bytes);
    let _ = from_cdr::<PoseStamped>(bytes);
    if let Ok(message) = from_cdr::<TfMessage>(bytes) {
        assert_eq!(
            from_cdr::<TfMessage>(&to_cdr(&message).expect("CDR")).map(|read| read.transforms.len()),
            Ok(message.transforms.len())
        );
    }
});
