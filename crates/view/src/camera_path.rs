//! The camera's path, for viewers that come later.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use glam::DVec3;

/// Maximum number of points. Beyond it, every second one is removed.
const MAX_POINTS: usize = 4096;

/// Places of the camera in world coordinates, thinned out so that a long run needs no more memory than a short one.
#[derive(Debug)]
pub(crate) struct CameraPath {
    /// `None` where the camera was lost.
    points: Vec<Option<DVec3>>,
    /// One of this many frames is stored.
    stride: usize,
    frames: usize,
}

impl Default for CameraPath {
    fn default() -> Self {
        Self { points: Vec::new(), stride: 1, frames: 0 }
    }
}

impl CameraPath {
    /// Adds the place of the camera in the next frame; `None` if it is lost.
    pub(crate) fn add(&mut self, place: Option<DVec3>) {
        if self.frames.is_multiple_of(self.stride) {
            if self.points.len() == MAX_POINTS {
                self.points = self.points.iter().copied().step_by(2).collect();
                self.stride *= 2;
            }
            self.points.push(place);
        }
        self.frames += 1;
    }

    /// Number of frames so far.
    pub(crate) fn frames(&self) -> usize {
        self.frames
    }

    /// The points relative to an origin: three 32-bit floats each, little-endian, in base64. NaN where it was lost.
    pub(crate) fn encoded(&self, origin: DVec3) -> String {
        let point = |place: &Option<DVec3>| place.map_or([f32::NAN; 3], |place| (place - origin).as_vec3().to_array());
        STANDARD.encode(self.points.iter().flat_map(point).flat_map(f32::to_le_bytes).collect::<Vec<u8>>())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_path_is_thinned_out_evenly() {
        let mut path = CameraPath::default();
        for frame in 0..100_000_u32 {
            path.add(Some(DVec3::X * f64::from(frame)));
        }
        assert!((MAX_POINTS / 2..=MAX_POINTS).contains(&path.points.len()));
        let steps: Vec<f64> = path.points.windows(2).map(|pair| pair[1].unwrap().x - pair[0].unwrap().x).collect();
        assert!(steps.iter().all(|step| *step == steps[0]), "{steps:?}");
    }
}
