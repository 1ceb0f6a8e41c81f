//! Exclusive prefix sums, block by block: sums of blocks, their prefix sums, then the blocks' own.

use cubecl::prelude::*;

/// Threads of a cube.
pub(crate) const THREADS: usize = 256;
/// Values that a thread adds up by itself.
pub(crate) const PER_THREAD: usize = 4;
/// Values of a block.
pub(crate) const BLOCK: usize = THREADS * PER_THREAD;

/// Turns `shared`, one value per thread, into the sums of all values up to and with each.
#[cube]
pub(crate) fn inclusive_scan(shared: &mut Shared<[u32]>) {
    let unit = UNIT_POS as usize;
    #[unroll]
    for step in 0..8u32 {
        let reach = comptime!(1usize << step);
        sync_cube();
        let mut before = 0u32;
        if unit >= reach {
            before = shared[unit - reach];
        }
        sync_cube();
        shared[unit] += before;
    }
    sync_cube();
}

/// The sum of each block of `values`.
#[cube(launch)]
pub(crate) fn sum_blocks(values: &[u32], sums: &mut [u32], count: u32) {
    let mut shared = Shared::<[u32]>::new_slice(THREADS);
    let first = ABSOLUTE_POS * PER_THREAD;
    let mut sum = 0u32;
    #[unroll]
    for step in 0..PER_THREAD {
        let index = first + step;
        if index < count as usize {
            sum += values[index];
        }
    }
    shared[UNIT_POS as usize] = sum;
    inclusive_scan(&mut shared);
    if UNIT_POS == 255 && CUBE_POS < sums.len() {
        sums[CUBE_POS] = shared[255];
    }
}

/// Exclusive prefix sums of `sums` in place, by a single cube.
#[cube(launch)]
pub(crate) fn scan_sums(sums: &mut [u32], count: u32) {
    let mut shared = Shared::<[u32]>::new_slice(THREADS);
    let unit = UNIT_POS as usize;
    let share = (count as usize).div_ceil(256);
    let first = unit * share;
    let mut sum = 0u32;
    for step in 0..share {
        if first + step < count as usize {
            sum += sums[first + step];
        }
    }
    shared[unit] = sum;
    inclusive_scan(&mut shared);
    let mut running = shared[unit] - sum;
    for step in 0..share {
        if first + step < count as usize {
            let value = sums[first + step];
            sums[first + step] = running;
            running += value;
        }
    }
}

/// Exclusive prefix sums of `values` from those of the blocks' sums.
#[cube(launch)]
pub(crate) fn scan_blocks(values: &[u32], starts: &[u32], scanned: &mut [u32], count: u32) {
    let mut shared = Shared::<[u32]>::new_slice(THREADS);
    let first = ABSOLUTE_POS * PER_THREAD;
    let mut sum = 0u32;
    #[unroll]
    for step in 0..PER_THREAD {
        let index = first + step;
        if index < count as usize {
            sum += values[index];
        }
    }
    shared[UNIT_POS as usize] = sum;
    inclusive_scan(&mut shared);
    let mut running = starts[CUBE_POS] + shared[UNIT_POS as usize] - sum;
    #[unroll]
    for step in 0..PER_THREAD {
        let index = first + step;
        if index < count as usize {
            scanned[index] = running;
            running += values[index];
        }
    }
}

/// The sum of the first `count` values, from their prefix sums.
#[cube(launch)]
pub(crate) fn take_total(values: &[u32], scanned: &[u32], total: &mut [u32], count: u32) {
    if ABSOLUTE_POS == 0 {
        let last = count as usize - 1;
        total[0] = scanned[last] + values[last];
    }
}
