//! Memory attention: the features of a frame attend to what is remembered of an object (official `memory_attention.py`,
//! `sam/transformer.py` for the rotary attention, `sam2_base.py` for how the memory is put together).

use crate::sam2::config::MEMORY_ATTENTION_LAYERS;
use crate::sam2::encoder::position_encoding::{sine_1d, sine_2d};
use crate::sam2::layers::host::{HostValues, from_host, host};
use crate::sam2::layers::{Activation, LayerNorm, Linear, LinearWeights, forward_chain};
use crate::sam2::weights::WeightReader;
use crate::sam2::{Sam2Config, Sam2Error};
use burn::tensor::{Tensor, TensorData};
use splatseg_kernels::attention::{AxialKeys, HeadRows, RememberedMaps, multi_head_attention, rotary_angles, rotate};

const EPSILON: f64 = 1e-5;
/// Weight of the position encoding that is added to the features.
const POSITION_WEIGHT: f64 = 0.1;

/// What is remembered of one object, ready to be attended to.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct AssembledMemory {
    /// `[tokens, memory]`: the memories, then the object pointers cut into pieces.
    pub values: Vec<f32>,
    /// `[tokens, memory]`: the same plus position encodings.
    pub keys: Vec<f32>,
    /// How many tokens at the end belong to pointers.
    pub pointer_tokens: usize,
}

/// A remembered frame of one object.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SpatialMemory<'a> {
    /// `[side · side, memory]`.
    pub features: &'a [f32],
    /// Row of the temporal encoding: k - 1 for the frame k steps away, the last row for conditioning frames.
    pub temporal_row: usize,
}

/// A remembered object pointer.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RememberedPointer<'a> {
    /// `[hidden]`.
    pub pointer: &'a [f32],
    /// Distance in frames, divided by the largest distance that pointers can have.
    pub distance: f32,
}

/// One layer.
#[derive(Clone, Debug)]
struct Layer {
    norm1: LayerNorm,
    self_queries: Linear,
    self_keys: Linear,
    self_values: Linear,
    self_out: Linear,
    norm2: LayerNorm,
    cross_queries: Linear,
    cross_keys: AxialKeys,
    /// The projection of the values and the one of the result, in one: the weights of a softmax sum to 1, so that
    /// projecting the weighted mean of the few memory channels equals averaging many projected ones.
    cross_values_out: Linear,
    norm3: LayerNorm,
    linear1: Linear,
    linear2: Linear,
}

/// Memory attention.
#[derive(Clone, Debug)]
pub(crate) struct MemoryAttention {
    layers: Vec<Layer>,
    norm: LayerNorm,
    /// Position encoding of the feature map times its weight, `[1, tokens, hidden]`.
    position: Tensor<3>,
    /// Rotary angles of the feature map.
    angles: Vec<[f32; 2]>,
    /// Position encoding of a memory, `[tokens, memory]`.
    memory_position: Vec<f32>,
    /// `[7, memory]`.
    temporal: Vec<f32>,
    pointer_position: Linear,
    hidden_dim: usize,
    memory_dim: usize,
}

impl Layer {
    fn load(reader: &WeightReader, config: &Sam2Config, angles: &[[f32; 2]], side: usize) -> Result<Self, Sam2Error> {
        let (hidden, memory) = (config.hidden_dim, config.memory_dim);
        let norm = |name: &str| LayerNorm::load(&reader.child(name), hidden, EPSILON);
        let linear = |name: &str, inputs, outputs| Linear::load(&reader.child(name), inputs, outputs);
        let cross_values = LinearWeights::load(&reader.child("cross_attn_image.v_proj"), memory, hidden)?;
        let cross_out = LinearWeights::load(&reader.child("cross_attn_image.out_proj"), hidden, hidden)?;
        Ok(Self {
            norm1: norm("norm1")?,
            self_queries: linear("self_attn.q_proj", hidden, hidden)?,
            self_keys: linear("self_attn.k_proj", hidden, hidden)?,
            self_values: linear("self_attn.v_proj", hidden, hidden)?,
            self_out: linear("self_attn.out_proj", hidden, hidden)?,
            norm2: norm("norm2")?,
            cross_queries: linear("cross_attn_image.q_proj", hidden, hidden)?,
            cross_keys: LinearWeights::load(&reader.child("cross_attn_image.k_proj"), memory, hidden)?
                .axial_keys(angles, side),
            cross_values_out: cross_values.then(&cross_out).on(reader.device()),
            norm3: norm("norm3")?,
            linear1: linear("linear1", hidden, config.memory_feed_forward_dim)?,
            linear2: linear("linear2", config.memory_feed_forward_dim, hidden)?,
        })
    }

    /// `[objects or 1, tokens, hidden]` and one memory per object to `[objects, tokens, hidden]`. What is the same for
    /// all objects is computed once.
    fn forward(&self, map: Tensor<3>, memories: &[AssembledMemory], angles: &[[f32; 2]]) -> Tensor<3> {
        let map = self.attend_to_self(map, angles);
        let map = self.attend_to_memories(map, memories, angles);
        let layers = [(&self.linear1, Activation::Relu), (&self.linear2, Activation::None)];
        forward_chain(Some(&self.norm3), &layers, map.clone(), Some(map))
    }

