//! Memory attention: a frame's features attend to an object's memory (official `memory_attention.py`,
//! `sam/transformer.py` for the rotary attention).

use super::assembly::{AssembledMemory, DeviceMemory, HostMemory};
use super::pooled_attention::attend_pooled;
use crate::device::is_cpu;
use crate::sam2::encoder::position_encoding::sine_2d;
use crate::sam2::layers::host::{HostValues, from_host};
use crate::sam2::layers::{Activation, LayerNorm, Linear, LinearWeights, Rotation, forward_chain, multi_head};
use crate::sam2::weights::WeightReader;
use crate::sam2::{MemoryPooling, Sam2Config, Sam2Error};
use crate::transfer::upload;
use burn::tensor::Tensor;
use splatseg_kernels::attention::{AxialKeys, RememberedMaps};
use std::collections::BTreeMap;

const EPSILON: f64 = 1e-5;
/// Weight of the position encoding added to the features.
const POSITION_WEIGHT: f64 = 0.1;

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
    cross_keys: Linear,
    /// On the CPU, the same with the rotation of remembered maps.
    axial_keys: Option<AxialKeys>,
    /// The value and output projections combined: softmax weights sum to 1, so projecting the weighted mean of the few
    /// memory channels equals averaging the many projected ones.
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
    rotations: Rotations,
    /// How remembered maps are pooled.
    pub pooling: MemoryPooling,
}

/// The features of a frame after the part of memory attention that is the same for all objects.
#[derive(Clone, Debug)]
pub(crate) struct PreparedFeatures(Tensor<3>);

/// Rotations of tokens by their places.
#[derive(Clone, Debug)]
struct Rotations {
    /// Of the feature map, whose tokens are the queries.
    map: Rotation,
    /// Of remembered maps, which may be smaller.
    memory: Rotation,
}

impl Layer {
    /// Loads a layer that attends to remembered maps of `memory_side` × `memory_side` tokens.
    fn load(
        reader: &WeightReader,
        config: &Sam2Config,
        rotations: &Rotations,
        memory_side: usize,
    ) -> Result<Self, Sam2Error> {
        let (hidden, memory) = (config.hidden_dim, config.memory_dim);
        let norm = |name: &str| LayerNorm::load(&reader.child(name), hidden, EPSILON);
        let linear = |name: &str, inputs, outputs| Linear::load(&reader.child(name), inputs, outputs);
        let cross_keys = LinearWeights::load(&reader.child("cross_attn_image.k_proj"), memory, hidden)?;
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
            axial_keys: is_cpu(reader.device()).then(|| cross_keys.axial_keys(rotations.memory.angles(), memory_side)),
            cross_keys: cross_keys.on(reader.device()),
            cross_values_out: cross_values.then(&cross_out).on(reader.device()),
            norm3: norm("norm3")?,
            linear1: linear("linear1", hidden, config.memory_feed_forward_dim)?,
            linear2: linear("linear2", config.memory_feed_forward_dim, hidden)?,
        })
    }

    fn feed_forward(&self, map: Tensor<3>) -> Tensor<3> {
        let layers = [(&self.linear1, Activation::Relu), (&self.linear2, Activation::None)];
        forward_chain(Some(&self.norm3), &layers, map.clone(), Some(map))
    }

    fn attend_to_self(&self, map: Tensor<3>, rotation: &Rotation) -> Tensor<3> {
        let projected = |linear: &Linear| linear.forward_normed(&self.norm1, map.clone());
        let (queries, keys) = (projected(&self.self_queries), projected(&self.self_keys));
        let values = projected(&self.self_values);
        let attended = multi_head(rotation.apply(queries), rotation.apply(keys), values, 1);
        self.self_out.forward_added(attended, map)
    }

    /// `[objects or 1, tokens, hidden]` and one memory per object to `[objects, tokens, hidden]`.
    fn attend_to_memories(
        &self,
        map: Tensor<3>,
        memories: &[AssembledMemory],
        rotations: &Rotations,
        pooling: MemoryPooling,
    ) -> Tensor<3> {
        let [_, tokens, hidden] = map.dims();
        let queries = rotations.map.apply(self.cross_queries.forward_normed(&self.norm2, map.clone()));
        let attended = match (&self.axial_keys, pooling) {
            (Some(keys), MemoryPooling::None) => attend_on_host(keys, queries, memories),
            (None, MemoryPooling::None) => attend_on_device(&self.cross_keys, queries, memories, &rotations.memory),
            _ => attend_pooled(&self.cross_keys, queries, memories, &rotations.memory, pooling),
        };
        let map = map.expand([memories.len(), tokens, hidden]);
        self.cross_values_out.forward_added(attended, map)
    }
}

