//! Assembles an object's memory for a frame (official `sam2_base.py`, `_prepare_memory_conditioned_features`).

use super::remembered::{RememberedMap, RememberedPointer, floats};
use crate::device::is_cpu;
use crate::sam2::config::NUM_MASK_MEMORIES;
use crate::sam2::encoder::position_encoding::{sine_1d, sine_2d};
use crate::sam2::layers::Linear;
use crate::sam2::layers::host::host;
use crate::sam2::weights::WeightReader;
use crate::sam2::{Sam2Config, Sam2Error};
use crate::transfer::upload;
use burn::tensor::{Device, Tensor};

/// Panic message if a predictor's state and network are on different devices.
const ONE_DEVICE: &str = "memories are on the device of the network";

/// Memory of one object, ready for attention.
#[derive(Clone, Debug)]
pub(crate) enum AssembledMemory {
    /// On the CPU.
    Host(HostMemory),
    /// On other devices.
    Device(Box<DeviceMemory>),
}

/// Memory of one object on the CPU.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct HostMemory {
    /// `[tokens, memory]`: the maps, then what has no place in a map, which includes the object pointers, split into
    /// tokens.
    pub values: Vec<f32>,
    /// `[tokens, memory]`: the values plus position encodings.
    pub keys: Vec<f32>,
    /// Number of tokens at the end that have no place in a map.
    pub unplaced_tokens: usize,
}

/// Memory of one object on another device.
#[derive(Clone, Debug)]
pub(crate) struct DeviceMemory {
    /// `[1, tokens, memory]`.
    pub values: Tensor<3>,
    /// `[1, tokens, memory]`.
    pub keys: Tensor<3>,
    /// Number of tokens at the end that have no place in a map.
    pub unplaced_tokens: usize,
}

/// A remembered frame of one object.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SpatialMemory<'a> {
    pub features: &'a RememberedMap,
    /// Row of the temporal encoding: k - 1 for the frame k steps away, the last row for conditioning frames.
    pub temporal_row: usize,
}

/// A remembered object pointer and its distance in time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DistantPointer<'a> {
    pub pointer: &'a RememberedPointer,
    /// Distance in frames, divided by the largest possible distance of a pointer.
    pub distance: f32,
}

/// Assembles memories: holds the encodings of positions and times.
#[derive(Clone, Debug)]
pub(crate) struct Assembly {
    /// Number of tokens at the beginning of each memory that have no place in a map.
    unplaced: usize,
    /// Position encoding of a remembered map, `[side · side, memory]`.
    map_position: Vec<f32>,
    /// `[7, memory]`.
    temporal: Vec<f32>,
    /// Sum of both for every row of the temporal encoding, `[side · side, memory]`; empty on the CPU.
    positions: Vec<Tensor<2>>,
    /// Only SAM 2.1's pointers have an encoding of time.
    pointer_position: Option<Linear>,
    hidden_dim: usize,
    memory_dim: usize,
    device: Device,
}

impl Assembly {
    /// Reads the encodings for a feature map of `side` × `side` tokens.
    pub fn load(reader: &WeightReader, config: &Sam2Config, side: usize) -> Result<Self, Sam2Error> {
        let (hidden_dim, memory_dim) = (config.hidden_dim, config.memory_dim);
        let device = reader.device().clone();
        let memory_side = config.perceiver.map_or(side, |perceiver| perceiver.side);
        let map_position = sine_2d(memory_side, memory_side, memory_dim);
        let temporal = reader.floats("maskmem_tpos_enc", &[NUM_MASK_MEMORIES, 1, 1, memory_dim])?;
        let position = |row: &[f32]| {
            let sums =
                map_position.chunks_exact(memory_dim).flat_map(|token| token.iter().zip(row).map(|(a, b)| a + b));
            upload(sums.collect(), [memory_side * memory_side, memory_dim], &device)
        };
        let positions =
            if is_cpu(&device) { Vec::new() } else { temporal.chunks_exact(memory_dim).map(position).collect() };
        Ok(Self {
            positions,
            map_position,
            temporal,
            unplaced: config.perceiver.map_or(0, |perceiver| perceiver.latents),
            pointer_position: match config.has_memory_of_absence {
                true => Some(Linear::load(&reader.child("obj_ptr_tpos_proj"), hidden_dim, memory_dim)?),
                false => None,
            },
            hidden_dim,
            memory_dim,
            device,
        })
    }

    /// Assembles an object's memory: frames first, then pointers, each in the order given. Tokens without a place in a
    /// map come after all maps.
    pub fn assemble(&self, frames: &[SpatialMemory], pointers: &[DistantPointer]) -> AssembledMemory {
        if is_cpu(&self.device) {
            return AssembledMemory::Host(self.assemble_on_host(frames, pointers));
        }
        AssembledMemory::Device(Box::new(self.assemble_on_device(frames, pointers)))
    }