    fn attend_to_self(&self, map: Tensor<3>, angles: &[[f32; 2]]) -> Tensor<3> {
        let (shape, device) = (map.dims(), map.device());
        let [objects, tokens, hidden] = shape;
        let rotated = |linear: &Linear| {
            let mut rows = host(linear.forward_normed(&self.norm1, map.clone()));
            rotate(&mut rows, angles, hidden / 2);
            rows
        };
        let (queries, keys) = (rotated(&self.self_queries), rotated(&self.self_keys));
        let values = HostValues::from_tensor(self.self_values.forward_normed(&self.norm1, map.clone()));
        let problem = |object: usize| {
            [&queries, &keys, values.as_slice()].map(|data| HeadRows {
                data: &data[object * tokens * hidden..],
                count: tokens,
                width: hidden,
                stride: hidden,
            })
        };
        let problems: Vec<[HeadRows; 3]> = (0..objects).map(problem).collect();
        let attended = from_host(multi_head_attention(&problems, 1), shape, &device);
        self.self_out.forward_added(attended, map)
    }

    fn attend_to_memories(&self, map: Tensor<3>, memories: &[AssembledMemory], angles: &[[f32; 2]]) -> Tensor<3> {
        let device = map.device();
        let queries = self.cross_queries.forward_normed(&self.norm2, map.clone());
        let [query_objects, tokens, hidden] = queries.dims();
        let mut queries = host(queries);
        rotate(&mut queries, angles, hidden / 2);
        let memory_dim = self.cross_keys.memory_dim();
        let attended =
            memories.iter().enumerate().flat_map(|(object, AssembledMemory { values, keys, pointer_tokens })| {
                let start = if query_objects == 1 { 0 } else { object * tokens * hidden };
                let memory = RememberedMaps { keys, values, pointer_tokens: *pointer_tokens };
                self.cross_keys.attend(&queries[start..start + tokens * hidden], memory)
            });
        let attended = from_host(attended.collect(), [memories.len(), tokens, memory_dim], &device);
        let map = map.expand([memories.len(), tokens, hidden]);
        self.cross_values_out.forward_added(attended, map)
    }
}

impl MemoryAttention {
    /// Reads memory attention for a feature map of `side` × `side` tokens.
    pub fn load(reader: &WeightReader, config: &Sam2Config, side: usize) -> Result<Self, Sam2Error> {
        let (hidden_dim, memory_dim) = (config.hidden_dim, config.memory_dim);
        let rows = crate::sam2::config::NUM_MASK_MEMORIES;
        let attention = reader.child("memory_attention");
        let angles = rotary_angles(side, hidden_dim);
        let position = TensorData::new(sine_2d(side, side, hidden_dim), [1, side * side, hidden_dim]);
        Ok(Self {
            layers: (0..MEMORY_ATTENTION_LAYERS)
                .map(|layer| Layer::load(&attention.child(format!("layers.{layer}")), config, &angles, side))
                .collect::<Result<_, _>>()?,
            norm: LayerNorm::load(&attention.child("norm"), hidden_dim, EPSILON)?,
            position: Tensor::from_data(position, reader.device()) * POSITION_WEIGHT,
            angles,
            memory_position: sine_2d(side, side, memory_dim),
            temporal: reader.floats("maskmem_tpos_enc", &[rows, 1, 1, memory_dim])?,
            pointer_position: Linear::load(&reader.child("obj_ptr_tpos_proj"), hidden_dim, memory_dim)?,
            hidden_dim,
            memory_dim,
        })
    }

    /// Assembles an object's memory: frames first, then pointers, each in the order given.
    pub fn assemble(&self, frames: &[SpatialMemory], pointers: &[RememberedPointer]) -> AssembledMemory {
        let mut values = Vec::new();
        let mut keys = Vec::new();
        for frame in frames {
            let temporal = &self.temporal[frame.temporal_row * self.memory_dim..][..self.memory_dim];
            values.extend_from_slice(frame.features);
            let tokens = frame.features.chunks_exact(self.memory_dim);
            for (token, position) in tokens.zip(self.memory_position.chunks_exact(self.memory_dim)) {
                let sum = |((value, spatial), temporal): ((&f32, &f32), &f32)| value + (spatial + temporal);
                keys.extend(token.iter().zip(position).zip(temporal).map(sum));
            }
        }
        let positions = self.pointer_positions(pointers);
        for (pointer, position) in pointers.iter().zip(positions.chunks_exact(self.memory_dim)) {
            values.extend_from_slice(pointer.pointer);
            keys.extend(pointer.pointer.iter().zip(position.iter().cycle()).map(|(value, position)| value + position));
        }
        AssembledMemory { values, keys, pointer_tokens: pointers.len() * (self.hidden_dim / self.memory_dim) }
    }

    /// Encodings of the pointers' distances, `[pointers, memory]`.
    fn pointer_positions(&self, pointers: &[RememberedPointer]) -> Vec<f32> {
        if pointers.is_empty() {
            return Vec::new();
        }
        let sines = pointers.iter().flat_map(|pointer| sine_1d(pointer.distance, self.hidden_dim)).collect();
        let sines = TensorData::new::<f32, _>(sines, [pointers.len(), self.hidden_dim]);
        host(self.pointer_position.forward(Tensor::<2>::from_data(sines, &self.position.device())))
    }

    /// Conditions the features of a frame, `[1, tokens, hidden]`, on each object's memory: `[objects, tokens, hidden]`.
    /// `observe` is called with every layer's output.
    pub fn forward(
        &self,
        embedding: Tensor<3>,
        memories: &[AssembledMemory],
        mut observe: impl FnMut(usize, &Tensor<3>),
    ) -> Tensor<3> {
        let mut map = embedding + self.position.clone();
        for (index, layer) in self.layers.iter().enumerate() {
            map = layer.forward(map, memories, &self.angles);
            observe(index, &map);
        }
        self.norm.forward(map)
    }
}