/// Returns the weighted mean of each object's memory, `[objects, tokens, memory]`, for rotated queries
/// `[objects or 1, tokens, hidden]`.
fn attend_on_host(keys: &AxialKeys, queries: Tensor<3>, memories: &[AssembledMemory]) -> Tensor<3> {
    let ([query_objects, tokens, hidden], device) = (queries.dims(), queries.device());
    let queries = HostValues::from_tensor(queries);
    let attended = memories.iter().enumerate().flat_map(|(object, memory)| {
        let AssembledMemory::Host(HostMemory { values, keys: memory_keys, unplaced_tokens }) = memory else {
            unreachable!("memories are on the device of the network")
        };
        let start = if query_objects == 1 { 0 } else { object * tokens * hidden };
        let memory = RememberedMaps { keys: memory_keys, values, unplaced_tokens: *unplaced_tokens };
        keys.attend(&queries.as_slice()[start..start + tokens * hidden], memory)
    });
    from_host(attended.collect(), [memories.len(), tokens, keys.memory_dim()], &device)
}

/// Like [`attend_on_host`], on other devices. Objects whose memories have the same length are processed together.
fn attend_on_device(keys: &Linear, queries: Tensor<3>, memories: &[AssembledMemory], rotation: &Rotation) -> Tensor<3> {
    let [query_objects, tokens, hidden] = queries.dims();
    let mut by_length: BTreeMap<[usize; 2], Vec<(usize, &DeviceMemory)>> = BTreeMap::new();
    for (object, memory) in memories.iter().enumerate() {
        let AssembledMemory::Device(memory) = memory else { unreachable!("memories are on the device of the network") };
        by_length.entry([memory.keys.dims()[1], memory.unplaced_tokens]).or_default().push((object, memory));
    }
    let mut attended: Vec<Option<Tensor<3>>> = vec![None; memories.len()];
    for ([length, unplaced_tokens], group) in by_length {
        let all = |part: fn(&DeviceMemory) -> &Tensor<3>| {
            Tensor::cat(group.iter().map(|(_, memory)| part(memory).clone()).collect(), 0)
        };
        let projected = keys.forward(all(|memory| &memory.keys));
        let in_maps = length - unplaced_tokens;
        let mut rotated = vec![rotation.apply(projected.clone().narrow(1, 0, in_maps))];
        if unplaced_tokens > 0 {
            rotated.push(projected.narrow(1, in_maps, unplaced_tokens));
        }
        let queries = if query_objects == 1 {
            queries.clone().expand([group.len(), tokens, hidden])
        } else {
            Tensor::cat(group.iter().map(|(object, _)| queries.clone().narrow(0, *object, 1)).collect(), 0)
        };
        let found = multi_head(queries, Tensor::cat(rotated, 1), all(|memory| &memory.values), 1);
        for (place, (object, _)) in group.iter().enumerate() {
            attended[*object] = Some(found.clone().narrow(0, place, 1));
        }
    }
    Tensor::cat(attended.into_iter().flatten().collect(), 0)
}

impl MemoryAttention {
    /// Loads memory attention for a feature map of `side` × `side` tokens.
    pub fn load(reader: &WeightReader, config: &Sam2Config, side: usize) -> Result<Self, Sam2Error> {
        let hidden = config.hidden_dim;
        let attention = reader.child("memory_attention");
        let memory_side = config.perceiver.map_or(side, |perceiver| perceiver.side);
        let rotation = |side| Rotation::new(side, hidden, reader.device());
        let rotations = Rotations { map: rotation(side), memory: rotation(memory_side) };
        let position = upload(sine_2d(side, side, hidden), [1, side * side, hidden], reader.device());
        Ok(Self {
            layers: (0..config.memory_attention_layers)
                .map(|layer| Layer::load(&attention.child(format!("layers.{layer}")), config, &rotations, memory_side))
                .collect::<Result<_, _>>()?,
            norm: LayerNorm::load(&attention.child("norm"), hidden, EPSILON)?,
            position: position * POSITION_WEIGHT,
            rotations,
            pooling: MemoryPooling::None,
        })
    }

    /// Prepares the features of a frame, `[1, tokens, hidden]`, with what is the same for all objects: they attend to
    /// themselves for the first time.
    pub fn prepare(&self, embedding: Tensor<3>) -> PreparedFeatures {
        let map = embedding + self.position.clone();
        PreparedFeatures(
            self.layers.first().map_or(map.clone(), |first| first.attend_to_self(map, &self.rotations.map)),
        )
    }

    /// Conditions prepared features on each object's memory: `[objects, tokens, hidden]`. `observe` is called with every
    /// layer's output.
    pub fn forward(
        &self,
        prepared: &PreparedFeatures,
        memories: &[AssembledMemory],
        mut observe: impl FnMut(usize, &Tensor<3>),
    ) -> Tensor<3> {
        let mut map = prepared.0.clone();
        for (index, layer) in self.layers.iter().enumerate() {
            if index > 0 {
                map = layer.attend_to_self(map, &self.rotations.map);
            }
            map = layer.attend_to_memories(map, memories, &self.rotations, self.pooling);
            map = layer.feed_forward(map);
            observe(index, &map);
        }
        self.norm.forward(map)
    }
}
