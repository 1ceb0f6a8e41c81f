//! One pass of a stable radix sort: four bits of the key, blocks of 1024 pairs of a key and a value.

use super::scan::{BLOCK, PER_THREAD, THREADS};
use cubecl::prelude::*;

/// Bits that one pass sorts by.
pub(crate) const BITS: u32 = 4;
/// Values of those bits.
pub(crate) const DIGITS: usize = 16;

/// Counts each digit of this thread's keys: `counts[digit, thread]`.
#[cube]
fn count_digits(keys: &[u32], counts: &mut Shared<[u32]>, count: u32, shift: u32) {
    let unit = UNIT_POS as usize;
    #[unroll]
    for digit in 0..DIGITS {
        counts[digit * THREADS + unit] = 0;
    }
    let first = ABSOLUTE_POS * PER_THREAD;
    for step in 0..PER_THREAD {
        if first + step < count as usize {
            let digit = ((keys[first + step] >> shift) & 15u32) as usize;
            counts[digit * THREADS + unit] += 1;
        }
    }
}

/// How often each digit occurs in each block: `histogram[digit, block]`.
#[cube(launch)]
pub(crate) fn count_block_digits(keys: &[u32], histogram: &mut [u32], count: u32, blocks: u32, shift: u32) {
    let mut counts = Shared::<[u32]>::new_slice(DIGITS * THREADS);
    count_digits(keys, &mut counts, count, shift);
    sync_cube();
    if UNIT_POS < 16 && CUBE_POS < blocks as usize {
        let mut sum = 0u32;
        for thread in 0..THREADS {
            sum += counts[UNIT_POS as usize * THREADS + thread];
        }
        histogram[UNIT_POS as usize * blocks as usize + CUBE_POS] = sum;
    }
}

/// Writes keys and values to their places: `starts[digit, block]` are the prefix sums of the histogram.
#[cube(launch)]
pub(crate) fn scatter(
    keys: &[u32],
    values: &[u32],
    starts: &[u32],
    sorted_keys: &mut [u32],
    sorted_values: &mut [u32],
    count: u32,
    blocks: u32,
    shift: u32,
) {
    let mut counts = Shared::<[u32]>::new_slice(DIGITS * THREADS);
    let unit = UNIT_POS as usize;
    count_digits(keys, &mut counts, count, shift);
    sync_cube();
    // Each digit has its row of 256 counts: 16 threads turn them into prefix sums that start in the whole array.
    if UNIT_POS < 16 && CUBE_POS < blocks as usize {
        let mut running = starts[unit * blocks as usize + CUBE_POS];
        for thread in 0..THREADS {
            let here = counts[unit * THREADS + thread];
            counts[unit * THREADS + thread] = running;
            running += here;
        }
    }
    sync_cube();
    let first = ABSOLUTE_POS * PER_THREAD;
    for step in 0..PER_THREAD {
        if first + step < count as usize {
            let key = keys[first + step];
            let place = ((key >> shift) & 15u32) as usize * THREADS + unit;
            let to = counts[place] as usize;
            counts[place] += 1;
            sorted_keys[to] = key;
            sorted_values[to] = values[first + step];
        }
    }
}

/// Values of a block; the host counts blocks with it.
pub(crate) const SORT_BLOCK: usize = BLOCK;
