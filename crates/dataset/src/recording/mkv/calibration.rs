//! The calibration of an Azure Kinect, `calibration.json`, as ROS's camera infos and the transform between the cameras.
//!
//! It describes the whole sensors, each camera with 14 parameters: cx, cy, fx, fy in widths and heights of the sensor's image,
//! with the corner of the first pixel at 0; k1 to k6; the centre of distortion, which is not used; p2, p1.
//! `Rt` transforms points to the camera, metres. The modes crop the sensor's image and reduce it:
//!
//! - Depth has 1024x1024 pixels. WFOV is all of it; NFOV are 640x576 from column 192 and row 180. "2x2 binned" has half the
//!   size.
//! - Colour is 4:3. Images of 16:9 lack as many rows at the top as at the bottom.

use glam::{DMat3, DQuat, DVec3};
use serde::Deserialize;
use splatseg_ros::{CameraInfo, Header, Quaternion, TfMessage, Transform, TransformStamped, Vector3};

/// Models of the lens: that of all devices that were sold, and that of early ones. The latter halves two of the four terms with
/// p1 and p2, which is less than a quarter of a pixel, and may have a centre of distortion.
const MODEL: &str = "CALIBRATION_LensDistortionModelBrownConrady";
const EARLY_MODEL: &str = "CALIBRATION_LensDistortionModelRational6KT";
const DEPTH_LOCATION: &str = "CALIBRATION_CameraLocationD0";
const COLOR_LOCATION: &str = "CALIBRATION_CameraLocationPV0";
/// Side of the depth camera's sensor, pixels.
const DEPTH_SENSOR: u64 = 1024;
/// NFOV: the size of the part of the sensor, `(width, height)`, and where it begins, `(column, row)`.
const NARROW: (u64, u64) = (640, 576);
const NARROW_START: (f64, f64) = (192.0, 180.0);
/// Colour was calibrated in 16:9 first: that image lacks these parts of the height of the 4:3 image.
const LEGACY_CROP: f64 = 384.0 / 3072.0;
/// A rotation differs from an orthonormal matrix by at most this.
const ROTATION_TOLERANCE: f64 = 1e-2;

#[derive(Debug, Deserialize)]
struct File {
    #[serde(rename = "CalibrationInformation")]
    information: Information,
}

#[derive(Debug, Deserialize)]
struct Information {
    #[serde(rename = "Cameras")]
    cameras: Vec<Camera>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "PascalCase")]
struct Camera {
    intrinsics: Lens,
    location: String,
    rt: Extrinsics,
    sensor_width: u64,
    sensor_height: u64,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "PascalCase")]
struct Lens {
    model_parameters: Vec<f64>,
    model_type: String,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "PascalCase")]
struct Extrinsics {
    /// Row by row.
    rotation: [f64; 9],
    translation: [f64; 3],
}

/// The calibration of a device.
#[derive(Clone, Debug)]
pub(super) struct Calibration {
    depth: Camera,
    color: Camera,
}

/// A mode: the size of the sensor's image at the resolution of the mode, and where the mode's image begins in it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Crop {
    sensor: (f64, f64),
    start: (f64, f64),
}

impl Calibration {
    /// Parses `calibration.json`.
    ///
    /// # Errors
    /// Description of what is wrong.
    pub(super) fn parse(bytes: &[u8]) -> Result<Self, String> {
        // Some versions kept the end of the string in C.
        let end = bytes.iter().rposition(|byte| *byte != 0).map_or(0, |last| last + 1);
        let file: File =
            serde_json::from_slice(bytes.get(..end).unwrap_or_default()).map_err(|error| error.to_string())?;
        let camera = |location: &str| {
            let found = file.information.cameras.iter().find(|camera| camera.location == location);
            found.cloned().ok_or_else(|| format!("no camera at {location}"))
        };
        Ok(Self { depth: camera(DEPTH_LOCATION)?, color: camera(COLOR_LOCATION)? })
    }

