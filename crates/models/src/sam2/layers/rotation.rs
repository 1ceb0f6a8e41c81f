//! Rotary position encoding of a map's tokens (official `position_encoding.py`).

use super::host::{from_host, host};
use crate::device::is_cpu;
use crate::transfer::upload;
use burn::tensor::{Device, Tensor};
use splatseg_kernels::attention::{rotary_angles, rotate};

/// The rotation of every token of a square map.
#[derive(Clone, Debug)]
pub(crate) struct Rotation {
    side: usize,
    /// Cosine and sine, `[side · side, channels / 2]`.
    angles: Vec<[f32; 2]>,
    /// On devices other than the CPU: cosines and sines, `[1, side · side, channels / 2, 1]`.
    tables: Option<[Tensor<4>; 2]>,
}

impl Rotation {
    /// Creates the rotation of a map of `side` × `side` tokens.
    pub fn new(side: usize, channels: usize, device: &Device) -> Self {
        let angles = rotary_angles(side, channels);
        let table = |part: usize| {
            let values = angles.iter().map(|angle| angle[part]).collect();
            upload(values, [1, side * side, channels / 2, 1], device)
        };
        let tables = (!is_cpu(device)).then(|| [table(0), table(1)]);
        Self { side, angles, tables }
    }

    /// Side of the map, in tokens.
    pub fn side(&self) -> usize {
        self.side
    }

    /// Cosine and sine, `[side · side, channels / 2]`.
    pub fn angles(&self) -> &[[f32; 2]] {
        &self.angles
    }

    /// Rotates channels 2i and 2i + 1 of every row by the row's i-th angle: `[problems, maps · side · side, channels]`.
    pub fn apply(&self, rows: Tensor<3>) -> Tensor<3> {
        let (shape, device) = (rows.dims(), rows.device());
        let [problems, count, channels] = shape;
        let Some([cosines, sines]) = &self.tables else {
            let mut rows = host(rows);
            rotate(&mut rows, &self.angles, channels / 2);
            return from_host(rows, shape, &device);
        };
        let [_, period, pairs, _] = cosines.dims();
        let rows = rows.reshape([problems * count / period, period, pairs, 2]);
        let [a, b] = [0, 1].map(|part| rows.clone().narrow(3, part, 1));
        let (cosines, sines) = (cosines.clone(), sines.clone());
        let rotated = [a.clone() * cosines.clone() - b.clone() * sines.clone(), a * sines + b * cosines];
        Tensor::cat(rotated.to_vec(), 3).reshape(shape)
    }
}
