//! Stored memory of a frame, on the network's device.

use crate::device::is_cpu;
use crate::sam2::layers::host::{HostValues, host};
use crate::transfer::download;
use burn::tensor::Tensor;
use half::bf16;
use half::slice::HalfFloatSliceExt;

/// Features of a map in bfloat16 precision, as in the official predictor.
#[derive(Clone, Debug)]
pub(crate) enum RememberedMap {
    /// On the CPU, `[side · side, memory]`.
    Host(Vec<bf16>),
    /// On other devices, which may lack bfloat16: float32 rounded to bfloat16, `[side · side, memory]`.
    Device(Box<Tensor<2>>),
}

/// An object pointer.
#[derive(Clone, Debug)]
pub(crate) enum RememberedPointer {
    /// On the CPU, `[hidden]`.
    Host(Vec<f32>),
    /// On other devices, `[1, hidden]`.
    Device(Box<Tensor<2>>),
}

impl RememberedMap {
    /// Stores the map of one object, `[side · side, memory]`.
    pub fn new(map: Tensor<2>) -> Self {
        if is_cpu(&map.device()) {
            let values = HostValues::from_tensor(map);
            return Self::Host(values.as_slice().iter().map(|value| bf16::from_f32(*value)).collect());
        }
        Self::Device(Box::new(rounded_to_bf16(map)))
    }

    /// Returns the features, `[side · side, memory]`, row-major.
    ///
    /// # Errors
    /// The device's message if it failed.
    pub fn values(&self) -> Result<Vec<f32>, String> {
        match self {
            Self::Host(values) => Ok(floats(values)),
            Self::Device(map) => Ok(download(vec![map.as_ref().clone().flatten(0, 1)])?.concat()),
        }
    }

    /// Its size in bytes.
    pub fn bytes(&self) -> usize {
        match self {
            Self::Host(values) => size_of_val(values.as_slice()),
            Self::Device(map) => size_of::<f32>() * map.shape().num_elements(),
        }
    }
}

impl RememberedPointer {
    /// Stores the pointer of one object, `[1, hidden]`.
    pub fn new(pointer: Tensor<2>) -> Self {
        if is_cpu(&pointer.device()) { Self::Host(host(pointer)) } else { Self::Device(Box::new(pointer)) }
    }

    /// Its size in bytes.
    pub fn bytes(&self) -> usize {
        let length = match self {
            Self::Host(values) => values.len(),
            Self::Device(pointer) => pointer.shape().num_elements(),
        };
        size_of::<f32>() * length
    }
}

/// Converts bfloat16 to float32.
pub(super) fn floats(values: &[bf16]) -> Vec<f32> {
    let mut floats = vec![0.0; values.len()];
    values.convert_to_f32_slice(&mut floats);
    floats
}

/// Rounds to the nearest bfloat16 (Veltkamp 1968), which has 16 bits fewer than float32.
fn rounded_to_bf16(values: Tensor<2>) -> Tensor<2> {
    let spread = values.clone() * 65537.0;
    spread.clone() - (spread - values)
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::{Device, TensorData};

    #[test]
    fn rounding_matches_bfloat16() {
        let values: Vec<f32> = (0..4000).map(|index| ((index * 7919) % 4001) as f32 / 97.0 - 20.0).collect();
        let tensor = Tensor::<2>::from_data(TensorData::new(values.clone(), [40, 100]), &Device::flex());
        let expected: Vec<f32> = values.iter().map(|value| bf16::from_f32(*value).to_f32()).collect();
        assert_eq!(host(rounded_to_bf16(tensor)), expected);
    }
}