    /// Returns the camera info of depth images of a size, `(width, height)`.
    ///
    /// # Errors
    /// Description of what is wrong.
    pub(super) fn depth_info(&self, size: (u64, u64), frame: &str) -> Result<CameraInfo, String> {
        if (self.depth.sensor_width, self.depth.sensor_height) != (DEPTH_SENSOR, DEPTH_SENSOR) {
            let (width, height) = (self.depth.sensor_width, self.depth.sensor_height);
            return Err(format!(
                "found a depth camera of {width}x{height} pixels, expected {DEPTH_SENSOR}x{DEPTH_SENSOR}"
            ));
        }
        let crop = depth_crop(size)
            .ok_or_else(|| format!("depth images of {}x{} pixels are of no mode of the camera", size.0, size.1))?;
        self.depth.info(crop, size, frame)
    }

    /// Returns the camera info of colour images of a size, `(width, height)`.
    ///
    /// # Errors
    /// Description of what is wrong.
    pub(super) fn color_info(&self, size: (u64, u64), frame: &str) -> Result<CameraInfo, String> {
        let (width, height) = (self.color.sensor_width, self.color.sensor_height);
        let is = |across, down| has_ratio((width, height), (across, down));
        let mut camera = self.color.clone();
        match camera.intrinsics.model_parameters.as_mut_slice() {
            [_, cy, _, fy, ..] if is(16, 9) => {
                let share = 1.0 - 2.0 * LEGACY_CROP;
                (*cy, *fy) = (*cy * share + LEGACY_CROP, *fy * share);
            }
            _ if is(4, 3) => {}
            _ => return Err(format!("found a colour camera of {width}x{height} pixels, expected 4:3 or 16:9")),
        }
        let crop = color_crop(size)
            .ok_or_else(|| format!("colour images of {}x{} pixels are of no mode of the camera", size.0, size.1))?;
        camera.info(crop, size, frame)
    }

    /// Returns the pose of the depth camera in the frame of the colour camera.
    ///
    /// # Errors
    /// Description of what is wrong.
    pub(super) fn color_from_depth(&self, color_frame: &str, depth_frame: &str) -> Result<TfMessage, String> {
        let (depth, color) = (self.depth.rt.parts()?, self.color.rt.parts()?);
        // x_camera = R x + t for both cameras.
        let turn = (color.0 * depth.0.conjugate()).normalize();
        let shift = color.1 - turn * depth.1;
        let [x, y, z, w] = turn.to_array();
        let transform = Transform {
            translation: Vector3 { x: shift.x, y: shift.y, z: shift.z },
            rotation: Quaternion { x, y, z, w },
        };
        let header = Header { frame_id: color_frame.to_owned(), ..Header::default() };
        let stamped = TransformStamped { header, child_frame_id: depth_frame.to_owned(), transform };
        Ok(TfMessage { transforms: vec![stamped] })
    }
}

impl Extrinsics {
    /// Returns rotation and translation of points to the camera.
    fn parts(&self) -> Result<(DQuat, DVec3), String> {
        let rotation = DMat3::from_cols_array(&self.rotation).transpose();
        let translation = DVec3::from_array(self.translation);
        let is_rotation = (rotation.transpose() * rotation).abs_diff_eq(DMat3::IDENTITY, ROTATION_TOLERANCE)
            && rotation.determinant() > 0.0;
        if !is_rotation || !translation.is_finite() {
            return Err(format!("found {self:?}, expected a rotation and a translation"));
        }
        Ok((DQuat::from_mat3(&rotation).normalize(), translation))
    }
}

