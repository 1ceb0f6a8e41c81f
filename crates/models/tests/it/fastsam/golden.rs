//! Reference files.

use crate::sam2_golden::{own_or_shared, test_device};
use safetensors::SafeTensors;
use splatseg_geometry::{Image, Mask};
use splatseg_test_scenes::skipped;
use std::path::{Path, PathBuf};

/// As [`own_or_shared`]; also `None`, reported on a line of its own, if the device for tests is missing.
pub fn shared(path: &str, test: &str) -> Option<PathBuf> {
    if let Some(reason) = test_device::missing() {
        skipped(test, &reason);
        return None;
    }
    own_or_shared(path, test)
}

/// One safetensors file.
pub struct Golden(Vec<u8>);

impl Golden {
    /// Opens a file in `golden/fastsam`; see [`shared`].
    pub fn open(name: &str, test: &str) -> Option<Self> {
        let path = shared(&format!("golden/fastsam/{name}"), test)?;
        Some(Self(std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))))
    }

    fn tensors(&self) -> SafeTensors<'_> {
        SafeTensors::deserialize(&self.0).unwrap()
    }

    pub fn has(&self, name: &str) -> bool {
        self.tensors().tensor(name).is_ok()
    }

    pub fn shape(&self, name: &str) -> Vec<usize> {
        self.tensors().tensor(name).unwrap_or_else(|error| panic!("{name}: {error}")).shape().to_vec()
    }

    pub fn bytes(&self, name: &str) -> Vec<u8> {
        self.tensors().tensor(name).unwrap_or_else(|error| panic!("{name}: {error}")).data().to_vec()
    }

    pub fn floats(&self, name: &str) -> Vec<f32> {
        self.bytes(name).as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect()
    }

    pub fn ints(&self, name: &str) -> Vec<i32> {
        self.bytes(name).as_chunks::<4>().0.iter().map(|bytes| i32::from_le_bytes(*bytes)).collect()
    }
}

impl Golden {
    /// Reads masks stored as run lengths: `<prefix>_rle`, `<prefix>_rle_offsets` and `<prefix>_hw`.
    pub fn masks(&self, prefix: &str) -> Vec<Mask> {
        let (runs, offsets) = (self.ints(&format!("{prefix}_rle")), self.ints(&format!("{prefix}_rle_offsets")));
        let size = self.ints(&format!("{prefix}_hw"));
        let (height, width) = (size[0] as usize, size[1] as usize);
        let mask = |range: &[i32]| {
            let mut mask = Mask::empty(width, height);
            let mut start = 0;
            for (place, run) in runs[range[0] as usize..range[1] as usize].iter().enumerate() {
                let end = start + *run as usize;
                if place % 2 == 1 {
                    (start..end).for_each(|pixel| mask.set(pixel % width, pixel / width, true));
                }
                start = end;
            }
            assert_eq!(start, width * height);
            mask
        };
        offsets.windows(2).map(mask).collect()
    }
}

/// Number of pixels in only one of the masks.
pub fn different_pixels(a: &Mask, b: &Mask) -> usize {
    a.area() + b.area() - 2 * a.intersection_area(b)
}

/// Reads an image file like the command does.
pub fn image(path: &Path) -> Image<[u8; 3]> {
    splatseg_dataset::read_color_image(path).unwrap_or_else(|error| panic!("{error}"))
}
