//! EfficientTAM's attention to pooled memories (Xiong et al. 2024, section 3.3; official `EfficientRoPEAttention1` and
//! `EfficientRoPEAttention2`).

use super::assembly::{AssembledMemory, DeviceMemory, HostMemory};
use crate::sam2::MemoryPooling;
use crate::sam2::layers::host::from_host;
use crate::sam2::layers::{Linear, Rotation, multi_head_boosted};
use burn::tensor::Tensor;

/// A pooled token stands for 2 × 2 tokens.
const POOL: usize = 2;

/// Returns the weighted mean of each object's memory, `[objects, tokens, memory]`, for rotated queries
/// `[objects or 1, tokens, hidden]`. Remembered maps of `rotation`'s side are pooled if there is more than one.
pub(super) fn attend_pooled(
    keys: &Linear,
    queries: Tensor<3>,
    memories: &[AssembledMemory],
    rotation: &Rotation,
    pooling: MemoryPooling,
) -> Tensor<3> {
    let (query_objects, device) = (queries.dims()[0], queries.device());
    let attended = memories.iter().enumerate().map(|(object, memory)| {
        let queries = queries.clone().narrow(0, if query_objects == 1 { 0 } else { object }, 1);
        let (memory_keys, values, unplaced) = match memory {
            AssembledMemory::Host(HostMemory { values, keys: memory_keys, unplaced_tokens }) => {
                let tensor = |values: &Vec<f32>| {
                    let channels = keys.inputs();
                    from_host(values.clone(), [1, values.len() / channels, channels], &device)
                };
                (tensor(memory_keys), tensor(values), *unplaced_tokens)
            }
            AssembledMemory::Device(memory) => {
                let DeviceMemory { values, keys, unplaced_tokens } = memory.as_ref();
                (keys.clone(), values.clone(), *unplaced_tokens)
            }
        };
        let projected = keys.forward(memory_keys);
        let placed = projected.dims()[1] - unplaced;
        let side = rotation.side();
        let is_pooled = placed > side * side;
        let split = |all: Tensor<3>| {
            (all.clone().narrow(1, 0, placed), (unplaced > 0).then(|| all.narrow(1, placed, unplaced)))
        };
        let (maps, pointers) = split(projected);
        let (value_maps, value_pointers) = split(values);
        let (mut maps, mut value_maps) = (rotation.apply(maps), value_maps);
        let mut boost = None;
        if is_pooled {
            (maps, value_maps) = (pooled(maps, side), pooled(value_maps, side));
            // A token that stands for four counts four times.
            let weight = (POOL as f32).powi(2).ln();
            match pooling {
                MemoryPooling::Shifted => maps = maps + weight,
                _ => boost = Some((maps.dims()[1], weight)),
            }
        }
        let joined = |first: Tensor<3>, second: Option<Tensor<3>>| match second {
            Some(second) => Tensor::cat(vec![first, second], 1),
            None => first,
        };
        multi_head_boosted(queries, joined(maps, pointers), joined(value_maps, value_pointers), 1, boost)
    });
    Tensor::cat(attended.collect(), 0)
}

/// Averages 2 × 2 tokens of maps `[1, maps · side · side, channels]`.
fn pooled(maps: Tensor<3>, side: usize) -> Tensor<3> {
    let [_, tokens, channels] = maps.dims();
    let count = tokens / (side * side);
    let blocks = maps.reshape([count * side / POOL, POOL, side / POOL, POOL * channels]);
    // Rows of two, then columns of two: slices instead of reductions along short axes.
    let rows = blocks.clone().narrow(1, 0, 1) + blocks.narrow(1, 1, 1);
    let columns = rows.clone().narrow(3, 0, channels) + rows.narrow(3, channels, channels);
    (columns / (POOL * POOL) as f32).reshape([1, tokens / (POOL * POOL), channels])
}