impl Camera {
    /// Returns the camera info of images of a size, `(width, height)`, that are a part of the sensor's image.
    fn info(&self, crop: Crop, size: (u64, u64), frame: &str) -> Result<CameraInfo, String> {
        if ![MODEL, EARLY_MODEL].contains(&self.intrinsics.model_type.as_str()) {
            let found: String = self.intrinsics.model_type.chars().take(80).collect();
            return Err(format!("ModelType: found {found:?}, expected {MODEL:?}"));
        }
        let &[cx, cy, fx, fy, k1, k2, k3, k4, k5, k6, x, y, p2, p1, ..] = self.intrinsics.model_parameters.as_slice()
        else {
            let found = self.intrinsics.model_parameters.len();
            return Err(format!("ModelParameters: found {found} numbers, expected 14"));
        };
        if self.intrinsics.model_type == EARLY_MODEL && (x, y) != (0.0, 0.0) {
            return Err(format!("ModelParameters: found the centre of distortion ({x}, {y}), expected (0, 0)"));
        }
        let (fx, fy) = (fx * crop.sensor.0, fy * crop.sensor.1);
        let (cx, cy) = (cx * crop.sensor.0 - crop.start.0 - 0.5, cy * crop.sensor.1 - crop.start.1 - 0.5);
        let side = |side: u64| u32::try_from(side).map_err(|_| format!("images are {side} pixels wide or high"));
        Ok(CameraInfo {
            header: Header { frame_id: frame.to_owned(), ..Header::default() },
            width: side(size.0)?,
            height: side(size.1)?,
            distortion_model: "rational_polynomial".to_owned(),
            d: vec![k1, k2, p1, p2, k3, k4, k5, k6],
            k: [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
            p: [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
            ..CameraInfo::default()
        })
    }
}

/// Returns the mode of depth images of a size, `(width, height)`, also of ones that were made smaller afterwards.
fn depth_crop(size: (u64, u64)) -> Option<Crop> {
    let width = size.0 as f64;
    let (share, start) = if has_ratio(size, NARROW) {
        (width / NARROW.0 as f64, NARROW_START)
    } else if has_ratio(size, (1, 1)) {
        (width / DEPTH_SENSOR as f64, (0.0, 0.0))
    } else {
        return None;
    };
    let side = DEPTH_SENSOR as f64 * share;
    Some(Crop { sensor: (side, side), start: (start.0 * share, start.1 * share) })
}

/// Returns the mode of colour images of a size, `(width, height)`, also of ones that were made smaller afterwards.
fn color_crop(size: (u64, u64)) -> Option<Crop> {
    let (width, height) = (size.0 as f64, size.1 as f64);
    let is_known = has_ratio(size, (4, 3)) || has_ratio(size, (16, 9));
    let sensor = (width, width * 0.75);
    is_known.then_some(Crop { sensor, start: (0.0, (sensor.1 - height) / 2.0) })
}

/// Returns true if a size, `(width, height)`, has a ratio.
fn has_ratio((width, height): (u64, u64), (across, down): (u64, u64)) -> bool {
    width > 0 && u128::from(width) * u128::from(down) == u128::from(height) * u128::from(across)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modes_are_those_of_the_sdk() {
        let crop = |side: f64, start| Some(Crop { sensor: (side, side), start });
        assert_eq!(depth_crop((320, 288)), crop(512.0, (96.0, 90.0)), "NFOV 2x2 binned");
        assert_eq!(depth_crop((640, 576)), crop(1024.0, (192.0, 180.0)), "NFOV unbinned");
        assert_eq!(depth_crop((512, 512)), crop(512.0, (0.0, 0.0)), "WFOV 2x2 binned");
        assert_eq!(depth_crop((1024, 1024)), crop(1024.0, (0.0, 0.0)), "WFOV unbinned");
        assert!(
            [(640, 480), (0, 0), (576, 640), (u64::MAX, u64::MAX - 1)]
                .into_iter()
                .all(|size| depth_crop(size).is_none())
        );
        for (size, sensor_height, row) in [
            ((1280, 720), 960.0, 120.0),
            ((1920, 1080), 1440.0, 180.0),
            ((2560, 1440), 1920.0, 240.0),
            ((2048, 1536), 1536.0, 0.0),
            ((3840, 2160), 2880.0, 360.0),
            ((4096, 3072), 3072.0, 0.0),
        ] {
            let expected = Crop { sensor: (size.0 as f64, sensor_height), start: (0.0, row) };
            assert_eq!(color_crop(size), Some(expected), "{size:?}");
        }
        assert!([(1280, 1024), (0, 0), (u64::MAX, 3)].into_iter().all(|size| color_crop(size).is_none()));
    }

    fn camera(location: &str, (width, height): (u64, u64), parameters: &[f64]) -> serde_json::Value {
        serde_json::json!({
            "Intrinsics": {"ModelParameterCount": 14, "ModelParameters": parameters, "ModelType": MODEL},
            "Location": location,
            "Rt": {"Rotation": [1, 0, 0, 0, 1, 0, 0, 0, 1], "Translation": [0, 0, 0]},
            "SensorWidth": width, "SensorHeight": height,
        })
    }

    fn file(color_size: (u64, u64), color: &[f64]) -> Vec<u8> {
        let depth = camera(DEPTH_LOCATION, (1024, 1024), &[0.5; 14]);
        let color = camera(COLOR_LOCATION, color_size, color);
        serde_json::json!({"CalibrationInformation": {"Cameras": [depth, color]}}).to_string().into_bytes()
    }

    #[test]
    fn parameters_are_in_the_order_of_the_sdk() {
        let numbers = [0.5, 0.51, 0.48, 0.64, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 9.0, 9.0, 0.02, 0.01];
        let mut bytes = file((4096, 3072), &numbers);
        bytes.push(0);
        let info = Calibration::parse(&bytes).unwrap().color_info((1280, 720), "COLOR").unwrap();
        let [fx, _, cx, _, fy, cy, ..] = info.k;
        assert_eq!((fx, fy), (0.48 * 1280.0, 0.64 * 960.0));
        assert_eq!((cx, cy), (0.5 * 1280.0 - 0.5, 0.51 * 960.0 - 120.0 - 0.5));
        assert_eq!(info.d, [0.1, 0.2, 0.01, 0.02, 0.3, 0.4, 0.5, 0.6]);
    }

    #[test]
    fn a_calibration_in_16_9_is_that_of_the_same_camera() {
        let info = |bytes: Vec<u8>| Calibration::parse(&bytes).unwrap().color_info((2048, 1536), "COLOR").unwrap();
        let numbers = [0.5, 0.51, 0.48, 0.64, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.0, 0.0, 0.02, 0.01];
        let mut legacy = numbers;
        // Rows 384 to 2688 of 3072.
        (legacy[1], legacy[3]) = ((0.51 * 3072.0 - 384.0) / 2304.0, 0.64 * 3072.0 / 2304.0);
        let (whole, legacy) = (info(file((4096, 3072), &numbers)), info(file((4096, 2304), &legacy)));
        assert!(whole.k.iter().zip(&legacy.k).all(|(one, other)| (one - other).abs() < 1e-9), "{whole:?} {legacy:?}");
    }

    #[test]
    fn what_is_wrong_is_named() {
        let error = |bytes: &[u8]| {
            let parsed = Calibration::parse(bytes);
            parsed.and_then(|calibration| calibration.color_info((1280, 720), "COLOR")).unwrap_err()
        };
        assert!(error(b"").contains("EOF"));
        assert_eq!(error(br#"{"CalibrationInformation": {"Cameras": []}}"#), format!("no camera at {DEPTH_LOCATION}"));
        assert_eq!(error(&file((4096, 3072), &[0.5; 13])), "ModelParameters: found 13 numbers, expected 14");
        assert!(error(&file((4096, 4096), &[0.5; 14])).starts_with("found a colour camera of 4096x4096 pixels"));
        let other = String::from_utf8(file((4096, 3072), &[0.5; 14])).unwrap().replace("BrownConrady", "Theta");
        assert!(error(other.as_bytes()).starts_with("ModelType: found \"CALIBRATION_LensDistortionModelTheta\""));
        let calibration = Calibration::parse(&file((4096, 3072), &[0.5; 14])).unwrap();
        assert!(calibration.depth_info((640, 480), "DEPTH").unwrap_err().contains("640x480"));
        let turned = String::from_utf8(file((4096, 3072), &[0.5; 14])).unwrap().replace("[1,0,0", "[2,0,0");
        let turned = Calibration::parse(turned.as_bytes()).unwrap().color_from_depth("COLOR", "DEPTH").unwrap_err();
        assert!(turned.contains("expected a rotation"), "{turned}");
    }
}