    /// Number of tokens without a place in a map.
    fn unplaced_tokens(&self, frames: &[SpatialMemory], pointers: &[DistantPointer]) -> usize {
        frames.len() * self.unplaced + pointers.len() * (self.hidden_dim / self.memory_dim)
    }

    fn assemble_on_host(&self, frames: &[SpatialMemory], pointers: &[DistantPointer]) -> HostMemory {
        let (mut values, mut keys) = (Vec::new(), Vec::new());
        let features = |frame: &SpatialMemory| {
            let RememberedMap::Host(features) = frame.features else { unreachable!("{ONE_DEVICE}") };
            floats(features)
        };
        let frames_with_features: Vec<(&SpatialMemory, Vec<f32>)> =
            frames.iter().map(|frame| (frame, features(frame))).collect();
        let temporal =
            |frame: &SpatialMemory| &self.temporal[frame.temporal_row * self.memory_dim..][..self.memory_dim];
        for (frame, features) in &frames_with_features {
            let features = &features[self.unplaced * self.memory_dim..];
            let tokens = features.chunks_exact(self.memory_dim);
            for (token, position) in tokens.zip(self.map_position.chunks_exact(self.memory_dim)) {
                let sum = |((value, spatial), temporal): ((&f32, &f32), &f32)| value + (spatial + temporal);
                keys.extend(token.iter().zip(position).zip(temporal(frame)).map(sum));
            }
            values.extend_from_slice(features);
        }
        for (frame, features) in &frames_with_features {
            let features = &features[..self.unplaced * self.memory_dim];
            keys.extend(features.iter().zip(temporal(frame).iter().cycle()).map(|(value, temporal)| value + temporal));
            values.extend_from_slice(features);
        }
        let positions = self.pointer_positions(pointers).map(host).unwrap_or_default();
        for (pointer, position) in pointers.iter().zip(positions.chunks_exact(self.memory_dim)) {
            let RememberedPointer::Host(pointer) = pointer.pointer else { unreachable!("{ONE_DEVICE}") };
            values.extend_from_slice(pointer);
            keys.extend(pointer.iter().zip(position.iter().cycle()).map(|(value, position)| value + position));
        }
        HostMemory { values, keys, unplaced_tokens: self.unplaced_tokens(frames, pointers) }
    }

    fn assemble_on_device(&self, frames: &[SpatialMemory], pointers: &[DistantPointer]) -> DeviceMemory {
        let (mut values, mut keys) = (Vec::new(), Vec::new());
        let features = |frame: &SpatialMemory| match frame.features {
            RememberedMap::Device(features) => (**features).clone(),
            RememberedMap::Host(_) => unreachable!("{ONE_DEVICE}"),
        };
        for frame in frames {
            let features = features(frame);
            let placed = features.dims()[0] - self.unplaced;
            let features = features.narrow(0, self.unplaced, placed);
            keys.push(features.clone() + self.positions[frame.temporal_row].clone());
            values.push(features);
        }
        for frame in frames.iter().filter(|_| self.unplaced > 0) {
            let features = features(frame).narrow(0, 0, self.unplaced);
            let temporal = self.temporal[frame.temporal_row * self.memory_dim..][..self.memory_dim].to_vec();
            keys.push(features.clone() + upload(temporal, [1, self.memory_dim], &self.device));
            values.push(features);
        }
        if let Some(positions) = self.pointer_positions(pointers) {
            let rows = pointers.iter().map(|pointer| match pointer.pointer {
                RememberedPointer::Device(pointer) => (**pointer).clone(),
                RememberedPointer::Host(_) => unreachable!("{ONE_DEVICE}"),
            });
            let pieces = [pointers.len(), self.hidden_dim / self.memory_dim, self.memory_dim];
            let pieces = Tensor::cat(rows.collect(), 0).reshape(pieces);
            values.push(pieces.clone().flatten(0, 1));
            keys.push((pieces + positions.unsqueeze_dim(1)).flatten(0, 1));
        }
        let [values, keys] = [values, keys].map(|parts| Tensor::cat(parts, 0).unsqueeze());
        DeviceMemory { values, keys, unplaced_tokens: self.unplaced_tokens(frames, pointers) }
    }

    /// Encodes the pointers' distances, `[pointers, memory]`; `None` if there are no pointers.
    fn pointer_positions(&self, pointers: &[DistantPointer]) -> Option<Tensor<2>> {
        if pointers.is_empty() {
            return None;
        }
        let Some(projection) = &self.pointer_position else {
            return Some(Tensor::zeros([pointers.len(), self.memory_dim], &self.device));
        };
        let sines = pointers.iter().flat_map(|pointer| sine_1d(pointer.distance, self.hidden_dim)).collect();
        Some(projection.forward(upload(sines, [pointers.len(), self.hidden_dim], &self.device)))
    }
}
