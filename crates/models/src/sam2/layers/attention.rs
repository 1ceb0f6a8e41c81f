//! Attention between rows of channels: our kernels on the CPU, Burn's operations on other devices.

use super::host::{HostValues, from_host};
use crate::device::is_cpu;
use crate::transfer::upload;
use burn::tensor::Tensor;
use burn::tensor::module::attention;
use burn::tensor::ops::AttentionModuleOptions;
use splatseg_kernels::attention::{HeadRows, multi_head_attention};

/// Maximum number of scores on a device at a time (64 MiB), as it may compute all of them before using any.
const MAX_SCORES: usize = 16 << 20;

/// Softmax attention with heads side by side in the channels: queries `[problems, n, channels]`, keys
/// `[problems, m, channels]` and values `[problems, m, outputs]` to `[problems, n, outputs]`.
pub(crate) fn multi_head(queries: Tensor<3>, keys: Tensor<3>, values: Tensor<3>, heads: usize) -> Tensor<3> {
    multi_head_boosted(queries, keys, values, heads, None)
}

/// Like [`multi_head`], with a number added to the scores of the first keys: their count, and the number.
pub(crate) fn multi_head_boosted(
    queries: Tensor<3>,
    keys: Tensor<3>,
    values: Tensor<3>,
    heads: usize,
    boost: Option<(usize, f32)>,
) -> Tensor<3> {
    let device = queries.device();
    let [problems, count, _] = queries.dims();
    let outputs = values.dims()[2];
    if !is_cpu(&device) {
        return on_device([queries, keys, values], heads, boost);
    }
    let operands = [queries, keys, values].map(|operand| (operand.dims(), HostValues::from_tensor(operand)));
    let problem = |problem: usize| {
        operands.each_ref().map(|([_, count, channels], values)| {
            let data = &values.as_slice()[problem * count * channels..];
            HeadRows { data, count: *count, width: channels / heads, stride: *channels }
        })
    };
    let rows: Vec<[HeadRows; 3]> = (0..problems).map(problem).collect();
    from_host(multi_head_attention(&rows, heads, boost), [problems, count, outputs], &device)
}

/// Processes the queries in parts, so that large maps do not need the full matrix of scores.
fn on_device(operands: [Tensor<3>; 3], heads: usize, boost: Option<(usize, f32)>) -> Tensor<3> {
    let [queries, keys, values] = operands.map(|operand| {
        let [problems, count, channels] = operand.dims();
        operand.reshape([problems, count, heads, channels / heads]).swap_dims(1, 2)
    });
    let ([problems, _, count, _], [_, _, key_count, _]) = (queries.dims(), keys.dims());
    let boosts = boost.map(|(first, value)| {
        let values = (0..key_count).map(|key| if key < first { value } else { 0.0 }).collect();
        upload(values, [1, 1, 1, key_count], &queries.device())
    });
    let rows = (MAX_SCORES / (problems * heads * key_count)).clamp(1, count);
    let parts = (0..count).step_by(rows).map(|first| {
        let queries = queries.clone().narrow(2, first, rows.min(count - first));
        let [problems, heads, rows, _] = queries.dims();
        let boosts = boosts.clone().map(|boosts| boosts.expand([problems, heads, rows, key_count]));
        attention(queries, keys.clone(), values.clone(), None, boosts, AttentionModuleOptions::default())
    });
    let attended = Tensor::cat(parts.collect(), 2).swap_dims(1, 2);
    let [_, _, _, outputs] = attended.dims();
    attended.reshape([problems, count, heads * outputs])
}
