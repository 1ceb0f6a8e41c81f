//! Prefix sums and sorting, as sequences of kernels.

use crate::GpuError;
use crate::device::{Buffer, GpuDevice, cube_dim, cubes};
use crate::kernels::scan::{BLOCK, scan_blocks, scan_sums, sum_blocks};
use crate::kernels::sort::{BITS, DIGITS, SORT_BLOCK, count_block_digits, scatter};

/// Exclusive prefix sums of the first `count` values.
pub(crate) fn prefix_sums(device: &GpuDevice, values: &Buffer, count: usize) -> Result<Buffer, GpuError> {
    let scanned = device.empty(count, "prefix sums")?;
    let blocks = count.div_ceil(BLOCK).max(1);
    let (sums, starts) = (device.empty(blocks, "sums of blocks")?, device.empty(blocks, "sums of blocks")?);
    let client = &device.client;
    sum_blocks::launch(client, cubes(blocks), cube_dim(), values.arg(), sums.arg(), count as u32);
    scan_sums::launch(client, cubes(1), cube_dim(), sums.arg(), starts.arg(), blocks as u32);
    scan_blocks::launch(client, cubes(blocks), cube_dim(), values.arg(), starts.arg(), scanned.arg(), count as u32);
    Ok(scanned)
}

/// Keys and their values.
#[derive(Clone, Debug)]
pub(crate) struct Keyed {
    pub keys: Buffer,
    pub values: Buffer,
}

/// The first `count` pairs sorted by the lowest `bits` of their keys; equal keys keep their order.
pub(crate) fn sorted(device: &GpuDevice, unsorted: Keyed, count: usize, bits: u32) -> Result<Keyed, GpuError> {
    let blocks = count.div_ceil(SORT_BLOCK).max(1);
    let mut from = unsorted;
    let mut to = Keyed { keys: device.empty(count, "sort keys")?, values: device.empty(count, "sort values")? };
    let client = &device.client;
    let (count, block_count) = (count as u32, blocks as u32);
    for shift in (0..bits).step_by(BITS as usize) {
        let histogram = device.empty(DIGITS * blocks, "histogram")?;
        let keys = from.keys.arg();
        count_block_digits::launch(client, cubes(blocks), cube_dim(), keys, histogram.arg(), count, block_count, shift);
        let starts = prefix_sums(device, &histogram, DIGITS * blocks)?;
        scatter::launch(
            client,
            cubes(blocks),
            cube_dim(),
            from.keys.arg(),
            from.values.arg(),
            starts.arg(),
            to.keys.arg(),
            to.values.arg(),
            count,
            block_count,
            shift,
        );
        std::mem::swap(&mut from, &mut to);
    }
    Ok(from)
}
